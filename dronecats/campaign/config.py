"""What a worker is told when it starts."""

from dataclasses import dataclass

from dronecats.flight.spec import FlightSpec


@dataclass(frozen=True, slots=True, kw_only=True)
class WorkerConfig:
    """A worker that flies one episode after the other."""

    flight: FlightSpec  # each of them, but for its episode
