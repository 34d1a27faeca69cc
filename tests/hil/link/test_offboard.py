import math

import pytest

from foundation.setpoints import Hold, PicturePose, Turn, Velocity
from hil.link.autopilots import PX4
from hil.link.offboard import CORRECTION_MAX, OffboardStream
from hil.link.streams import TICK_US

STILL = (0.0, 0.0, 0.0)


def message(stream, position, velocity=STILL, yaw=0.0, time_us=1_000_000):
    target = stream.streamed(position, velocity, yaw, time_us)
    return None if target is None else PX4.setpoint_message(target, time_us // 1000, 1, 1)


def test_no_stream_before_a_request():
    stream = OffboardStream()
    assert message(stream, (0, 0, 0)) is None
    stream.fly(Hold())
    assert message(stream, (0, 0, 0)) is not None
    stream.stop()
    assert message(stream, (0, 0, 0)) is None


def test_hold_keeps_the_place_where_it_began():
    stream = OffboardStream()
    stream.fly(Hold())
    message(stream, (3.0, 4.0, -2.0), yaw=1.0)
    drifted = message(stream, (3.5, 4.5, -2.5), yaw=1.2)
    assert (drifted.x, drifted.y, drifted.z) == pytest.approx((3.0, 4.0, -2.0))
    assert drifted.yaw == pytest.approx(1.0)
    assert drifted.type_mask == 0x9F8
    assert drifted.coordinate_frame == 1
    stream.fly(Hold())  # sent again, as after every step
    again = message(stream, (3.5, 4.5, -2.5))
    assert (again.x, again.y, again.z) == pytest.approx((3.0, 4.0, -2.0))


def test_hold_in_motion_is_put_where_the_vehicle_can_stop():
    stream = OffboardStream()
    stream.fly(Hold())
    held = message(stream, (0.0, 0.0, -2.0), velocity=(1.2, 0.0, 0.0))
    assert 0.5 < held.x < 1.0


def test_velocity_flies_ahead_and_closes_the_height_loop():
    stream = OffboardStream()
    stream.fly(Velocity(forward=1.2, up=None))
    first = message(stream, (0.0, 0.0, -2.0))
    assert (first.type_mask, first.coordinate_frame) == (0x5C7, 8)
    assert (first.vx, first.vy, first.vz) == pytest.approx((1.2, 0.0, 0.0))
    sunk = message(stream, (1.0, 0.0, -1.7))
    assert sunk.vz == pytest.approx(-0.3)  # up again
    assert abs(message(stream, (1.0, 0.0, 9.0)).vz) == pytest.approx(CORRECTION_MAX)


def test_the_height_survives_level_moves_and_is_taken_anew_after_a_climb():
    stream = OffboardStream()
    stream.fly(Hold())
    message(stream, (0, 0, -2.0))
    stream.fly(Velocity(1.0, None))
    assert message(stream, (0, 0, -1.9)).vz == pytest.approx(-0.1)
    stream.fly(Velocity(1.0, 0.5))
    assert message(stream, (1, 0, -1.9)).vz == pytest.approx(-0.5)
    stream.fly(Hold())
    assert message(stream, (2, 0, -3.4)).z == pytest.approx(-3.4)


def test_turn_holds_the_place_of_the_hold_before_it():
    stream = OffboardStream()
    stream.fly(Hold())
    message(stream, (1.0, 1.0, -2.0), yaw=0.0)
    stream.fly(Turn(math.radians(60)))
    turning = message(stream, (0.5, 1.0, -2.0), yaw=math.pi / 2)
    assert turning.yaw_rate == pytest.approx(math.radians(60))
    assert (turning.vx, turning.vy) == pytest.approx((0.0, -0.45), abs=1e-6)  # half a metre north is to the left now


@pytest.mark.parametrize("after", [Hold(), Velocity(1.2, None)])
def test_a_turn_leaves_the_heading_that_it_asked_for_and_not_the_one_that_was_reached(after):
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


def test_a_stream_that_was_interrupted_in_a_turn_does_not_turn_on_in_its_mind():
    stream = OffboardStream()
    stream.fly(Turn(1.0), ends_us=2_000_000)
    message(stream, (0, 0, -2.0), yaw=0.0, time_us=1_000_000)
    held = message(stream, (0, 0, -2.0), yaw=0.1, time_us=11_000_000)
    assert held.yaw == pytest.approx(0.2)


def test_braking_turn_stops_where_it_can():
    stream = OffboardStream()
    stream.fly(Velocity(1.2, None))
    message(stream, (0, 0, -2.0), velocity=(1.2, 0, 0))
    stream.fly(Turn(1.0))
    turning = message(stream, (3.0, 0, -2.0), velocity=(1.2, 0, 0))
    assert turning.vx > 0  # coasts on to its stopping place


def test_moving_setpoints_end_with_their_duration():
    stream = OffboardStream()
    stream.fly(Velocity(1.2, None), ends_us=3_500_000)
    assert message(stream, (0, 0, -2.0), time_us=3_500_000).vx == pytest.approx(1.2)
    held = message(stream, (3.0, 0, -2.0), velocity=(1.2, 0, 0), time_us=3_700_000)
    assert held.coordinate_frame == 1
    assert 3.0 < held.x < 4.0
    assert message(stream, (9.0, 0, -2.0), time_us=9_000_000).x == pytest.approx(held.x)  # and the vehicle stays there


def test_a_move_goes_along_the_heading_that_is_held_and_not_where_the_nose_still_points():
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
def test_a_step_ends_at_the_same_place_whatever_tick_notices_its_end(late_us):
    stream = OffboardStream()
    stream.fly(Velocity(1.2, None), ends_us=3_500_000)
    message(stream, (0, 0, -2.0), velocity=(1.2, 0, 0), time_us=1_000_000)
    seen_us = 3_500_000 + late_us
    stream.fly(Hold(), None, seen_us)
    held = message(stream, (3.0 + 1.2 * late_us / 1e6, 0, -2.0), velocity=(1.2, 0, 0), time_us=seen_us)
    assert held.x == pytest.approx(3.0 + 0.6 * 1.2)


@pytest.mark.parametrize("tick_us", [48_000, 50_000, 52_000, 70_000])
def test_a_turn_has_the_stated_duration_at_any_tick(tick_us):
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
def test_a_turn_of_a_tick_or_less_goes_no_further_than_its_angle(angle_deg, first_us):
    """A nose that turns at once as ordered, at any time in the first tick after the order."""
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
    """Return (the stream, its first message) for a setpoint of this sight after the vehicle's heading has changed."""
    stream = OffboardStream()
    stream.fly(Hold())
    message(stream, position, yaw=yaw)
    stream.fly(setpoint, None, 1_000_000, SEEN)
    return stream, message(stream, position, yaw=yaw)


@pytest.mark.parametrize("yaw", [0.5, 0.8, -0.4])
def test_a_move_goes_along_the_ray_of_its_picture_wherever_the_nose_is_now(yaw):
    _, sent = first_message(Velocity(1.2, None, bearing=0.1), yaw, SEEN.position_ned)
    assert yaw + math.atan2(sent.vy, sent.vx) == pytest.approx(0.6)
    assert math.hypot(sent.vx, sent.vy) == pytest.approx(1.2)


def test_a_move_comes_back_to_the_line_through_the_place_of_its_picture():
    right = (1.0 - math.sin(0.5) * 0.2, 2.0 + math.cos(0.5) * 0.2, -2.0)
    _, sent = first_message(Velocity(1.2, None, bearing=0.0), 0.5, right)
    assert sent.vy == pytest.approx(-0.3)
    assert math.hypot(sent.vx, sent.vy) == pytest.approx(1.2)


def test_a_turn_ends_at_its_angle_from_the_picture_and_is_made_when_the_nose_is_there_and_still():
    stream, first = first_message(Turn(1.0, 0.4), 0.55)
    assert first.yaw_rate == 1.0
    for tick in range(1, 8):
        assert message(stream, (0, 0, -2.0), yaw=0.6, time_us=1_000_000 + tick * 50_000).yaw_rate == 1.0
    assert not stream.steady((0, 0, -2.0), 0.9, 0.0)  # the wanted heading has not reached its end yet
    last = message(stream, (0, 0, -2.0), yaw=0.8, time_us=1_450_000)
    assert last.yaw == pytest.approx(0.9)
    assert not stream.steady((0, 0, -2.0), 0.85, 0.0)
    assert not stream.steady((0, 0, -2.0), 0.9, 0.2)
    assert stream.steady((0, 0, -2.0), 0.9, 0.05)


def test_a_turn_before_a_move_holds_a_place_on_the_line_of_the_move():
    stream, _ = first_message(Turn(1.0, 0.4, is_before_move=True), 0.5)
    held = message(stream, (0, 0, -2.0), yaw=0.9, time_us=9_000_000)
    held = message(stream, (0, 0, -2.0), yaw=0.9, time_us=9_200_000)
    held = message(stream, (0, 0, -2.0), yaw=0.9, time_us=9_400_000)
    assert held.yaw == pytest.approx(0.9)
    across = math.cos(0.9) * (held.y - 2.0) - math.sin(0.9) * (held.x - 1.0)
    along = math.cos(0.9) * held.x + math.sin(0.9) * held.y
    assert (across, along) == pytest.approx((0.0, 0.0), abs=1e-6)
    assert not stream.steady((0, 0, -2.0), 0.9, 0.0)  # the vehicle's position is beside the line
    assert stream.steady((held.x, held.y, -2.0), 0.9, 0.0)
