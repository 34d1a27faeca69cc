"""Third-party clients fly the simulator: MAVSDK 4, and pymavlink alone."""

import subprocess
import sys
import threading
from pathlib import Path

import pytest
from pymavlink import mavutil

from foundation.sensors import CALENDAR_START_US
from tests.support.command_line import last_object
from tests.support.mavsdk_example import fly_example
from tests.support.simulated_vehicle import patient_state, simulated_vehicle

SPEED = 4.0


@pytest.fixture
def simulator(tmp_path):
    with simulated_vehicle(tmp_path, SPEED, patient_state(tmp_path)) as ports:
        yield ports


@pytest.fixture
def agent_url(simulator):
    return f"127.0.0.1:{simulator['agent'][0]}"


def test_a_mavsdk_script_takes_off_flies_offboard_and_lands(agent_url):
    fly_example("mavsdk4.py", Path(sys.executable), f"udpout://{agent_url}")


def test_a_pymavlink_script_takes_off_flies_offboard_and_lands(agent_url):
    fly_example("pymavlink_velocity.py", Path(sys.executable), f"udpout:{agent_url}")


@pytest.mark.slow
def test_a_mavsdk_script_receives_all_telemetry_and_flies_offboard_and_a_mission(tmp_path):
    script = Path(__file__).with_name("mavsdk_tour.py")
    with simulated_vehicle(tmp_path, SPEED, patient_state(tmp_path)) as ports:
        run = subprocess.run(
            [sys.executable, script, f"udpout://127.0.0.1:{ports['agent'][0]}"],
            capture_output=True, text=True, timeout=200, check=False,
        )  # fmt: skip
    assert run.returncode == 0, run.stdout[-1000:] + run.stderr[-2000:]
    seen = last_object(run.stdout)
    assert seen["silent"] == []
    assert 0 < seen["epoch_us"] - CALENDAR_START_US < 600_000_000
    assert seen["file"]
    mission = seen["mission"]
    assert mission["finished"]
    assert mission["items"] == 3
    assert mission["progress"][-1] == [3, 3]
    assert seen["end"] == pytest.approx([0.0, 0.0], abs=2.0)


class Client:
    """A typical pymavlink client."""

    def __init__(self, url):
        self.link = mavutil.mavlink_connection(f"udpout:{url}", source_system=255)
        self.stopped = threading.Event()
        threading.Thread(target=self._beat, daemon=True).start()
        self.link.wait_heartbeat(timeout=20)

    def _beat(self):
        while not self.stopped.wait(0.5):
            self.link.mav.heartbeat_send(6, 8, 0, 0, 4)

    def until(self, kind, wanted, timeout=60):
        for _ in range(timeout * 200):
            message = self.link.recv_match(type=kind, blocking=True, timeout=5)
            assert message is not None, f"no {kind}"
            if wanted(message):
                return message
        raise AssertionError(f"{kind} never became what it should")

    def command(self, number, *parameters):
        filled = (*parameters, *(0,) * (7 - len(parameters)))
        self.link.mav.command_long_send(self.link.target_system, 1, number, 0, *filled)
        return self.until("COMMAND_ACK", lambda ack: ack.command == number).result


def test_a_pymavlink_client_arms_takes_off_and_lands(agent_url):
    client = Client(agent_url)
    try:
        client.until("SYS_STATUS", lambda m: m.onboard_control_sensors_health & 0x10000000)
        assert client.command(400, 1) == 0
        client.until("HEARTBEAT", lambda m: m.base_mode & 128)
        nan = float("nan")
        assert client.command(22, nan, nan, nan, nan, nan, nan, nan) == 0
        client.until("GLOBAL_POSITION_INT", lambda m: m.relative_alt > 2000)
        assert client.command(400, 0) != 0  # no disarming in the air
        assert client.command(21) == 0
        client.until("HEARTBEAT", lambda m: not m.base_mode & 128)
        assert client.command(59999) == 3  # unknown: unsupported
    finally:
        client.stopped.set()
        client.link.close()
