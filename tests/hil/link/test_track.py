import math
import tracemalloc

import pytest

from hil.link.course import DROPPED_AT_ONCE, KEPT_US, PoseHistory


def make_track(*, places=(), headings=()):
    track = PoseHistory()
    for time_us, north, speed in places:
        track.place(time_us, (north, 0.0, -2.0), (speed, 0.0, 0.0))
    for time_us, yaw, yaw_rate in headings:
        track.heading(time_us, yaw, yaw_rate)
    return track


def test_roll_and_pitch_are_interpolated_but_not_extrapolated():
    track = make_track(places=[(1_000_000, 1.0, 0.0)], headings=[(1_000_000, 0.5, 0.0)])
    assert (track.at(1_000_000).roll, track.at(1_000_000).pitch) == (0.0, 0.0)
    track.tilt(1_000_000, 0.1, -0.2)
    track.tilt(1_100_000, 0.3, -0.1)
    assert (track.at(1_050_000).roll, track.at(1_050_000).pitch) == pytest.approx((0.2, -0.15))
    assert (track.at(1_200_000).roll, track.at(1_200_000).pitch) == pytest.approx((0.3, -0.1))
    assert (track.at(0).roll, track.at(0).pitch) == pytest.approx((0.1, -0.2))


STANDING = [(1_000_000, 0.0, 0.0)]


def test_the_position_is_interpolated_between_two_reports():
    track = make_track(places=[(1_000_000, 1.0, 0.0), (1_100_000, 2.0, 0.0)], headings=STANDING)
    assert track.at(1_025_000).position_ned == pytest.approx((1.25, 0.0, -2.0))


def test_the_heading_is_interpolated_along_the_shorter_arc():
    track = make_track(places=STANDING, headings=[(1_000_000, 3.1, 0.0), (1_100_000, -3.1, 0.0)])
    assert abs(track.at(1_050_000).heading) == pytest.approx(math.pi)


def test_the_pose_is_extrapolated_only_briefly_after_the_newest_report():
    track = make_track(places=[(1_000_000, 1.0, 1.2)], headings=[(1_000_000, 0.5, 1.0)])
    assert track.at(1_050_000).position_ned[0] == pytest.approx(1.06)
    assert track.at(1_050_000).heading == pytest.approx(0.55)
    assert track.at(9_000_000).position_ned[0] == pytest.approx(1.24)
    assert [track.at(time_us).carried_on for time_us in (999_999, 1_000_000, 1_000_001)] == [False, False, True]
    track.place(1_100_000, (1.3, 0.0, -2.0), (0.0, 0.0, 0.0))
    assert track.at(1_050_000).carried_on  # the heading is still extrapolated
    track.heading(1_100_000, 0.6, 0.0)
    assert not track.at(1_050_000).carried_on


def test_times_before_the_first_report_return_the_first_pose():
    track = make_track(places=[(5_000_000, 1.0, 1.2)], headings=[(5_000_000, 0.5, 1.0)])
    assert track.at(1_000_000).position_ned[0] == 1.0
    assert track.at(1_000_000).heading == 0.5


def test_there_is_no_pose_before_position_and_heading_have_arrived():
    assert make_track(places=STANDING).at(1_000_000) is None
    assert make_track(headings=STANDING).at(1_000_000) is None


def test_a_clock_restart_starts_a_new_track():
    track = make_track(places=[(90_000_000, 50.0, 0.0), (1_000_000, 1.0, 0.0)], headings=STANDING)
    assert track.at(2_000_000).position_ned[0] == 1.0


def test_a_late_report_is_inserted_at_its_own_time():
    ahead = [(1_000_000, 1.0, 0.0), (1_200_000, 4.0, 0.0), (1_300_000, 5.0, 0.0)]
    track = make_track(places=[*ahead, (1_100_000, 2.0, 0.0)], headings=STANDING)
    times = (1_050_000, 1_100_000, 1_150_000, 1_250_000, 1_300_000)
    assert [track.at(time_us).position_ned[0] for time_us in times] == pytest.approx([1.5, 2.0, 3.0, 4.5, 5.0])
    track.place(1_100_000, (3.0, 0.0, -2.0), (0.0, 0.0, 0.0))
    assert track.at(1_100_000).position_ned[0] == 3.0


def test_means_cover_only_the_last_seconds():
    track = make_track(places=[(k * 1_000_000, float(k), 0.0) for k in range(8)], headings=STANDING)
    assert track.mean_place(2.0) == pytest.approx((6.0, 0.0, -2.0))
    assert track.mean_range(2.0) is None
    track.range(1_000_000, 9.0)
    track.range(6_500_000, 1.0)
    assert track.mean_range(2.0) == 1.0


def north(track, time_us):
    sight = track.at(time_us)
    assert sight is not None
    return sight.position_ned[0]


def fly_straight(track, since_us, until_us, every_us=50_000):
    """Record a straight flight at 1 m/s."""
    for time_us in range(since_us, until_us + 1, every_us):
        track.place(time_us, (time_us / 1e6, 0.5, -2.25), (1.0, 0.0, 0.0))
        track.heading(time_us, 0.5, 0.0)
        track.tilt(time_us, 0.1, -0.2)


@pytest.mark.parametrize("more", [0, 1, DROPPED_AT_ONCE - 1, DROPPED_AT_ONCE, DROPPED_AT_ONCE + 1, 3 * DROPPED_AT_ONCE])
def test_reports_older_than_the_limit_are_dropped(more):
    track, every_us = PoseHistory(), 1_000_000
    end_us = KEPT_US + more * every_us
    fly_straight(track, 0, end_us, every_us)
    oldest_s = more * every_us / 1e6
    assert north(track, 0) == oldest_s
    assert north(track, more * every_us + every_us // 2) == oldest_s + 0.5
    track.place((more + 1) * every_us, (-7.0, 0.0, 0.0), (0.0, 0.0, 0.0))  # a report from before a clock restart
    assert north(track, end_us) == -7.0


def test_memory_use_is_bounded_in_a_long_flight():
    track, sizes = PoseHistory(), []
    tracemalloc.start()
    try:
        for k in range(4):
            fly_straight(track, k * KEPT_US + 1, (k + 1) * KEPT_US)
            sizes.append(tracemalloc.get_traced_memory()[0])
    finally:
        tracemalloc.stop()
    assert sizes[0] < 1.5e6  # 7500 reports of 13 numbers: 0.8 MB, plus spare array capacity
    assert sizes[-1] < 1.15 * sizes[1]
