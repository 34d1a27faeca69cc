"""The reason for the end of a flight is reported at once, before the processes are closed."""

from types import SimpleNamespace
from typing import Any

import pytest

from dronecats.flight.run.episode import Ready, fly
from dronecats.flight.run.pilot import OpenPilot
from dronecats.flight.spec.flight_spec import Authority, FlightSpec, Simulated
from foundation.errors import DronecatsError, LinkError
from hil.link.link import Link, TakeoverError
from tests.hil.link.scripted_vehicle import ScriptedVehicle


@pytest.mark.parametrize("fault", [TakeoverError("another hand has it"), LinkError("it is silent")])
def test_the_reason_is_printed_before_the_end_of_the_flight_is_logged(tmp_path, fault):
    vehicle = ScriptedVehicle()
    happened: list[str] = []
    link = Link(vehicle.transport())
    stage: Any = SimpleNamespace(
        links=[link], camera=None, camera_model=None, executor=None, speed=1.0,
        check=lambda: None, check_vehicles=lambda: None, cause=lambda error: error,
        mend=lambda: happened.append("mend"), begin=lambda t0_us, cap_s: None,
        end=lambda reason, error: happened.append(reason),
    )  # fmt: skip

    def broken(cap_s, decided):
        raise fault

    agent = SimpleNamespace(now_s=1.0, steps=0, fly=broken)
    model: Any = None
    flight: Any = SimpleNamespace(spec=FlightSpec(pilot="oracle", simulated=Simulated()), seed=(0, 0))
    ready = Ready(stage=stage, starts=[], pilot=OpenPilot(model))
    ending = fly(flight, ready, lambda cockpit: agent, Authority(dry=True), tmp_path, happened.append)
    assert isinstance(ending.error, DronecatsError)
    fault_index = next(k for k, line in enumerate(happened) if str(fault) in line)
    assert fault_index < min(happened.index("mend"), happened.index(ending.reason))
