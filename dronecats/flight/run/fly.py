"""Any flight, by its spec."""

from pathlib import Path
from typing import Any

from dronecats.flight.run.outcome import Say
from dronecats.flight.spec.flight_spec import FlightSpec


def fly(spec: FlightSpec, out: Path | None, say: Say) -> dict[str, Any]:
    """Fly, judge, and return what `fly --json` prints, with the exit `status` and the `reason` the flight ended.

    `out` is the run folder, None for a new one. Each way of flying is loaded only when it is flown: a
    companion computer has no simulator. Raises UsageError.
    """
    vehicle = spec.connected
    if vehicle is None:
        from dronecats.flight.run.simulated import fly_simulated

        return fly_simulated(spec, out, say)
    if vehicle.truth is not None:
        from dronecats.flight.run.connected_world import fly_world

        return fly_world(spec, vehicle, vehicle.truth, out, say)
    from dronecats.flight.run.connected import fly_connected

    return fly_connected(spec, vehicle, out, say)
