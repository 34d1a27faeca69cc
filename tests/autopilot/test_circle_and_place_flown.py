"""Flies DO_ORBIT and DO_REPOSITION to the end with simulated physics, and compares them with the truth."""

import math

import numpy as np
import pytest

from foundation.frames import ned_to_geodetic, quat_yaw, wrap_pi
from foundation.mavlink import dialect
from tests.autopilot.aircraft import Aircraft
from tests.autopilot.commander_bench import ORIGIN

NORTH, EAST, HEIGHT = 25.0, -10.0, 14.0  # m, of the circle's centre


@pytest.fixture(scope="module")
def craft() -> Aircraft:
    """A vehicle that hovers 6 m above its home."""
    craft = Aircraft("x500", seed=7)
    craft.take_off(6.0)
    return craft


def order(craft: Aircraft, command: int, p: tuple[float, ...], north: float, east: float, height: float) -> int | None:
    """Send a COMMAND_INT with a position: north, east and height in metres from the origin."""
    lat, lon, alt = ned_to_geodetic(*ORIGIN, north, east, -height)
    return craft.client.command_int(command, p, round(lat * 1e7), round(lon * 1e7), alt)


def heading(craft: Aircraft) -> float:
    w, x, y, z = (float(q) for q in craft.truth["attitude"])
    return quat_yaw((w, x, y, z))


def circle_through(places: np.ndarray) -> tuple[float, float, float]:
    """Return north and east (m) of the centre and the radius (m) of the circle that fits best."""
    coefficients = np.c_[2.0 * places[:, :2], np.ones(len(places))]
    n, e, rest = np.linalg.lstsq(coefficients, (places[:, :2] ** 2).sum(axis=1), rcond=None)[0]
    return float(n), float(e), math.sqrt(rest + n * n + e * e)


@pytest.mark.parametrize(("radius", "speed"), [(12.0, 3.0), (-12.0, 3.0), (8.0, 4.0)])
def test_do_orbit_flies_a_full_circle(craft: Aircraft, radius: float, speed: float) -> None:
    assert order(craft, dialect.MAV_CMD_DO_ORBIT, (radius, speed, 0, math.nan), NORTH, EAST, HEIGHT) == 0
    craft.run(25.0)
    places, speeds, headings = [], [], []
    for _ in range(round(22.0 * math.pi * abs(radius) / speed)):  # 1.1 circles
        craft.run(0.1)
        places.append(craft.truth["position_ned"].copy())
        speeds.append(math.hypot(*craft.truth["velocity_ned"][:2]))
        headings.append(heading(craft))
    track = np.array(places)
    n, e, r = circle_through(track)
    assert (n, e) == pytest.approx((NORTH, EAST), abs=1.5)  # the GNSS receiver's error
    assert r == pytest.approx(abs(radius), abs=0.25)
    assert np.hypot(track[:, 0] - n, track[:, 1] - e) == pytest.approx(np.full(len(track), r), abs=0.3)
    assert speeds == pytest.approx([speed] * len(speeds), rel=0.07)
    assert -track[:, 2] == pytest.approx(np.full(len(track), HEIGHT), abs=1.5)
    angles = np.arctan2(track[:, 1] - e, track[:, 0] - n)
    turned = np.unwrap(angles)[-1] - angles[0]
    assert turned == pytest.approx(math.copysign(2.2 * math.pi, radius), rel=0.1)  # positive: clockwise
    assert max(abs(wrap_pi(a + math.pi - h)) for a, h in zip(angles, headings, strict=True)) < math.radians(10.0)
    assert craft.commander.mode == "ORBIT"
    assert craft.client.of("ORBIT_EXECUTION_STATUS")[-1].radius == pytest.approx(radius)


@pytest.mark.parametrize(
    ("north", "east", "height", "yaw", "speed"), [(-20.0, 15.0, 9.0, 2.0, 4.0), (5.0, 0.0, 5.0, math.nan, -1.0)]
)
def test_do_reposition_reaches_and_holds_the_position(
    craft: Aircraft, north: float, east: float, height: float, yaw: float, speed: float
) -> None:
    kept = heading(craft)
    fastest = 0.0
    assert order(craft, dialect.MAV_CMD_DO_REPOSITION, (speed, 1, 0, yaw), north, east, height) == 0
    for _ in range(300):
        craft.run(0.1)
        fastest = max(fastest, math.hypot(*craft.truth["velocity_ned"][:2]))
        if math.dist(craft.truth["position_ned"], (north, east, -height)) < 1.5:
            break
    craft.run(5.0)
    assert craft.truth["position_ned"] == pytest.approx((north, east, -height), abs=1.5)  # the GNSS receiver's error
    assert math.hypot(*craft.truth["velocity_ned"]) < 0.3
    assert abs(wrap_pi(heading(craft) - (kept if math.isnan(yaw) else yaw))) < math.radians(5.0)
    limit = speed if speed > 0.0 else craft.autopilot.parameters["MPC_XY_CRUISE"]
    assert 0.8 * limit < fastest < limit + 0.6
    assert craft.commander.mode == "HOLD"
