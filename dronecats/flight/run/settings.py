"""What run.json says of a flight: the flight itself, and what it came to when it was looked up."""

from typing import Any

from dronecats.agent.commanding.command_prompt import CommandPrompt
from dronecats.flight.run.agents import agent_maker
from dronecats.flight.run.identity import code_digest, protocol_numbers
from dronecats.flight.spec.flight import Flight, map_digest
from dronecats.flight.spec.flight_spec import Simulated
from dronecats.flight.spec.spec_file import as_kept


def settings(flight: Flight, camera: dict[str, Any] | None) -> dict[str, Any]:
    """Return the contents of run.json but for versions, and for what only the flight tells. No key is in it.

    Raises UsageError for an agent that there is not.
    """
    agent_maker(flight.spec.agent)
    of_map, on_purpose = map_digest(flight.record), flight.spec.disturbances.words
    return {
        "flight": as_kept(flight.spec),
        **({"disturbed": on_purpose} if on_purpose else {}),
        "agent": flight.spec.agent,
        **({"map_sha256": of_map} if of_map else {}),
        "prompt_name": flight.prompt.name,
        "prompt_sha256": flight.prompt.digest,
        **({"commander_prompt_sha256": CommandPrompt.load().digest} if flight.spec.command == "hierarchical" else {}),
        "clock": _clock(flight.spec.simulated),
        "camera": camera,
        "code_sha256": code_digest(),
        "protocol": protocol_numbers(),
    }


def _clock(simulated: Simulated | None) -> str:
    if simulated is None:
        return "the vehicle's"
    if simulated.speed is not None:
        return "real time"
    return "lockstep but for PX4's telemetry" if simulated.autopilot == "px4" else "lockstep"
