"""Any flight, by its spec."""

from pathlib import Path
from typing import Any

from dronecats.flight.run.episode import Flown
from dronecats.flight.run.first_question import asked_folder
from dronecats.flight.run.outcome import Say, served_rate_hz
from dronecats.flight.run.settings import settings
from dronecats.flight.run.setup import UNWATCHED, FlightSetup, Instruments
from dronecats.flight.spec.flight import look_up
from dronecats.flight.spec.flight_spec import FlightSpec
from foundation.run_folder.folder import write_run


def fly(spec: FlightSpec, out: Path | None, say: Say, instruments: Instruments = UNWATCHED) -> dict[str, Any]:
    """Fly, judge, and return what `fly --json` prints, with the exit `status` and the `reason` the flight ended.

    `out` is the run folder, None for a new one; `instruments` watch a connected vehicle. What can be refused is refused
    before the run folder is made. Raises UsageError, ModelError.
    """
    setup = setup_of(spec, instruments)
    found = settings(setup.flight, setup.camera)
    with asked_folder(spec, out, setup.episode, found, say) as folder:
        if setup.headline:
            say(setup.headline)

        def afterwards(flown: Flown) -> None:
            write_run(folder.parent, {**found, **setup.facts(), "served_rate_hz": served_rate_hz(folder)})
            setup.finish(folder, flown, say)

        return setup.fly_in(folder, say, afterwards)


def setup_of(spec: FlightSpec, instruments: Instruments = UNWATCHED) -> FlightSetup:
    """Return a flight, looked up and checked, with its vehicle connected where it is not ours. Raises UsageError.

    Each kind of vehicle is loaded only when it is flown: a companion computer has no simulator.
    """
    flight = look_up(spec)
    if spec.connected is None:
        from dronecats.flight.run.simulated import SimulatedFlight

        return SimulatedFlight(flight)
    if spec.connected.truth is not None:
        from dronecats.flight.run.connected_world import ConnectedWorldFlight

        return ConnectedWorldFlight(flight, spec.connected, spec.connected.truth)
    from dronecats.flight.run.connected import ConnectedFlight

    return ConnectedFlight(flight, spec.connected, instruments)
