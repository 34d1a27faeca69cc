"""Modes that follow a target, orbit a place, or return to the nearest safe place."""

import math

import pytest

from foundation.frames import ned_to_geodetic, wrap_pi
from foundation.mavlink import dialect
from tests.autopilot.commander_bench import ORIGIN, Bench, put
from tests.autopilot.plan_client import item, upload

ORBIT = dialect.MAV_CMD_DO_ORBIT


def place(bench: Bench) -> tuple[float, float]:
    n, e, _ = (float(x) for x in bench.core.estimate["position_ned"])
    return n, e


class Walker:
    """A walking target that sends its position once a second."""

    def __init__(self, bench: Bench, north: float, east: float, *, vn: float = 0.0, ve: float = 0.0) -> None:
        self.bench, self.north, self.east, self.vn, self.ve = bench, north, east, vn, ve
        self._told = -10_000_000
        self._since = bench.time_us

    @property
    def now(self) -> tuple[float, float]:
        t = (self.bench.time_us - self._since) * 1e-6
        return self.north + self.vn * t, self.east + self.ve * t

    def __call__(self) -> None:
        if self.bench.time_us - self._told < 1_000_000:
            return
        self._told = self.bench.time_us
        lat, lon, alt = ned_to_geodetic(*ORIGIN, *self.now, 0.0)
        self.bench.client.send(
            dialect.MAVLink_follow_target_message(
                0, 3, round(lat * 1e7), round(lon * 1e7), alt, [self.vn, self.ve, 0.0], [0] * 3, [1, 0, 0, 0],
                [0] * 3, [0] * 3, 0,
            )
        )  # fmt: skip


@pytest.mark.parametrize(("angle", "behind"), [(180.0, -1.0), (0.0, 1.0)])
def test_follow_keeps_its_position_relative_to_a_walking_target(bench: Bench, angle: float, behind: float) -> None:
    put(bench, FLW_TGT_DST=6, FLW_TGT_HT=9, FLW_TGT_FA=angle)
    bench.fly()
    assert bench.client.mode(4, 8) == 0
    bench.run(2.0)
    assert math.hypot(*place(bench)) < 0.3  # no target yet: the vehicle waits
    walker = Walker(bench, 10.0, 0.0, ve=1.5)
    bench.run(25.0, walker)
    n, e = (a - b for a, b in zip(place(bench), walker.now, strict=True))
    assert n == pytest.approx(0.0, abs=0.7)
    assert e == pytest.approx(6.0 * behind, abs=1.2)
    assert bench.height == pytest.approx(9.0, abs=0.3)
    to_target = math.atan2(-e, -n)
    assert abs(wrap_pi(bench.autopilot.state.yaw - to_target)) < math.radians(10.0)
    stopped = place(bench)
    bench.run(8.0)  # the target stops sending
    assert math.dist(place(bench), stopped) < 8.0
    still = place(bench)
    bench.run(3.0)
    assert math.dist(place(bench), still) < 0.2
    assert bench.commander.mode == "FOLLOW"


def test_follow_respects_its_maximum_speed(bench: Bench) -> None:
    put(bench, FLW_TGT_MAX_VEL=3)
    bench.fly()
    assert bench.client.mode(4, 8) == 0
    walker = Walker(bench, 60.0, 0.0)
    fastest = 0.0
    for _ in range(60):
        bench.run(0.1, walker)
        fastest = max(fastest, math.hypot(*bench.velocity[:2]))
    assert 2.5 < fastest < 3.3


def test_a_target_with_invalid_coordinates_is_ignored(bench: Bench) -> None:
    bench.fly()
    for lat in (2_000_000_000, -2_000_000_000):
        bench.client.send(
            dialect.MAVLink_follow_target_message(
                0, 1, lat, 0, math.nan, [math.nan] * 3, [0] * 3, [0] * 4, [0] * 3, [0] * 3, 0
            )
        )
    assert bench.commander.flight.target.time_us < 0


@pytest.mark.parametrize(("radius", "way"), [(12.0, 1.0), (-12.0, -1.0)])
def test_orbit_direction_radius_and_speed(bench: Bench, radius: float, way: float) -> None:
    bench.fly(8.0)
    assert bench.client.command(ORBIT, radius, 3.0, 0, math.nan, math.nan, math.nan, math.nan) == 0
    bench.run(15.0)
    n, e = place(bench)
    assert math.hypot(n, e) == pytest.approx(12.0, abs=1.0)
    v = bench.velocity
    assert math.hypot(v[0], v[1]) == pytest.approx(3.0, abs=0.4)
    assert math.copysign(1.0, n * v[1] - e * v[0]) == way  # seen from above, positive radius is clockwise
    assert abs(wrap_pi(bench.autopilot.state.yaw - math.atan2(-e, -n))) < 0.3
    assert bench.commander.mode == "ORBIT"


@pytest.mark.parametrize(("behaviour", "offset"), [(1, None), (3, -math.pi / 2)])
def test_orbit_yaw_behaviours(bench: Bench, behaviour: int, offset: float | None) -> None:
    bench.fly(8.0)
    before = bench.autopilot.state.yaw
    assert bench.client.command(ORBIT, 10.0, 2.0, behaviour, math.nan, math.nan, math.nan, math.nan) == 0
    bench.run(15.0)
    yaw, (n, e) = bench.autopilot.state.yaw, place(bench)
    wanted = before if offset is None else math.atan2(-e, -n) + offset
    assert abs(wrap_pi(yaw - wanted)) < 0.3
    if offset is not None:
        assert abs(wrap_pi(yaw - math.atan2(bench.velocity[1], bench.velocity[0]))) < 0.4


def test_an_orbit_too_tight_for_its_speed_is_flown_slower(bench: Bench) -> None:
    bench.fly(8.0)
    assert bench.client.command(ORBIT, 4.0, 9.0, 0, math.nan, math.nan, math.nan, math.nan) == 0
    assert bench.commander.orbit.speed == pytest.approx(math.sqrt(2.0 * 4.0))
    assert bench.client.command(ORBIT, 5000.0, 2.0) == dialect.MAV_RESULT_DENIED


def test_sticks_change_the_orbit_radius(bench: Bench) -> None:
    bench.fly(8.0)
    bench.client.command(ORBIT, 10.0, 2.0, 0, math.nan, math.nan, math.nan, math.nan)

    def pull() -> None:
        bench.client.send(dialect.MAVLink_manual_control_message(1, -1000, 0, 500, 0, 0))

    bench.run(3.0, pull)
    assert bench.commander.mode == "ORBIT"
    assert bench.commander.orbit.radius == pytest.approx(16.0, abs=1.0)


def test_return_lands_at_the_nearest_safe_place(bench: Bench) -> None:
    put(bench, RTL_RETURN_ALT=10)
    rally = [item(0, 5100, north=60.0, east=5.0, z=0.0, kind=2), item(1, 5100, north=300.0, z=0.0, kind=2)]
    assert upload(bench.client, rally, 2) == 0
    bench.fly()
    bench.core.estimate["position_ned"][0] = 45.0
    bench.tick()
    assert bench.client.command(dialect.MAV_CMD_NAV_RETURN_TO_LAUNCH) == 0
    bench.until(lambda: not bench.commander.armed, 60)
    assert place(bench) == pytest.approx((60.0, 5.0), abs=1.0)


def test_return_waits_before_it_lands(bench: Bench) -> None:
    put(bench, RTL_RETURN_ALT=12, RTL_DESCEND_ALT=6, RTL_LAND_DELAY=5)
    bench.fly()
    bench.core.estimate["position_ned"][0] = 30.0
    bench.tick()
    bench.client.command(dialect.MAV_CMD_NAV_RETURN_TO_LAUNCH)
    bench.until(lambda: abs(place(bench)[0]) < 1.0, 40)
    bench.until(lambda: bench.height < 7.0, 10)
    bench.run(4.5)
    assert bench.height == pytest.approx(6.0, abs=0.4)
    bench.until(lambda: not bench.commander.armed, 30)
