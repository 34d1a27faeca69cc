"""Flies and judges a flight from its specification, with any kind of vehicle, and writes run.json."""

from pathlib import Path
from typing import Any

from dronecats.agent.commanding.command_prompt import CommandPrompt
from dronecats.flight.run.accounts import FirstQuestions
from dronecats.flight.run.episode import EpisodeEnd
from dronecats.flight.run.identity import code_digest, protocol_numbers
from dronecats.flight.run.pilot import agent_maker
from dronecats.flight.run.setup import UNWATCHED, FlightSetup, Instruments, Notify, served_rate_hz
from dronecats.flight.spec.flight import Flight, look_up
from dronecats.flight.spec.flight_spec import FlightSpec, Simulated
from dronecats.flight.spec.spec_file import as_redacted_json
from episodes import maps
from foundation.run_folder import folder as folders
from foundation.run_folder.folder import write_run


def settings(flight: Flight, camera: dict[str, Any] | None) -> dict[str, Any]:
    """Return the contents of run.json that are known before the flight: no package versions, and no API key.

    Raises UsageError for an unknown agent.
    """
    agent_maker(flight.spec.agent)
    of_map = maps.digest(flight.record.map) if flight.record else None  # None: a shipped map, or no map
    on_purpose = flight.spec.disturbances.words
    return {
        "flight": as_redacted_json(flight.spec),
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


def fly(spec: FlightSpec, out: Path | None, notify: Notify, instruments: Instruments = UNWATCHED) -> dict[str, Any]:
    """Fly, judge, and return the object of `fly --json`, with the exit `status` and the `reason` for the end.

    `out` is the run folder, None for a new one; `instruments` watch a connected vehicle. Invalid settings raise before
    the run folder is made. Raises UsageError, ModelError.
    """
    setup = _setup(look_up(spec), instruments)
    configuration = settings(setup.flight, setup.camera)
    questions = FirstQuestions([spec], out, notify)
    with folders.create(out, spec.pilot_name, setup.episode, configuration, questions.ask) as folder:
        questions.book(folder.parent)
        if setup.headline:
            notify(setup.headline)

        def afterwards(ending: EpisodeEnd) -> None:
            write_run(folder.parent, {**configuration, **setup.facts(), "served_rate_hz": served_rate_hz(folder)})
            setup.finish(folder, ending, notify)

        return setup.fly_in(folder, notify, afterwards)


def _setup(flight: Flight, instruments: Instruments) -> FlightSetup:
    """Return the setup for the simulated or connected vehicle. Raises UsageError, LinkError.

    Only the code for this kind of vehicle is imported, because a companion computer has no simulator.
    """
    vehicle = flight.spec.connected
    if vehicle is None:
        from dronecats.flight.run.simulated import SimulatedFlight

        return SimulatedFlight(flight)
    if vehicle.truth is not None:
        from dronecats.flight.run.connected_world import ConnectedWorldFlight

        return ConnectedWorldFlight(flight, vehicle, vehicle.truth)
    from dronecats.flight.run.connected import ConnectedFlight

    return ConnectedFlight(flight, vehicle, instruments)
