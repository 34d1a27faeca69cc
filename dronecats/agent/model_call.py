"""A call to a model: its executor, its latency on the vehicle's clock, and the treatment of a late reply."""

import threading
from collections.abc import Callable, Generator
from concurrent.futures import Executor, Future, wait
from typing import ParamSpec, TypeVar

from dronecats.agent.latency import Circumstance, LatencyPolicy, Question
from dronecats.agent.models.model import Model, Reply, Request
from foundation.errors import ModelError
from foundation.threads import COMPUTING

P = ParamSpec("P")
T = TypeVar("T")


class InlineExecutor(Executor):
    """Runs a call at once, in the caller's thread. The executor of lockstep."""

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        future: Future[T] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


class DaemonExecutor(Executor):
    """Runs each call on a daemon thread, so that a silent endpoint does not keep the process alive."""

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        future: Future[T] = Future()

        def call() -> None:
            try:
                future.set_result(fn(*args, **kwargs))
            except BaseException as error:
                future.set_exception(error)

        threading.Thread(target=call, name="model", daemon=True).start()
        return future


SLACK_S = 0.15  # three ticks of the 20 Hz clock on which a reply is noticed


class Asking:
    """One question under way. Its latency is charged once: when the reply has come, or before if it is foreseen."""

    def __init__(
        self,
        model: Model,
        request: Request,
        executor: Executor,
        policy: LatencyPolicy,
        question: Question,
        now_s: float,
        beside: bool = False,
        last_s: float | None = None,
    ) -> None:
        """Send the question at `now_s`; `last_s` is the time of the last reply for these drones (vehicle seconds).

        `beside`: a clock that waits goes on meanwhile, up to the due time of a foreseen reply, and waits there.
        """
        self._beside = beside and policy.foreseen
        self._future: Future[Reply] = (DaemonExecutor() if self._beside else executor).submit(model.ask, request)
        self._policy, self._question = policy, question
        self._start_s, self._last_s = now_s, last_s
        self._charged_s: float | None = None

    def due(self, now_s: float) -> bool:
        """Return whether the reply is there and its latency has passed on the vehicle's clock."""
        if self._beside:  # only the due time counts, not the real arrival: else flights would not be reproducible
            foreseen_s = self._charge() or 0.0
            if now_s < self._start_s + foreseen_s - 1e-9:
                return False
            self._wait()
        if not self._future.done():
            return False
        if self._future.exception() is not None:
            return True
        charged_s = self._charge()
        if charged_s is None:
            return now_s >= self._start_s - 1e-9  # a picture may be newer than the newest telemetry
        return now_s >= self._start_s + charged_s - 1e-9

    @property
    def answered(self) -> bool:
        """Return whether the call has come back, with a reply or with an error."""
        if self._beside:
            self._wait()
        return self._future.done()

    def _wait(self) -> None:
        with COMPUTING.lent():
            wait([self._future])

    def reply(self) -> Reply:
        """Return the reply. Raises what the model raised."""
        return self._future.result()

    def latency_s(self, now_s: float) -> float:
        """Return the vehicle seconds that the reply took; `now_s` is the time at which it was acted on.

        It is the charge if the reply came by then, to within the ticks of the clock; else, and without a charge, the
        elapsed time.
        """
        elapsed_s = (now_s - self._start_s) * self.reply().share  # without failed attempts
        charged_s = self._charge()
        if charged_s is None:
            return elapsed_s
        return charged_s if elapsed_s <= charged_s + SLACK_S else elapsed_s

    def _charge(self) -> float | None:
        """Return the charge in vehicle seconds; None: real latency, nothing is charged."""
        if not self._policy.real and self._charged_s is None:
            reply = None if self._policy.foreseen else self.reply()
            since_s = None if self._last_s is None else self._start_s - self._last_s
            self._charged_s = self._policy.charge_s(self._question, Circumstance(reply, since_s))
        return self._charged_s


def await_reply(
    asking: Asking,
    now_s: Callable[[], float],
    start_s: float,
    cap_s: float,
    patience_s: float | None = None,
    last_reply: bool = True,
) -> Generator[None, None, bool]:
    """Yield until the reply is due or the episode is over; return whether it is due.

    Times are vehicle seconds since the episode began. `last_reply`: a reply under way at `cap_s` is awaited. It comes
    too late to be an action, but a slow model has failed and a dead endpoint has not, and only waiting tells them
    apart. Raises ModelError beyond `patience_s` (None: no limit but the client's), and the client's errors.
    """
    while not asking.due(now_s()):
        yield
        if now_s() >= cap_s:
            break
        if patience_s is not None and now_s() > start_s + patience_s:
            raise ModelError(f"the model has not answered for {patience_s:g} s: no decision, no flight")
    if asking.due(now_s()):
        return True
    if last_reply:
        while not asking.answered:
            yield
            if patience_s is not None and now_s() > start_s + patience_s:
                raise ModelError(f"the model has not answered for {patience_s:g} s, nor when the episode was over")
        asking.reply()
    return False
