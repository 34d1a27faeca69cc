"""A question on its way to the model, and when its reply is due on the vehicle's clock."""

from concurrent.futures import Executor, Future, wait

from dronecats.agent.executors import DaemonExecutor
from dronecats.agent.latency import Circumstance, LatencyPolicy, Question
from dronecats.agent.models.model import Model, Reply, Request
from foundation.turn import COMPUTING

SLACK_S = 0.15  # three ticks of the 20 Hz clock on which a reply is noticed


class Asking:
    """One question. Its latency is charged once: when the reply has come, or before where it is foreseen."""

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
        """`now_s`: vehicle seconds, at which it is asked; `last_s`: at which the same were answered last, if ever.

        `beside`: a clock that waits may go on meanwhile, up to where a foreseen reply is due, and there it waits.
        """
        self._beside = beside and policy.foreseen
        self._future: Future[Reply] = (DaemonExecutor() if self._beside else executor).submit(model.ask, request)
        self._policy, self._question = policy, question
        self._asked_s, self._last_s = now_s, last_s
        self._charged_s: float | None = None

    def due(self, now_s: float) -> bool:
        """Return whether the reply is there and its latency has passed on the vehicle's clock."""
        if self._beside:  # it matters when it is due, and never when it came: else no flight would be flown twice
            foreseen_s = self._charge() or 0.0
            if now_s < self._asked_s + foreseen_s - 1e-9:
                return False
            self._wait()
        if not self._future.done():
            return False
        if self._future.exception() is not None:
            return True
        charged_s = self._charge()
        if charged_s is None:
            return now_s >= self._asked_s - 1e-9  # a picture may be newer than what the vehicle has told since
        return now_s >= self._asked_s + charged_s - 1e-9

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
        """Return the vehicle seconds that the reply took, `now_s` being when it was acted on.

        What was charged, where that is how long it took to within the ticks of the clock; else how long it really
        took: always without a charge, and where the reply came later than the charge.
        """
        elapsed_s = (now_s - self._asked_s) * self.reply().share  # attempts that failed are not the model's
        charged_s = self._charge()
        if charged_s is None:
            return elapsed_s
        return charged_s if elapsed_s <= charged_s + SLACK_S else elapsed_s

    def _charge(self) -> float | None:
        """Return what the reply costs in vehicle seconds; None where it costs what it takes."""
        if not self._policy.real and self._charged_s is None:
            reply = None if self._policy.foreseen else self.reply()
            since_s = None if self._last_s is None else self._asked_s - self._last_s
            self._charged_s = self._policy.charge_s(self._question, Circumstance(reply, since_s))
        return self._charged_s
