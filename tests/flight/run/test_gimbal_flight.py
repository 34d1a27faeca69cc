"""Flights with a pitched camera, and with a gimbal that an agent commands over MAVLink."""

import json
import math
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest

from dronecats.agent.loop import PaperAgent
from dronecats.flight.run.fly import fly
from dronecats.flight.run.pilot import questions_of
from dronecats.flight.spec.flight import look_up
from dronecats.flight.spec.flight_spec import FlightSpec, Simulated
from dronecats.report.recorded.run import RecordedRun
from foundation.mavlink import dialect
from hil.link.link import Link
from tests.support.simulated_vehicle import simulated_vehicle
from tests.system.test_clients import Client

X500 = Path("vehicles/airframes/x500.toml")
GIMBAL = "examples/x500_gimbal.toml"


class LooksDown(PaperAgent):
    """The paper's agent, with its camera first pointed 40° down."""

    def fly(self, *arguments, **named):
        (aircraft,) = self._cockpit.aircraft
        assert isinstance(aircraft, Link)
        aircraft.point_camera(math.radians(-40.0))
        super().fly(*arguments, **named)


def looks_down(flight, model):
    return partial(LooksDown, questions_of(flight, model))


def frames(run):
    (log,) = run.glob("*/truth.jsonl")
    return [row for line in log.read_text().splitlines() if (row := json.loads(line))["kind"] == "frame"]


@pytest.mark.slow
def test_the_oracle_reaches_its_target_through_a_pitched_camera(tmp_path):
    airframe = tmp_path / "pitched.toml"
    airframe.write_text(X500.read_text() + "\n[camera]\npitch_deg = -20.0\n")
    spec = FlightSpec(
        pilot="oracle", episode="residential-approaching-03",
        simulated=Simulated(speed=None, rendered=False, airframe=str(airframe)),
    )  # fmt: skip
    result = fly(spec, tmp_path / "run", lambda line: None)
    assert result["outcome"] == "success", result
    assert result["ne_m"] < 5.0


@pytest.mark.slow
def test_an_agent_points_its_gimbal_and_the_log_records_the_pitch(tmp_path):
    spec = FlightSpec(
        pilot="oracle", episode="residential-approaching-03", agent=f"{__name__}:looks_down",
        simulated=Simulated(speed=None, rendered=False, airframe=GIMBAL),
    )  # fmt: skip
    result = fly(spec, tmp_path / "run", lambda line: None)
    (*_, last) = frames(tmp_path / "run")
    assert last["camera_pitch_deg"] == pytest.approx(-40.0, abs=0.1)  # its mounting has −10°
    assert result["reason"] in ("decided", "cap"), result["error"]


def test_a_run_records_its_camera_mounting(tmp_path):
    spec = FlightSpec(
        pilot="oracle", episode="residential-approaching-03", simulated=Simulated(speed=None, airframe=GIMBAL)
    )
    run = RecordedRun(folder=tmp_path, configuration={"camera": look_up(spec).camera}, episodes=())
    assert (run.camera.gimballed, run.camera.pitch_deg) == (True, -10.0)
    plain = look_up(replace(spec, simulated=Simulated(speed=None))).camera
    assert plain == {"width": 1280, "height": 720, "hfov_deg": 90.0}


@pytest.mark.slow
def test_a_pymavlink_client_takes_control_of_the_gimbal_and_turns_it(tmp_path):
    with simulated_vehicle(tmp_path, airframe=GIMBAL) as ports:
        client = Client(f"127.0.0.1:{ports['agent'][0]}")
        try:
            client.until("GIMBAL_DEVICE_ATTITUDE_STATUS", lambda m: True)
            wanted = dialect.MAVLINK_MSG_ID_GIMBAL_MANAGER_INFORMATION, 0, 0, 0, 0, 0, 0
            client.link.mav.command_long_send(1, 1, dialect.MAV_CMD_REQUEST_MESSAGE, 0, *wanted)
            limits = client.until("GIMBAL_MANAGER_INFORMATION", lambda m: True)  # arrives before the acknowledgement
            assert math.degrees(limits.pitch_min) == pytest.approx(-90.0, abs=1e-3)
            assert client.command(1001, -2, -2, -1, -1) == 0
            client.until("GIMBAL_MANAGER_STATUS", lambda m: m.primary_control_sysid == 255)
            nan = float("nan")
            assert client.command(1000, -60.0, nan, nan, nan, 12) == 0
            half = math.sin(math.radians(-30.0))  # y of the quaternion: sin(pitch / 2)
            client.until("GIMBAL_DEVICE_ATTITUDE_STATUS", lambda m: abs(m.q[2] - half) < 1e-3)
        finally:
            client.stopped.set()
            client.link.close()
