"""The gimbal protocol: control, angles and rates, and its messages."""

import math
from dataclasses import replace

import pytest

from foundation.camera_mount import GimbalLimits
from foundation.frames import quat_from_euler, quat_to_euler
from foundation.mavlink import dialect
from tests.autopilot.commander_bench import Bench, Client
from vehicles import airframe as airframes
from vehicles.gimbal import Gimbal

ACCEPTED, DENIED, UNSUPPORTED = 0, 2, 3
POINT, CONFIGURE = dialect.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW, dialect.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE
REQUEST = dialect.MAV_CMD_REQUEST_MESSAGE
LIMITS = GimbalLimits(pitch_min_deg=-80.0, pitch_max_deg=20.0, rate_deg_s=50.0)
NAN = math.nan


class Moving(Bench):
    """A bench with a gimbal that moves at every tick."""

    def __init__(self) -> None:
        self.gimbal = Gimbal(LIMITS, -5.0)
        super().__init__(gimbal=self.gimbal)

    def tick(self) -> None:
        super().tick()
        self.gimbal.advance(0.02)


@pytest.fixture
def bench() -> Moving:
    return Moving()


def pitch_deg(bench: Moving) -> float:
    """Return the newest pitch in the telemetry."""
    bench.client.forget()
    bench.run(0.3)
    newest = bench.client.of("GIMBAL_DEVICE_ATTITUDE_STATUS")[-1]
    roll, pitch, yaw = quat_to_euler(tuple(newest.q))
    assert (roll, yaw) == pytest.approx((0.0, 0.0), abs=1e-6)
    return math.degrees(pitch)


def test_gimbal_information_has_limits_and_capabilities(bench: Moving) -> None:
    assert bench.client.command(REQUEST, dialect.MAVLINK_MSG_ID_GIMBAL_MANAGER_INFORMATION) == ACCEPTED
    (reported,) = bench.client.of("GIMBAL_MANAGER_INFORMATION")
    assert (math.degrees(reported.pitch_min), math.degrees(reported.pitch_max)) == pytest.approx((-80.0, 20.0))
    assert reported.yaw_min == reported.yaw_max == 0.0
    assert 1 <= reported.gimbal_device_id <= 6
    assert reported.cap_flags & dialect.GIMBAL_MANAGER_CAP_FLAGS_HAS_PITCH_AXIS


def test_the_gimbal_reaches_the_commanded_pitch_at_its_rate_limit(bench: Moving) -> None:
    assert pitch_deg(bench) == pytest.approx(-5.0, abs=1e-3)
    assert bench.client.command(POINT, -65.0, NAN, NAN, NAN, 12, 0, 0) == ACCEPTED
    bench.run(0.6)
    assert math.degrees(bench.gimbal.pitch) == pytest.approx(-35.0, abs=1.0)  # 30° in 0.6 s
    bench.run(0.8)
    assert pitch_deg(bench) == pytest.approx(-65.0, abs=1e-3)
    assert bench.client.command(POINT, -200.0, 0, NAN, NAN, 12, 0, 1) == ACCEPTED
    bench.run(1.0)
    assert pitch_deg(bench) == pytest.approx(-80.0, abs=1e-3)  # the end of its range
    assert bench.client.command(POINT, NAN, NAN, 10.0, NAN, 12, 0, 0) == ACCEPTED
    bench.run(1.0)
    assert math.degrees(bench.gimbal.pitch) == pytest.approx(-70.0, abs=0.3)
    assert bench.client.command(POINT, NAN, NAN, NAN, NAN, dialect.GIMBAL_MANAGER_FLAGS_NEUTRAL, 0, 0) == ACCEPTED
    bench.run(2.0)
    assert pitch_deg(bench) == pytest.approx(-5.0, abs=1e-3)


def test_only_clients_in_control_can_command_the_gimbal(bench: Moving) -> None:
    other = Client(bench.autopilot.open_port("minimal"), system=250, component=191)
    assert other.command(POINT, -10.0, NAN, NAN, NAN, 12, 0, 0) == ACCEPTED  # no client is in control
    assert bench.client.command(CONFIGURE, -2, -2, -1, -1, 0, 0, 0) == ACCEPTED
    bench.client.forget()
    bench.run(0.5)
    status = bench.client.of("GIMBAL_MANAGER_STATUS")[-1]
    assert (status.primary_control_sysid, status.primary_control_compid) == (245, 190)
    assert other.command(POINT, -20.0, NAN, NAN, NAN, 12, 0, 0) == DENIED
    assert bench.client.command(POINT, -30.0, NAN, NAN, NAN, 12, 0, 0) == ACCEPTED
    assert bench.client.command(CONFIGURE, -1, -1, 250, 191, 0, 0, 0) == ACCEPTED  # secondary control for the other
    assert other.command(POINT, -20.0, NAN, NAN, NAN, 12, 0, 0) == ACCEPTED
    assert bench.client.command(CONFIGURE, -3, -3, 0, 0, 0, 0, 0) == ACCEPTED
    assert Client(bench.autopilot.open_port("minimal"), 9, 9).command(POINT, 0, NAN, NAN, NAN, 12, 0, 0) == ACCEPTED


def test_commands_without_angles_or_without_a_gimbal_are_rejected(bench: Moving) -> None:
    assert bench.client.command(POINT, NAN, NAN, NAN, NAN, 12, 0, 0) == DENIED
    assert bench.client.command(POINT, -10.0, NAN, NAN, NAN, 12, 0, 5) == UNSUPPORTED  # another device
    fixed = Bench()
    assert fixed.client.command(POINT, -10.0, NAN, NAN, NAN, 12, 0, 0) == UNSUPPORTED
    assert fixed.client.command(CONFIGURE, -2, -2, -1, -1, 0, 0, 0) == UNSUPPORTED
    assert fixed.client.command(REQUEST, dialect.MAVLINK_MSG_ID_GIMBAL_MANAGER_INFORMATION) == DENIED
    fixed.run(3.0)
    assert not [m for m in fixed.client.inbox if m.get_type().startswith("GIMBAL_")]


def test_the_camera_stays_level_while_the_body_tilts() -> None:
    gimbal = Gimbal(LIMITS, -30.0)
    camera = quat_to_euler(gimbal.attitude(quat_from_euler(0.3, -0.2, 1.1)))
    assert camera == pytest.approx((0.0, math.radians(-30.0), 1.1), abs=1e-9)


def test_the_example_is_an_x500_with_a_gimbal() -> None:
    example, plain = airframes.load("examples/x500_gimbal.toml"), airframes.load("x500")
    assert example.camera.gimbal == GimbalLimits()
    assert replace(example, name=plain.name, camera=plain.camera) == plain
