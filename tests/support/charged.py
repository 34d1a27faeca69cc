"""A latency policy for tests: the latency is any function of the question."""

from collections.abc import Callable
from dataclasses import dataclass

from dronecats.agent.latency import Circumstance, LatencyPolicy, Question


@dataclass(frozen=True)
class Charged(LatencyPolicy):
    """Charges `seconds(question)`, which is computed after the reply arrives."""

    seconds: Callable[[Question], float] = lambda question: 0.0

    @property
    def real(self) -> bool:
        return False

    @property
    def foreseen(self) -> bool:
        return False

    def charge_s(self, question: Question, of: Circumstance) -> float:
        return self.seconds(question)
