"""Ground contact: rest, falls, slopes, cliffs and tipping over."""

import numpy as np
import pytest

from foundation.errors import UsageError
from foundation.frames import GRAVITY, quat_from_euler, quat_to_euler, rotate
from foundation.terrain import HeightField
from tests.vehicles.fleet import ORIGIN, spin, vehicle
from vehicles import ground
from vehicles.airframe import load, names
from vehicles.multirotor import Multirotor, parameters
from vehicles.wind import Wind

NODES = np.arange(-20.0, 21.0)


def slope(grade: float) -> HeightField:
    """Return ground that rises by `grade` to the north."""
    return HeightField(-20.0, -20.0, 1.0, np.repeat(-grade * NODES[:, None], NODES.size, axis=1))


@pytest.mark.parametrize("name", names())
def test_a_vehicle_at_rest_does_not_move_and_measures_gravity(name: str) -> None:
    craft = vehicle(name, yaw=0.7)
    start = craft.state["position"].copy()
    craft.advance(10_000)
    assert craft.truth["position_ned"] == pytest.approx(start, abs=1e-9)
    assert craft.truth["velocity_ned"] == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
    assert craft.truth["rates_frd"] == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
    assert craft.truth["accel_frd"] == pytest.approx((0.0, 0.0, -GRAVITY), abs=1e-6)
    assert craft.state["on_ground"] == 1
    assert craft.state["crashed"] == 0


@pytest.mark.parametrize("name", names())
def test_a_vehicle_at_rest_does_not_move_in_wind_with_idling_rotors(name: str) -> None:
    craft = vehicle(name, wind=Wind(mean_ned=(1.0, 0.5, 0.0)))
    craft.actuators["armed"] = 1
    craft.advance(3000)
    there = craft.state["position"].copy()
    craft.advance(10_000)
    assert craft.truth["position_ned"] == pytest.approx(there, abs=1e-4)
    assert quat_to_euler(tuple(craft.truth["attitude"])) == pytest.approx((0.0, 0.0, 0.0), abs=0.01)


@pytest.mark.parametrize("name", names())
@pytest.mark.parametrize("height", [0.05, 0.5, 5.0, 30.0])
def test_a_drop_ends_at_rest(name: str, height: float) -> None:
    craft = vehicle(name)
    craft.state["position"][2] -= height
    craft.state["attitude"] = quat_from_euler(0.2, -0.1, 0.4)
    fastest = 0.0
    for _ in range(80):
        craft.advance(100)
        fastest = max(fastest, float(np.linalg.norm(craft.truth["velocity_ned"])))
    assert fastest <= np.sqrt(2.0 * GRAVITY * (height + 0.3)) + 0.1  # the ground adds no energy
    assert np.linalg.norm(craft.truth["velocity_ned"]) < 1e-3
    assert np.linalg.norm(craft.truth["accel_frd"]) == pytest.approx(GRAVITY, abs=1e-2)
    assert np.linalg.norm(craft.truth["attitude"]) == pytest.approx(1.0, abs=1e-12)
    if height >= 5.0:
        assert craft.state["crashed"] == 1
    if height <= 0.05:
        assert craft.state["crashed"] == 0


@pytest.mark.parametrize("name", names())
def test_a_tumbling_impact_adds_no_energy(name: str) -> None:
    craft = vehicle(name, position_ned=(0.0, 0.0, -2.0))
    craft.state["rates"] = (25.0, -18.0, 9.0)
    craft.state["velocity"] = (6.0, 3.0, 8.0)
    before = 0.5 * craft.airframe.mass_kg * 109.0 + craft.airframe.mass_kg * GRAVITY * 2.0
    before += 0.5 * float(np.sum(craft.params["inertia"] * craft.state["rates"] ** 2))
    for _ in range(200):
        craft.advance(20)
        energy = 0.5 * craft.airframe.mass_kg * float(np.sum(craft.state["velocity"] ** 2))
        energy += 0.5 * float(np.sum(craft.params["inertia"] * craft.state["rates"] ** 2))
        assert energy < before
    assert craft.state["crashed"] == 1
    assert np.linalg.norm(craft.truth["velocity_ned"]) < 0.5


@pytest.mark.parametrize("yaw", [0.0, 0.7, 2.0])
def test_a_vehicle_placed_on_a_slope_is_not_thrown_off(yaw: float) -> None:
    craft = vehicle(terrain=slope(0.25), yaw=yaw)
    fastest = 0.0
    for _ in range(300):
        craft.advance(1)
        fastest = max(fastest, float(-craft.truth["velocity_ned"][2]))
    assert fastest < 0.4  # m/s upwards: it falls a few centimetres and settles without a jump


def test_a_vehicle_holds_on_a_gentle_slope_and_slides_on_a_steep_one() -> None:
    def slid(grade: float) -> float:
        craft = vehicle(terrain=slope(grade))
        craft.state["attitude"] = quat_from_euler(0.0, np.arctan(grade), 0.0)
        craft.advance(500)
        there = craft.state["position"][0]
        craft.advance(1500)
        return float(there - craft.state["position"][0])

    assert abs(slid(0.3)) < 1e-3
    assert slid(0.9) > 0.5  # downhill is south


def test_a_strong_push_tips_the_vehicle_over() -> None:
    craft = vehicle()
    weight = craft.airframe.mass_kg * GRAVITY
    craft.state["external_torque"] = (1.3 * weight * 0.15, 0.0, 0.0)  # more than the weight on the right feet's lever
    craft.advance(1500)
    craft.state["external_torque"] = 0.0
    craft.advance(3000)
    assert abs(quat_to_euler(tuple(craft.truth["attitude"]))[0]) > 1.0


def test_a_gentle_push_does_not_tip_the_vehicle_over() -> None:
    craft = vehicle()
    weight = craft.airframe.mass_kg * GRAVITY
    craft.state["external_torque"] = (0.7 * weight * 0.15, 0.0, 0.0)
    craft.advance(1500)
    assert abs(quat_to_euler(tuple(craft.truth["attitude"]))[0]) < 0.1


def test_an_upside_down_vehicle_is_detected() -> None:
    craft = vehicle(position_ned=(0.0, 0.0, -1.0))
    craft.state["attitude"] = quat_from_euler(np.pi, 0.0, 0.0)
    craft.advance(3000)
    assert craft.state["upside_down"] == 1
    assert craft.state["crashed"] == 1
    down = rotate(tuple(craft.truth["attitude"]), (0.0, 0.0, 1.0))
    assert down[2] < 0.0


def test_the_compiled_surface_equals_the_height_field() -> None:
    rng = np.random.default_rng(3)
    terrain = HeightField(-7.0, 5.0, 2.5, rng.normal(size=(6, 9)))
    record = parameters(load("x500"), terrain)
    for north, east in rng.uniform(-30.0, 40.0, (200, 2)):
        assert ground.surface(record, terrain.down, north, east)[0] == pytest.approx(terrain.at(north, east), abs=1e-12)


def test_a_vehicle_stands_on_a_plateau_and_rebounds_from_its_cliff() -> None:
    down = np.zeros((41, 41))
    down[25:, :] = -8.0  # a cliff to the north, from 4 to 5 m
    craft = vehicle(terrain=HeightField(-20.0, -20.0, 1.0, down), position_ned=(10.0, 0.0, 0.0))
    assert craft.state["position"][2] == pytest.approx(-8.21, abs=1e-2)
    craft = vehicle(terrain=HeightField(-20.0, -20.0, 1.0, down), position_ned=(2.0, 0.0, -4.0))
    craft.state["velocity"] = (4.0, 0.0, 0.0)
    craft.advance(700)
    assert craft.state["position"][2] < -1.0  # still in the air
    assert craft.state["crashed"] == 1
    assert craft.state["velocity"][0] < 0.0
    assert craft.state["position"][0] < 4.6


def test_a_sliding_landing_on_the_feet_is_no_crash() -> None:
    craft = vehicle(position_ned=(0.0, 0.0, -0.25))
    craft.state["velocity"] = (1.0, 0.0, 1.0)
    craft.advance(3000)
    assert craft.state["crashed"] == 0
    assert craft.state["position"][0] < 0.5


def test_full_thrust_leaves_the_ground() -> None:
    craft = vehicle()
    spin(craft, 0.9 * craft.airframe.curve.speed_max)
    craft.advance(1000)
    assert craft.state["on_ground"] == 0
    assert craft.state["height"] > 0.5


def test_a_nan_pose_is_rejected() -> None:
    with pytest.raises(UsageError, match="finite"):
        Multirotor(load("x500"), seed=1, origin=ORIGIN, position_ned=(float("nan"), 0.0, 0.0))
