"""What a worker is told when it starts."""

from dataclasses import dataclass

from dronecats.flight.spec import FlightSpec


@dataclass(frozen=True, slots=True, kw_only=True)
class WorkerConfig:
    """A worker that flies episodes, several at a time where its flights mostly wait for a model."""

    flight: FlightSpec  # each of them, but for its episode
