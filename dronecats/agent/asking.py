"""A question on its way to the model, and when its reply is due on the vehicle's clock."""

from concurrent.futures import Executor, Future

from dronecats.agent.latency import Latency, Question
from dronecats.agent.models.model import Model, Reply, Request

SLACK_S = 0.15  # three ticks of the 20 Hz clock on which a reply is noticed


class Asking:
    """One question. Its latency is charged once, when the reply has come."""

    def __init__(
        self, model: Model, request: Request, executor: Executor, policy: Latency, question: Question, now_s: float
    ) -> None:
        """`now_s`: vehicle seconds, at which it is asked."""
        self._future: Future[Reply] = executor.submit(model.ask, request)
        self._policy, self._question = policy, question
        self._asked_s = now_s
        self._charged_s: float | None = None

    def due(self, now_s: float) -> bool:
        """Return whether the reply is there and its latency has passed on the vehicle's clock."""
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
        charged_s = self._charge()
        if charged_s is None:
            return elapsed_s
        return charged_s if elapsed_s <= charged_s + SLACK_S else elapsed_s

    def _charge(self) -> float | None:
        """Return what the reply costs in vehicle seconds; None where it costs what it takes."""
        if self._policy.charge is not None and self._charged_s is None:
            self._charged_s = self._policy.charge(self._question, self.reply().latency_s)
        return self._charged_s
