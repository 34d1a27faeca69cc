import math

import pytest

from foundation.mavlink import dialect
from foundation.setpoints import Hold, PicturePose, Turn, Velocity
from hil.link.autopilots import setpoint_message
from hil.link.offboard import CORRECTION_MAX, OffboardStream, PositionSetpoint, VelocitySetpoint
from hil.link.streams import TICK_US

STILL = (0.0, 0.0, 0.0)


def message(stream, position, velocity=STILL, yaw=0.0, time_us=1_000_000):
    target = stream.streamed(position, velocity, yaw, time_us)
    return None if target is None else setpoint_message(target, time_us // 1000, 1, 1)


def test_no_stream_before_a_request():
    stream = OffboardStream()
    assert message(stream, (0, 0, 0)) is None
    stream.fly(Hold())
    assert message(stream, (0, 0, 0)) is not None
    stream.stop()
    assert message(stream, (0, 0, 0)) is None


def test_hold_keeps_the_position_and_heading_of_its_start():
    stream = OffboardStream()
    stream.fly(Hold())
    message(stream, (3.0, 4.0, -2.0), yaw=1.0)
    drifted = message(stream, (3.5, 4.5, -2.5), yaw=1.2)
    assert (drifted.x, drifted.y, drifted.z) == pytest.approx((3.0, 4.0, -2.0))
    assert drifted.yaw == pytest.approx(1.0)
    assert drifted.type_mask == 0x9F8
    assert drifted.coordinate_frame == 1
    stream.fly(Hold())  # sent again, as after each step
    again = message(stream, (3.5, 4.5, -2.5))
    assert (again.x, again.y, again.z) == pytest.approx((3.0, 4.0, -2.0))


def test_hold_in_motion_is_at_the_stopping_position():
    stream = OffboardStream()
    stream.fly(Hold())
    held = message(stream, (0.0, 0.0, -2.0), velocity=(1.2, 0.0, 0.0))
    assert 0.5 < held.x < 1.0


def test_velocity_flies_forward_and_corrects_the_height():
    stream = OffboardStream()
    stream.fly(Velocity(forward=1.2, up=None))
    first = message(stream, (0.0, 0.0, -2.0))
    assert (first.type_mask, first.coordinate_frame) == (0x5C7, 8)
    assert (first.vx, first.vy, first.vz) == pytest.approx((1.2, 0.0, 0.0))
    sunk = message(stream, (1.0, 0.0, -1.7))
    assert sunk.vz == pytest.approx(-0.3)  # climbs back
    assert abs(message(stream, (1.0, 0.0, 9.0)).vz) == pytest.approx(CORRECTION_MAX)


def test_the_held_height_is_kept_in_level_moves_and_updated_after_a_climb():
    stream = OffboardStream()
    stream.fly(Hold())
    message(stream, (0, 0, -2.0))
    stream.fly(Velocity(1.0, None))
    assert message(stream, (0, 0, -1.9)).vz == pytest.approx(-0.1)
    stream.fly(Velocity(1.0, 0.5))
    assert message(stream, (1, 0, -1.9)).vz == pytest.approx(-0.5)
    stream.fly(Hold())
    assert message(stream, (2, 0, -3.4)).z == pytest.approx(-3.4)


def test_a_turn_holds_the_position_of_the_previous_hold():
    stream = OffboardStream()
    stream.fly(Hold())
    message(stream, (1.0, 1.0, -2.0), yaw=0.0)
    stream.fly(Turn(math.radians(60)))
    turning = message(stream, (0.5, 1.0, -2.0), yaw=math.pi / 2)
    assert turning.yaw_rate == pytest.approx(math.radians(60))
    assert (turning.vx, turning.vy) == pytest.approx((0.0, -0.45), abs=1e-6)  # 0.5 m to the north is now to the left


@pytest.mark.parametrize("after", [Hold(), Velocity(1.2, None)])
def test_after_a_turn_the_held_heading_is_the_commanded_one_not_the_reached_one(after):
    stream = OffboardStream()
    stream.fly(Hold())
    message(stream, (0, 0, -2.0), yaw=3.0, time_us=1_000_000)
    stream.fly(Turn(math.radians(60)), ends_us=2_050_000)
    for tick in range(20):  # the vehicle lags behind
        message(stream, (0, 0, -2.0), yaw=3.0 + tick * 0.03, time_us=1_050_000 + tick * 50_000)
    stream.fly(after)
    sent = message(stream, (0, 0, -2.0), yaw=3.9, time_us=2_050_000)
    wanted_yaw = 3.0 + math.radians(60)
    if isinstance(after, Hold):
        assert sent.yaw == pytest.approx(wanted_yaw - 2 * math.pi)
    else:
        assert sent.yaw_rate == pytest.approx(1.5 * (wanted_yaw - 3.9))
        assert message(stream, (0, 0, -2.0), yaw=0.5, time_us=2_100_000).yaw_rate == pytest.approx(-0.5)


def test_a_gap_during_a_turn_does_not_advance_the_commanded_heading():
    stream = OffboardStream()
    stream.fly(Turn(1.0), ends_us=2_000_000)
    message(stream, (0, 0, -2.0), yaw=0.0, time_us=1_000_000)
    held = message(stream, (0, 0, -2.0), yaw=0.1, time_us=11_000_000)
    assert held.yaw == pytest.approx(0.2)


def test_a_turn_in_motion_holds_the_stopping_position():
    stream = OffboardStream()
    stream.fly(Velocity(1.2, None))
    message(stream, (0, 0, -2.0), velocity=(1.2, 0, 0))
    stream.fly(Turn(1.0))
    turning = message(stream, (3.0, 0, -2.0), velocity=(1.2, 0, 0))
    assert turning.vx > 0  # flies on to the stopping position


def test_a_velocity_becomes_a_hold_after_its_duration():
    stream = OffboardStream()
    stream.fly(Velocity(1.2, None), ends_us=3_500_000)
    assert message(stream, (0, 0, -2.0), time_us=3_500_000).vx == pytest.approx(1.2)
    held = message(stream, (3.0, 0, -2.0), velocity=(1.2, 0, 0), time_us=3_700_000)
    assert held.coordinate_frame == 1
    assert 3.0 < held.x < 4.0
    assert message(stream, (9.0, 0, -2.0), time_us=9_000_000).x == pytest.approx(held.x)  # the hold does not move


def test_a_move_follows_the_commanded_heading_not_the_current_yaw():
    stream = OffboardStream()
    stream.fly(Hold())
    message(stream, (0, 0, -2.0), yaw=0.0, time_us=1_000_000)
    stream.fly(Turn(math.radians(60)), 2_500_000, 1_000_000)
    for tick in range(30):
        message(stream, (0, 0, -2.0), yaw=tick * 0.045, time_us=1_050_000 + tick * 50_000)
    stream.fly(Velocity(1.2, None), 5_000_000, 2_500_000)
    sent = message(stream, (0, 0, -2.0), yaw=1.4, time_us=2_550_000)
    assert math.hypot(sent.vx, sent.vy) == pytest.approx(1.2)
    assert 1.4 + math.atan2(sent.vy, sent.vx) == pytest.approx(math.radians(90), abs=1e-6)


@pytest.mark.parametrize("late_us", [0, 20_000, 60_000, 140_000])
def test_the_end_position_of_a_step_does_not_depend_on_the_tick_times(late_us):
    stream = OffboardStream()
    stream.fly(Velocity(1.2, None), ends_us=3_500_000)
    message(stream, (0, 0, -2.0), velocity=(1.2, 0, 0), time_us=1_000_000)
    seen_us = 3_500_000 + late_us
    stream.fly(Hold(), None, seen_us)
    held = message(stream, (3.0 + 1.2 * late_us / 1e6, 0, -2.0), velocity=(1.2, 0, 0), time_us=seen_us)
    assert held.x == pytest.approx(3.0 + 0.6 * 1.2)


@pytest.mark.parametrize("tick_us", [48_000, 50_000, 52_000, 70_000])
def test_the_angle_of_a_turn_does_not_depend_on_the_tick_length(tick_us):
    stream = OffboardStream()
    stream.fly(Hold())
    message(stream, (0, 0, -2.0), yaw=0.3, time_us=1_000_000)
    stream.fly(Turn(math.radians(60)), 2_500_000, 1_000_000)
    time_us = 1_000_000
    while time_us < 2_500_000:
        time_us += tick_us
        message(stream, (0, 0, -2.0), yaw=0.3, time_us=time_us)
    stream.fly(Hold(), None, time_us)
    held = message(stream, (0, 0, -2.0), yaw=1.5, time_us=time_us + tick_us)
    assert held.yaw == pytest.approx(0.3 + math.radians(90), abs=1e-6)


@pytest.mark.parametrize("angle_deg", [0.1, -0.1, 2.0, -3.0])
@pytest.mark.parametrize("first_us", [0, 10_000, 50_000])
def test_a_turn_shorter_than_a_tick_does_not_overshoot(angle_deg, first_us):
    """The simulated yaw follows without lag. The first message comes at any time in the first tick."""
    stream, nose = OffboardStream(), 0.3
    stream.fly(Hold())
    message(stream, (0, 0, -2.0), yaw=nose, time_us=950_000)
    stream.fly(Turn(math.copysign(math.radians(60), angle_deg), math.radians(angle_deg)), 1_000_000, 1_000_000)
    for tick in range(5):
        sent = message(stream, (0, 0, -2.0), yaw=nose, time_us=1_000_000 + first_us + tick * TICK_US)
        nose = sent.yaw if sent.coordinate_frame == 1 else nose + sent.yaw_rate * TICK_US / 1e6
        assert abs(math.degrees(nose - 0.3)) <= abs(angle_deg) + 1e-3
    assert math.degrees(nose - 0.3) == pytest.approx(angle_deg, abs=1e-3)


SEEN = PicturePose((1.0, 2.0, -2.0), 0.5)


def first_message(setpoint, yaw, position=(0.0, 0.0, -2.0)):
    """Return the stream and its first message for a setpoint of the image `SEEN`, with the vehicle at another yaw."""
    stream = OffboardStream()
    stream.fly(Hold())
    message(stream, position, yaw=yaw)
    stream.fly(setpoint, None, 1_000_000, SEEN)
    return stream, message(stream, position, yaw=yaw)


@pytest.mark.parametrize("yaw", [0.5, 0.8, -0.4])
def test_a_move_follows_the_ray_of_its_image_for_any_current_yaw(yaw):
    _, sent = first_message(Velocity(1.2, None, bearing=0.1), yaw, SEEN.position_ned)
    assert yaw + math.atan2(sent.vy, sent.vx) == pytest.approx(0.6)
    assert math.hypot(sent.vx, sent.vy) == pytest.approx(1.2)


def test_a_move_returns_to_the_line_through_the_position_of_its_image():
    right = (1.0 - math.sin(0.5) * 0.2, 2.0 + math.cos(0.5) * 0.2, -2.0)
    _, sent = first_message(Velocity(1.2, None, bearing=0.0), 0.5, right)
    assert sent.vy == pytest.approx(-0.3)
    assert math.hypot(sent.vx, sent.vy) == pytest.approx(1.2)


def test_a_turn_is_relative_to_its_image_and_steady_once_the_yaw_has_settled_there():
    stream, first = first_message(Turn(1.0, 0.4), 0.55)
    assert first.yaw_rate == 1.0
    for tick in range(1, 8):
        assert message(stream, (0, 0, -2.0), yaw=0.6, time_us=1_000_000 + tick * 50_000).yaw_rate == 1.0
    assert not stream.steady((0, 0, -2.0), 0.9, 0.0)  # the commanded heading has not reached its end yet
    last = message(stream, (0, 0, -2.0), yaw=0.8, time_us=1_450_000)
    assert last.yaw == pytest.approx(0.9)
    assert not stream.steady((0, 0, -2.0), 0.85, 0.0)
    assert not stream.steady((0, 0, -2.0), 0.9, 0.2)
    assert stream.steady((0, 0, -2.0), 0.9, 0.05)


def test_a_turn_before_a_move_holds_a_position_on_the_line_of_the_move():
    stream, _ = first_message(Turn(1.0, 0.4, is_before_move=True), 0.5)
    held = message(stream, (0, 0, -2.0), yaw=0.9, time_us=9_000_000)
    held = message(stream, (0, 0, -2.0), yaw=0.9, time_us=9_200_000)
    held = message(stream, (0, 0, -2.0), yaw=0.9, time_us=9_400_000)
    assert held.yaw == pytest.approx(0.9)
    across = math.cos(0.9) * (held.y - 2.0) - math.sin(0.9) * (held.x - 1.0)
    along = math.cos(0.9) * held.x + math.sin(0.9) * held.y
    assert (across, along) == pytest.approx((0.0, 0.0), abs=1e-6)
    assert not stream.steady((0, 0, -2.0), 0.9, 0.0)  # the vehicle is beside the line
    assert stream.steady((held.x, held.y, -2.0), 0.9, 0.0)


@pytest.mark.parametrize(
    ("setpoint", "frame", "mask"),
    [
        (VelocitySetpoint((1.0, 0.0, -0.5), 0.2), dialect.MAV_FRAME_BODY_NED, 0x5C7),
        (PositionSetpoint((1.0, 2.0, -3.0), 0.2), dialect.MAV_FRAME_LOCAL_NED, 0x9F8),
    ],
)
def test_px4_setpoints_have_the_expected_frame_and_type_mask(setpoint, frame, mask):
    sent = setpoint_message(setpoint, 5, 1, 1)
    assert (sent.coordinate_frame, sent.type_mask) == (frame, mask)
