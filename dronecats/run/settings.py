"""What run.json says of a flight: the flight itself, and what it came to when it was looked up."""

from typing import Any

from dronecats.agent.command_prompt import CommandPrompt
from dronecats.flight.file import as_kept
from dronecats.flight.flight import Flight, map_digest
from dronecats.flight.spec import Simulated
from dronecats.run.pilot import AgentMaker, papers_agent


def settings(flight: Flight, camera: dict[str, Any] | None, agent: AgentMaker = papers_agent) -> dict[str, Any]:
    """Return the contents of run.json but for versions, and for what only the flight tells. No key is in it."""
    of_map = map_digest(flight.record)
    return {
        "flight": as_kept(flight.spec),
        "agent": f"{agent.__module__}.{agent.__qualname__}",
        **({"map_sha256": of_map} if of_map else {}),
        "prompt_sha256": flight.prompt.digest,
        **({"commander_prompt_sha256": CommandPrompt.load().digest} if flight.spec.command == "hierarchical" else {}),
        "clock": _clock(flight.spec.simulated),
        "camera": camera,
    }


def _clock(simulated: Simulated | None) -> str:
    if simulated is None:
        return "the vehicle's"
    if simulated.speed is not None:
        return "real time"
    return "lockstep but for PX4's telemetry" if simulated.autopilot == "px4" else "lockstep"
