"""What a worker is told when it starts."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class WorkerConfig:
    """A worker that flies what it is told to, several flights at a time where they mostly wait for a model."""

    poll_s: float = 0.2  # wall s at most until it answers whether a flight is over
