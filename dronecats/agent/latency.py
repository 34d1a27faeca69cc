"""Model latency in vehicle time: as it really passes, as measured, or fixed.

The drone holds while the model decodes, and the world keeps moving. In real time latency passes by itself; in lockstep
the vehicle's clock stands still during the call, so the latency is charged afterwards.
"""

import threading
from collections.abc import Callable
from concurrent.futures import Executor, Future
from dataclasses import dataclass
from typing import ParamSpec, TypeVar

from dronecats.agent.models.model import Model, Reply, Request
from foundation.errors import UsageError

P = ParamSpec("P")
T = TypeVar("T")

Charge = Callable[[float], float]  # measured wall seconds -> vehicle seconds
SLACK_S = 0.15  # three ticks of the 20 Hz clock on which a reply is noticed


@dataclass(frozen=True, slots=True)
class Latency:
    """How long a reply takes in vehicle time."""

    name: str  # as the command line has it; kept in run.json
    charge: Charge | None  # None: the call lasts as long as it lasts


def latency(text: str) -> Latency:
    """Return the policy named `real`, `measured` or `fixed:SECONDS`. Raises UsageError."""
    kind, _, value = text.partition(":")
    if text == "real":
        return Latency(text, None)
    if text == "measured":
        return Latency(text, lambda measured_s: measured_s)
    if kind == "fixed":
        try:
            seconds = float(value)
        except ValueError:
            seconds = -1.0
        if 0.0 <= seconds <= 300.0:
            return Latency(text, lambda _measured_s: seconds)
    raise UsageError(f"--latency wants real, measured or fixed:SECONDS (0 … 300), got '{text}'")


class InlineExecutor(Executor):
    """Runs a call at once, in the caller: while it runs, nothing else happens. The executor of lockstep."""

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        future: Future[T] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


class DaemonExecutor(Executor):
    """Runs each call on a thread that the interpreter does not wait for: a silent endpoint must not keep us alive."""

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        future: Future[T] = Future()

        def call() -> None:
            try:
                future.set_result(fn(*args, **kwargs))
            except BaseException as error:
                future.set_exception(error)

        threading.Thread(target=call, name="model", daemon=True).start()
        return future


class Asking:
    """A question on its way."""

    def __init__(self, model: Model, request: Request, executor: Executor, policy: Latency, now_s: float) -> None:
        self._future: Future[Reply] = executor.submit(model.ask, request)
        self._policy = policy
        self._asked_s = now_s

    def due(self, now_s: float) -> bool:
        """Return whether the reply is there and its latency has passed on the vehicle's clock."""
        if not self._future.done():
            return False
        if self._future.exception() is not None:
            return True
        if self._policy.charge is None:
            return now_s >= self._asked_s - 1e-9  # a picture may be newer than what the vehicle has told since
        return now_s >= self._asked_s + self._policy.charge(self.reply().latency_s) - 1e-9

    @property
    def answered(self) -> bool:
        """Return whether the call has come back, with a reply or with an error."""
        return self._future.done()

    def reply(self) -> Reply:
        """Return the reply. Raises what the model raised."""
        return self._future.result()

    def latency_s(self, now_s: float) -> float:
        """Return the vehicle seconds that the reply took, `now_s` being when it was acted on.

        What was charged, where that is how long it took to within the ticks of the clock; else how long it really
        took: always without a charge, and where the reply came later than the charge.
        """
        elapsed_s = (now_s - self._asked_s) * self.reply().share  # attempts that failed are not the model's
        if self._policy.charge is None:
            return elapsed_s
        charged_s = self._policy.charge(self.reply().latency_s)
        return charged_s if elapsed_s <= charged_s + SLACK_S else elapsed_s
