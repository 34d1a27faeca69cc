"""A vehicle that follows its setpoints with a lag stays inside the envelope, for any destination."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from foundation.errors import LinkError
from foundation.polygon import contains
from hil.link.envelope import Limits, _edge, _nearest_velocity, admit, crosses, unwatched, with_local_exclusions
from hil.link.offboard import PositionSetpoint, VelocitySetpoint
from hil.link.telemetry import VehicleState

HOME = (10.0, -20.0, 1.0)
SQUARE = ((3.0, -2.0), (3.0, 2.0), (7.0, 2.0), (7.0, -2.0))
NOOK = ((4.0, -4.0), (8.0, -4.0), (8.0, 4.0), (4.0, 4.0), (4.0, 2.0), (6.0, 2.0), (6.0, -2.0), (4.0, -2.0))  # concave
LAG_S, STEP_S = 0.5, 0.05
speeds = st.floats(-3.0, 3.0)


def state(at, yaw=0.0, **others):
    place = tuple(a + h for a, h in zip(at, HOME, strict=True))
    return VehicleState(position_ned=place, velocity_ned=(0, 0, 0), euler=(0, 0, yaw), **others)


def fly(target, limits, seconds=60.0, yaw=0.0, at=(0.0, 0.0, -2.5)):
    """Return the path (relative to home) of a point whose velocity follows with a first-order lag."""
    velocity, path = [0.0, 0.0, 0.0], [at]
    for _ in range(round(seconds / STEP_S)):
        admitted = admit(target, state(path[-1], yaw), HOME, limits, 0).setpoint
        if isinstance(admitted, PositionSetpoint):
            wanted = [p - h - a for p, h, a in zip(admitted.position_ned, HOME, path[-1], strict=True)]
        else:
            f, r, d = admitted.velocity_body
            wanted = [math.cos(yaw) * f - math.sin(yaw) * r, math.sin(yaw) * f + math.cos(yaw) * r, d]
        velocity = [v + (w - v) * STEP_S / LAG_S for v, w in zip(velocity, wanted, strict=True)]
        path.append(tuple(p + v * STEP_S for p, v in zip(path[-1], velocity, strict=True)))
    return path


@settings(max_examples=40)
@given(speeds, speeds, speeds, st.floats(-3.1, 3.1))
def test_no_velocity_setpoint_leaves_the_radius_and_height_limits(forward, right, down, yaw):
    limits = Limits(ceiling_m=6.0, floor_m=0.7, radius_m=8.0)
    path = fly(VelocitySetpoint((forward, right, down), 0.0), limits, 30.0, yaw)
    assert all(math.hypot(n, e) <= 8.0 for n, e, _ in path)
    assert all(0.7 <= -d <= 6.0 for _, _, d in path)


@pytest.mark.parametrize("polygon", [SQUARE, NOOK])
@settings(max_examples=40)
@given(speeds, speeds)
def test_no_velocity_setpoint_enters_an_exclusion_zone(polygon, forward, right):
    path = fly(VelocitySetpoint((forward, right, 0.0), 0.0), Limits(exclusions=(polygon,)), 20.0)
    assert not any(contains(polygon, (n, e)) for n, e, _ in path)


@pytest.mark.parametrize("fence_north", [20.0, 40.0, 44.0, 47.0])
def test_no_limit_is_crossed_where_a_fence_meets_the_radius_at_a_sharp_angle(fence_north):
    fence = tuple((fence_north - thick, east) for thick, east in ((0, -60.0), (0, 60.0), (3, 60.0), (3, -60.0)))
    limits = Limits(radius_m=50.0, exclusions=(fence,))
    path = fly(VelocitySetpoint((1.2, 0.0, 0.0), 0.0), limits, 90.0, math.pi / 2, at=(fence_north + 2.0, 0.0, -2.5))
    assert all(math.hypot(n, e) <= 50.0 and not contains(fence, (n, e)) for n, e, _ in path)


@pytest.mark.parametrize("half_angle_deg", [5.0, 10.0, 30.0])
def test_no_exclusion_is_entered_in_a_gap_that_narrows_to_a_point(half_angle_deg):
    cosine, sine = math.cos(math.radians(half_angle_deg)), math.sin(math.radians(half_angle_deg))
    left = ((14.0, 0.0), (14.0 - 13.0 * cosine, -13.0 * sine), (14.0 - 13.0 * cosine, -13.0 * sine - 4.0), (17.0, -4.0))
    zones = left, tuple((n, -e) for n, e in left)
    path = fly(VelocitySetpoint((1.2, 0.0, 0.0), 0.0), Limits(exclusions=zones), 60.0)
    assert not any(contains(zone, (n, e)) for zone in zones for n, e, _ in path)


@settings(max_examples=100)
@given(
    st.lists(st.tuples(st.floats(-3.1, 3.1), st.floats(-0.5, 2.0)), max_size=4), st.floats(-3.1, 3.1), st.floats(0, 1)
)
def test_the_admitted_velocity_is_the_nearest_that_all_limits_allow(walls, course, share):
    """Compared with a search of a grid."""
    speed = 1.5
    wish = speed * share * math.cos(course), speed * share * math.sin(course)
    bounds = [((math.cos(angle), math.sin(angle)), allowed) for angle, allowed in walls]
    found = _nearest_velocity(wish, bounds, speed)
    axis = np.linspace(-speed, speed, 61)
    north, east = (grid.ravel() for grid in np.meshgrid(axis, axis))
    allowed = np.hypot(north, east) <= speed
    for (n, e), most in bounds:
        allowed &= n * north + e * east <= most
    if allowed.any():
        assert math.hypot(*found) <= speed + 1e-4
        assert all(n * found[0] + e * found[1] <= most + 1e-4 for (n, e), most in bounds)
        nearest = np.hypot(north - wish[0], east - wish[1])[allowed].min()
        assert math.dist(found, wish) <= nearest + 1e-4


@settings(max_examples=40)
@given(st.floats(-30, 30), st.floats(-30, 30), st.floats(-30, 30))
def test_no_position_setpoint_leaves_the_envelope(north, east, down):
    limits = Limits(ceiling_m=6.0, radius_m=9.0, exclusions=(SQUARE,))
    place = tuple(a + h for a, h in zip((north, east, down), HOME, strict=True))
    path = fly(PositionSetpoint(place, 0.0), limits, 30.0)
    assert all(math.hypot(n, e) <= 9.0 for n, e, _ in path)
    assert all(-d <= 6.0 for _, _, d in path)
    assert not any(contains(SQUARE, (n, e)) for n, e, _ in path)


def test_setpoints_inside_the_envelope_pass_unchanged():
    for target in (VelocitySetpoint((1.2, 0.0, -0.3), 1.0), PositionSetpoint((11.0, -20.0, -1.5), 0.4)):
        admitted = admit(target, state((0.0, 0.0, -2.5)), HOME, Limits(), 0)
        assert admitted.setpoint is target
        assert admitted.limited == ()


def test_a_vehicle_beyond_the_radius_flies_back():
    path = fly(VelocitySetpoint((0.0, 0.0, 0.0), 0.0), Limits(radius_m=8.0), at=(10.0, 0.0, -2.5))
    assert path[-1][0] <= 8.0


@pytest.mark.parametrize("held_north", [1.9, 5.0, 8.1])
def test_a_holding_vehicle_inside_an_exclusion_zone_leaves_over_the_nearest_edge(held_north):
    target = PositionSetpoint((held_north + HOME[0], HOME[1], -2.5 + HOME[2]), 0.0)
    for at_north, nearest_north in ((3.2, 3.0), (6.8, 7.0)):
        path = fly(target, Limits(exclusions=(SQUARE,)), 10.0, at=(at_north, 0.0, -2.5))
        left = next((place for place in path if not contains(SQUARE, place[:2])), None)
        assert left == pytest.approx((nearest_north, 0.0, -2.5), abs=0.05)
        assert not contains(SQUARE, path[-1][:2])


def test_the_setpoint_that_leaves_an_exclusion_zone_is_reported():
    target = PositionSetpoint((1.9 + HOME[0], HOME[1], -2.5 + HOME[2]), 0.0)
    admitted = admit(target, state((3.2, 0.0, -2.5)), HOME, Limits(exclusions=(SQUARE,)), 0)
    assert isinstance(admitted.setpoint, VelocitySetpoint)
    assert admitted.setpoint.velocity_body == pytest.approx((-0.5, 0.0, 0.0))
    assert admitted.limited == ("exclusion",)


def test_speed_climb_and_yaw_rate_are_clamped_and_reported():
    limits = Limits(speed=1.0, climb=0.5, yaw_rate=0.5)
    admitted = admit(VelocitySetpoint((3.0, 4.0, -2.0), -2.0), state((0, 0, -5.0)), HOME, limits, 0)
    assert isinstance(admitted.setpoint, VelocitySetpoint)
    assert math.hypot(*admitted.setpoint.velocity_body[:2]) == pytest.approx(1.0)
    assert admitted.setpoint.velocity_body[1] / admitted.setpoint.velocity_body[0] == pytest.approx(4 / 3)
    assert admitted.setpoint.velocity_body[2] == -0.5
    assert admitted.setpoint.yaw_rate == -0.5
    assert admitted.limited == ("speed", "climb", "yaw rate")


def test_the_turn_to_the_heading_of_a_place_is_limited_to_the_yaw_rate():
    limits, vehicle_state = Limits(yaw_rate=0.3), state((0.0, 0.0, -2.5))
    for degrees, rate in ((120.0, 0.3), (-120.0, -0.3)):
        place = PositionSetpoint((HOME[0], HOME[1], HOME[2] - 2.5), math.radians(degrees))
        admitted = admit(place, vehicle_state, HOME, limits, 0)
        assert isinstance(admitted.setpoint, VelocitySetpoint)
        assert admitted.setpoint.velocity_body == pytest.approx((0.0, 0.0, 0.0))
        assert admitted.setpoint.yaw_rate == rate
        assert admitted.limited == ("yaw rate",)


def test_a_stale_pose_and_a_lost_heartbeat_stop_the_vehicle():
    target = VelocitySetpoint((1.0, 0.0, 0.0), 0.0)
    stale = state((0, 0, -2.5), position_us=1_000_000, attitude_us=1_000_000, heartbeat_us=5_000_000)
    assert admit(target, stale, HOME, Limits(), 2_000_000).limited == ("stale position",)
    assert admit(target, stale, HOME, Limits(), 2_000_000, behind_us=600_000).limited == ()  # all data is late
    assert admit(target, stale, HOME, Limits(), 2_200_000, behind_us=600_000).limited == ("stale position",)
    turned = state((0, 0, -2.5), position_us=2_000_000, attitude_us=1_000_000, heartbeat_us=5_000_000)
    admitted = admit(target, turned, HOME, Limits(), 2_000_000)
    assert admitted.limited == ("stale attitude",)
    assert admitted.setpoint == VelocitySetpoint((0.0, 0.0, 0.0), 0.0)
    assert admit(target, turned, HOME, Limits(), 2_000_000, behind_us=600_000).limited == ()
    lost = state((0, 0, -2.5), position_us=9_000_000, attitude_us=9_000_000, heartbeat_us=5_000_000)
    admitted = admit(target, lost, HOME, Limits(), 9_000_000)
    assert admitted.limited == ("lost heartbeat",)
    assert admitted.setpoint == VelocitySetpoint((0.0, 0.0, 0.0), 0.0)


def test_geodetic_exclusions_are_converted_to_metres_from_home():
    limits = Limits(exclusions_geodetic=(((47.0, 8.0), (47.0, 8.001), (47.001, 8.0)),))
    with pytest.raises(LinkError, match="no origin"):
        with_local_exclusions(limits, VehicleState())
    vehicle_state = VehicleState(origin=(47.0, 8.0, 400.0), home_ned=(10.0, 0.0, 0.0))
    corners = with_local_exclusions(limits, vehicle_state).exclusions[0]
    assert corners[0] == pytest.approx((-10.0, 0.0), abs=0.01)
    assert corners[1] == pytest.approx((-10.0, 76.0), abs=0.3)
    assert corners[2] == pytest.approx((101.2, 0.0), abs=0.3)


def test_crosses_detects_a_path_through_a_polygon():
    assert crosses((0.0, 0.0), (10.0, 0.0), SQUARE)
    assert not crosses((0.0, 5.0), (10.0, 5.0), SQUARE)


@pytest.mark.parametrize("corner", [(4.0, 0.0), (6.0, 0.0)])
def test_a_path_through_a_corner_crosses_the_polygon(corner):
    diamond = ((4.0, 0.0), (5.0, 1.0), (6.0, 0.0), (5.0, -1.0))
    assert crosses((0.0, 0.0), (10.0, 0.0), diamond)
    assert crosses((corner[0], -3.0), (corner[0], 3.0), diamond)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_setpoint_with_nan_or_infinity_stops_the_vehicle(bad):
    for target in (
        VelocitySetpoint((bad, 0.0, 0.0), 0.0),
        VelocitySetpoint((0.0, 0.0, 0.0), bad),
        PositionSetpoint((0.0, bad, -2.0), 0.0),
        PositionSetpoint((0.0, 0.0, -2.0), bad),
    ):
        admitted = admit(target, state((0.0, 0.0, -2.5)), HOME, Limits(), 0)
        assert admitted.limited == ("not a number",)
        assert admitted.setpoint == VelocitySetpoint((0.0, 0.0, 0.0), 0.0)


@settings(max_examples=40)
@given(st.floats(-20, 20), st.floats(-20, 20), st.floats(-20, -2))
def test_no_position_setpoint_exceeds_the_speed_limits(north, east, down):
    limits = Limits(speed=1.5, climb=1.2, ceiling_m=30.0)
    place = tuple(a + h for a, h in zip((north, east, down), HOME, strict=True))
    path = fly(PositionSetpoint(place, 0.0), limits, 20.0)  # like PX4: 1 m/s per metre of position error
    for a, b in itertools.pairwise(path):
        assert math.dist(a[:2], b[:2]) / STEP_S <= 1.5 * 1.02
        assert abs(b[2] - a[2]) / STEP_S <= 1.2 * 1.02


@pytest.mark.parametrize(
    ("least", "remaining", "expected"), [(0.3, None, "battery_min = 0.3"), (0.3, 0.2, None), (None, None, None)]
)
def test_a_battery_without_a_level_is_reported_as_unwatched(least, remaining, expected):
    warning = unwatched(state((0, 0, -2), battery_remaining=remaining), Limits(battery_min=least))
    assert warning is None if expected is None else (warning or "").startswith(expected)


@settings(max_examples=200)
@given(*[st.floats(-10.0, 14.0)] * 4, st.sampled_from([SQUARE, NOOK]))
def test_no_position_setpoint_leads_into_the_margin_of_an_exclusion_zone(at_n, at_e, to_n, to_e, polygon):
    """A vehicle outside the margin stays outside. A vehicle inside the margin does not come nearer to the zone."""

    def room(place):
        corners = zip(polygon, (*polygon[1:], polygon[0]), strict=True)
        return -1.0 if contains(polygon, place) else min(_edge(place, a, b)[1] for a, b in corners)

    limits = Limits(exclusions=(polygon,), speed=100.0, climb=100.0)
    wanted = PositionSetpoint((to_n + HOME[0], to_e + HOME[1], -2.5 + HOME[2]), 0.0)
    got = admit(wanted, state((at_n, at_e, -2.5)), HOME, limits, 0)
    assume(room((at_n, at_e)) > 0.0)
    assert isinstance(got.setpoint, PositionSetpoint)
    to = got.setpoint.position_ned[0] - HOME[0], got.setpoint.position_ned[1] - HOME[1]
    least = min(limits.margin_m, room((at_n, at_e))) - 0.01
    for share in (0.1, 0.3, 0.5, 0.7, 0.9, 1.0):
        way = tuple(a + share * (b - a) for a, b in zip((at_n, at_e), to, strict=True))
        assert room(way) >= least
