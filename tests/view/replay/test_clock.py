"""The clock of a replay: the shown time after any sequence of orders."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dronecats.view.replay.player import SPEEDS, PlaybackClock
from foundation.errors import UsageError

ORDERS = ("toggled", "faster", "slower", "settled")
walls = st.floats(0.0, 1e4)


def test_the_clock_starts_paused_and_stops_at_the_end():
    clock = PlaybackClock(20.0)
    assert clock.at(100.0) == 0.0
    playing = clock.toggled(100.0)
    assert playing.at(103.5) == pytest.approx(3.5)
    assert playing.at(1000.0) == 20.0
    assert playing.settled(103.0) is playing
    over = playing.settled(1000.0)
    assert not over.playing
    assert over.at(2000.0) == 20.0
    assert over.toggled(2000.0).at(2001.0) == pytest.approx(1.0)  # played once more, from the beginning


def test_speed_scales_the_flight_time_and_a_change_causes_no_jump():
    for speed in SPEEDS:
        playing = PlaybackClock(1e4).toggled(10.0).at_speed(speed, 12.0)
        assert playing.at(12.0) == pytest.approx(2.0), speed
        assert playing.at(15.0) == pytest.approx(2.0 + 3.0 * speed), speed


def test_faster_and_slower_step_through_all_speeds_and_stop_at_the_ends():
    clock, speeds = PlaybackClock(20.0, speed=SPEEDS[0]), [SPEEDS[0]]
    for _ in range(2 * len(SPEEDS)):
        clock = clock.faster(0.0)
        speeds.append(clock.speed)
    assert tuple(dict.fromkeys(speeds)) == SPEEDS == tuple(sorted(SPEEDS))
    for speed in reversed(SPEEDS[:-1]):
        clock = clock.slower(0.0)
        assert clock.speed == speed
    assert clock.slower(0.0).speed == SPEEDS[0]
    assert PlaybackClock(20.0, speed=0.7).faster(0.0).speed == 1.0
    assert PlaybackClock(20.0, speed=0.7).slower(0.0).speed == 0.5


def test_speeds_out_of_range_are_rejected():
    for speed in (0.0, -1.0, 0.05, 21.0, math.nan, math.inf):
        with pytest.raises(UsageError, match=r"--speed .*0\.1 .*20"):
            PlaybackClock(20.0).at_speed(speed, 0.0)


def test_a_step_or_a_scrub_pauses_the_clock():
    playing = PlaybackClock(20.0).toggled(0.0)
    stepped = playing.stepped(0.1, 5.0)
    assert not stepped.playing
    assert stepped.at(50.0) == pytest.approx(5.1)
    assert playing.stepped(-0.1, 5.0).at(50.0) == pytest.approx(4.9)
    assert playing.scrubbed(math.nan, 5.0).at(50.0) == pytest.approx(5.0)
    assert playing.scrubbed(1e9, 5.0).at(50.0) == 20.0


@given(st.lists(st.tuples(st.sampled_from(ORDERS), walls, st.floats(-50.0, 50.0)), max_size=12), st.floats(0.0, 60.0))
def test_any_orders_keep_the_time_continuous_and_within_the_flight(orders, end_s):
    clock, wall = PlaybackClock(end_s), 0.0
    for order, later, by_s in orders:
        wall += later
        before = clock.at(wall)
        stepped = clock.stepped(by_s, wall)
        assert 0.0 <= stepped.at(wall + 3.0) <= end_s
        begins = order == "toggled" and not clock.playing and before >= end_s
        clock = getattr(clock, order)(wall)
        assert clock.at(wall) == pytest.approx(0.0 if begins else before)
