"""Any flight, by its spec."""

from pathlib import Path
from typing import Any

from dronecats.flight.spec import FlightSpec
from dronecats.run.outcome import Say
from dronecats.run.pilot import AgentMaker, papers_agent


def fly(spec: FlightSpec, out: Path | None, say: Say, agent: AgentMaker = papers_agent) -> dict[str, Any]:
    """Fly, judge, and return what `fly --json` prints, with the exit `status` and the `reason` the flight ended.

    `out` is the run folder, None for a new one; `agent` makes whoever flies of the model that the spec names.
    Each way of flying is loaded only when it is flown: a companion computer has no simulator. Raises UsageError.
    """
    vehicle = spec.connected
    if vehicle is None:
        from dronecats.run.simulated import fly_simulated

        return fly_simulated(spec, out, say, agent)
    if vehicle.truth is not None:
        from dronecats.run.connected_world import fly_world

        return fly_world(spec, vehicle, vehicle.truth, out, say, agent)
    from dronecats.run.connected import fly_connected

    return fly_connected(spec, vehicle, out, say, agent)
