"""Collisions of a vehicle with walls, posts, roofs, moving boxes and meshes."""

from dataclasses import replace

import numpy as np
import pytest

from episodes.world.obstacles import sorted_into_cells
from foundation.errors import UsageError
from foundation.frames import GRAVITY, quat_from_euler, quat_integrate, quat_to_euler, rotate
from foundation.terrain import OPEN, MovingBox, Obstacles
from tests.vehicles.fleet import spin, vehicle
from vehicles.airframe import names
from vehicles.collision import BOX, REBOUND_SPEED
from vehicles.faults import Fault
from vehicles.multirotor import Multirotor
from vehicles.sensors import PERFECT
from vehicles.solids import in_box, in_triangle

CAMERA = (0.5, 0.0, 0.1)
CORNERS = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
FACES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))


def block(centre: tuple[float, float, float], half: tuple[float, float, float]) -> np.ndarray:
    """Return the (12, 3, 3) triangles of a box. Their normals point outward."""
    corners = CORNERS * half + centre
    return np.array(
        [[corners[f[a]], corners[f[b]], corners[f[c]]] for f in FACES for a, b, c in ((0, 1, 2), (0, 2, 3))]
    )


def solid(*blocks: np.ndarray, moving: MovingBox | None = None) -> Obstacles:
    owner = np.repeat(np.arange(len(blocks), dtype=np.int32), [len(b) for b in blocks])
    names = tuple(f"block-{k}" for k in range(len(blocks)))
    return replace(sorted_into_cells(np.concatenate(blocks), owner, names, 0.7), moving=moving)


WALL = solid(block((6.0, 0.0, -4.0), (1.0, 8.0, 5.0)))  # its face is at 5 m north
CAR = MovingBox("car", (2.0, 0.9, 0.8), (0.0, 0.0, -0.8))


def ram(craft: Multirotor, velocity: tuple[float, float, float], steps: int) -> np.ndarray:
    """Start at `velocity`, push with a force equal to the weight; return the lens positions, (steps, 3) m."""
    weight = craft.airframe.mass_kg * GRAVITY
    craft.state["velocity"] = velocity
    craft.state["external_force"] = weight * np.array(velocity) / np.linalg.norm(velocity) - (0.0, 0.0, weight)
    path = np.empty((steps, 3))
    for k in range(steps):
        craft.advance(1)
        path[k] = craft.state["position"] + rotate(tuple(craft.state["attitude"]), CAMERA)
    return path


@pytest.mark.parametrize("name", names())
@pytest.mark.parametrize("speed", [0.3, 1.2, 3.0, 20.0])
def test_the_lens_never_enters_a_wall(name: str, speed: float) -> None:
    craft = vehicle(name, obstacles=WALL, camera_frd=CAMERA, position_ned=(4.35, 0.0, -3.0))
    path = ram(craft, (speed, 0.0, 0.0), 1500)
    # the camera's near plane is at 0.05 m; at 20 m/s the test only requires that the lens stays outside
    assert 5.0 - path[:, 0].max() > (0.0495 if speed < 10.0 else 0.01)
    assert craft.state["hits"] > 0


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_post_between_a_rotor_and_the_camera_is_hit(side: float) -> None:
    post = solid(block((0.37, 0.1 * side, -4.0), (0.02, 0.02, 3.0)))
    craft = vehicle(obstacles=post, camera_frd=CAMERA, position_ned=(0.0, 0.0, -4.0))
    ram(craft, (0.0, 0.5 * side, 0.0), 1)
    assert craft.state["hits"] > 0


@pytest.mark.parametrize("name", names())
def test_a_collision_adds_no_energy(name: str) -> None:
    craft = vehicle(name, obstacles=WALL, camera_frd=CAMERA, position_ned=(4.3, 0.0, -4.0))
    craft.state["velocity"] = (0.8, 0.0, 0.0)
    mass, inertia = craft.airframe.mass_kg, craft.params["inertia"]

    def energy() -> float:
        turning = 0.5 * float(np.sum(inertia * craft.state["rates"] ** 2))
        return (
            0.5 * mass * float(np.sum(craft.state["velocity"] ** 2))
            + turning
            - mass * GRAVITY * float(craft.state["position"][2])
        )

    before = energy()
    for _ in range(20):
        craft.advance(35)
        assert energy() <= before + 1e-3 * mass
    assert craft.state["hits"] >= 1
    assert craft.state["hit_speed"] == pytest.approx(0.8, abs=0.05)
    assert -0.6 < craft.state["velocity"][0] < 0.0


def test_an_off_centre_hit_turns_the_vehicle() -> None:
    post = solid(block((5.0, 0.35, -3.0), (0.1, 0.1, 3.0)))
    craft = vehicle(obstacles=post, position_ned=(4.4, 0.0, -3.0))
    craft.state["velocity"] = (1.0, 0.0, 0.0)
    craft.advance(600)
    assert craft.state["hits"] >= 1
    assert craft.state["rates"][2] > 0.3  # struck on its right front: it swings to the right


def test_a_vehicle_rests_on_a_flat_roof_and_slides_off_a_steep_one() -> None:
    craft = vehicle(obstacles=solid(block((0.0, 0.0, -1.0), (2.0, 2.0, 1.0))), position_ned=(0.0, 0.0, -2.4))
    craft.advance(3000)
    there = craft.state["position"].copy()
    assert there == pytest.approx((0.0, 0.0, -2.23), abs=0.02)
    craft.advance(2000)
    assert craft.state["position"] == pytest.approx(there, abs=2e-3)
    assert craft.truth["accel_frd"] == pytest.approx((0.0, 0.0, -GRAVITY), abs=0.05)
    assert craft.state["crashed"] == 0
    ramp = np.array([[[-3, -3, 0], [3, 3, -6], [3, -3, -6]], [[-3, -3, 0], [-3, 3, 0], [3, 3, -6]]], dtype=float)
    craft = vehicle(obstacles=solid(ramp), position_ned=(1.0, 0.0, -4.6))
    craft.advance(700)
    assert craft.state["position"][0] < 0.7


def test_a_vehicle_on_the_edge_of_a_roof_tips_over() -> None:
    craft = vehicle(obstacles=solid(block((0.0, 0.0, -3.0), (2.0, 2.0, 0.5))), position_ned=(2.05, 0.0, -3.75))
    tilt = 0.0
    for _ in range(40):
        craft.advance(50)
        tilt = max(tilt, abs(quat_to_euler(tuple(craft.state["attitude"]))[1]))
    assert tilt > 0.7
    assert craft.state["height"] < 2.0  # and falls beside the block


def test_a_hard_hit_breaks_a_propeller_and_records_the_obstacle() -> None:
    wall = solid(block((-30.0, 0.0, 0.0), (1.0, 1.0, 1.0)), block((6.0, 0.0, -4.0), (1.0, 8.0, 5.0)))
    craft = vehicle(obstacles=wall, position_ned=(4.2, 0.0, -3.0))
    spin(craft, craft.airframe.hover_speed)
    craft.state["velocity"] = (4.0, 0.0, 0.0)
    craft.advance(300)
    assert craft.state["crashed"] == 1
    assert (craft.state["rotor_health"][:4] == 0.0).any()
    assert wall.names[craft.state["hit_owner"]] == "block-1"
    assert np.isfinite(craft.state["position"]).all()


def test_a_broken_propeller_stays_broken_when_the_fault_of_a_script_ends() -> None:
    wall = solid(block((6.0, 0.0, -4.0), (1.0, 8.0, 5.0)))
    faults = [Fault(f"rotor{number}", "fail", 400_000, 500_000) for number in (1, 2, 3, 4)]
    craft = vehicle(obstacles=wall, position_ned=(4.2, 0.0, -3.0), faults=faults)
    spin(craft, craft.airframe.hover_speed)
    craft.state["velocity"] = (4.0, 0.0, 0.0)
    craft.advance(300)
    broken = craft.state["rotor_health"][:4] == 0.0
    assert broken.any()
    craft.actuators["armed"] = 1
    craft.actuators["command"][:4] = 0.7
    craft.advance(700)
    assert ((craft.state["rotor_speed"][:4] == 0.0) == broken).all()


def test_a_gentle_touch_breaks_nothing() -> None:
    craft = vehicle(obstacles=WALL, camera_frd=CAMERA, position_ned=(4.3, 0.0, -3.0))
    spin(craft, craft.airframe.hover_speed)
    craft.state["velocity"] = (0.5, 0.0, 0.0)
    craft.advance(500)
    assert craft.state["hits"] >= 1
    assert craft.state["crashed"] == 0
    assert (craft.state["rotor_health"][:4] == 1.0).all()


STONES = solid(
    block((6.0, 0.0, -4.0), (1.0, 8.0, 5.0)),  # a wall with its face at 5 m north
    block((4.9, 0.6, -4.0), (0.1, 0.1, 5.0)),  # a post in front of it
    block((0.0, 0.0, -0.5), (2.0, 2.0, 0.5)),  # a low roof
)


@pytest.mark.parametrize("velocity", [(1.2, 0.0, 0.0), (0.8, 0.9, 0.2), (1.2, 0.15, 0.0), (0.0, 0.3, 1.2)])
@pytest.mark.parametrize(("name", "period_us"), [*((name, 1000) for name in names()), ("x500", 4000)])
def test_inertial_sensors_measure_the_complete_motion_of_a_contact(
    name: str, velocity: tuple[float, ...], period_us: int
) -> None:
    """The samples of two seconds of contact integrate to the motion: velocity within 2 %, attitude within 1 %."""
    place = (4.35, 0.2, -3.0) if velocity[0] else (0.0, 0.0, -1.6)
    suite = replace(PERFECT, imu_period_us=period_us, accel_range=1e4)
    craft = vehicle(name, obstacles=STONES, camera_frd=CAMERA, position_ned=place, suite=suite)
    spin(craft, craft.airframe.hover_speed)
    craft.state["velocity"] = velocity
    ahead = np.array(velocity) / np.linalg.norm(velocity)
    craft.state["external_force"] = 0.4 * craft.airframe.mass_kg * GRAVITY * ahead
    craft.advance(period_us // 1000)  # the first sample is due with the first step
    dt, steps = period_us * 1e-6, 2_000_000 // period_us
    felt = craft.state["velocity"].copy()
    turned = tuple(craft.state["attitude"])
    way = spun = 0.0
    for _ in range(steps):
        before = craft.state["velocity"].copy(), np.array(craft.state["attitude"])
        craft.advance(period_us // 1000)
        after = np.array(craft.state["attitude"])
        between = after + before[1] * np.sign(after @ before[1])
        felt += np.array(rotate(tuple(between / np.linalg.norm(between)), tuple(craft.sensors["accel_frd"]))) * dt
        felt += (0.0, 0.0, GRAVITY * dt)
        turned = quat_integrate(turned, tuple(craft.sensors["gyro_frd"] * dt))
        way += float(np.linalg.norm(craft.state["velocity"] - before[0]))
        spun += float(np.linalg.norm(craft.state["rates"])) * dt
    assert craft.state["hits"] >= 1
    assert np.linalg.norm(felt - craft.state["velocity"]) < 0.02 * way
    off = 2.0 * np.arccos(min(abs(float(np.dot(turned, craft.state["attitude"]))), 1.0))
    assert off < 0.01 * spun


def test_a_moving_car_pushes_the_vehicle_that_it_hits() -> None:
    obstacles = solid(block((40.0, 0.0, 0.0), (1.0, 1.0, 1.0)), moving=CAR)
    craft = vehicle(obstacles=obstacles, camera_frd=CAMERA)  # stands on the road in front of the car
    pushed = 0.0
    for k in range(300):
        craft.place_box((-6.0 + 3.0 * 0.01 * k, 0.0, 0.0), 0.0, (3.0, 0.0, 0.0), 0.0)
        craft.advance(10)
        pushed = max(pushed, craft.state["velocity"][0])
    assert craft.state["hit_owner"] == BOX
    assert 2.5 < pushed < 3.0 + REBOUND_SPEED + 0.3
    assert craft.state["position"][0] > -6.0 + 9.0 + 2.0 - 0.05  # in front of the bumper, not inside


def test_placing_an_undeclared_moving_box_is_rejected() -> None:
    craft = vehicle(obstacles=solid(block((40.0, 0.0, 0.0), (1.0, 1.0, 1.0))))
    with pytest.raises(UsageError, match="moving"):
        craft.place_box((0.0, 0.0, 0.0), 0.0, (0.0, 0.0, 0.0), 0.0)


def test_far_obstacles_do_not_change_a_flight() -> None:
    states = []
    for obstacles in (OPEN, WALL):
        craft = vehicle(position_ned=(-5.0, 0.0, -8.0), obstacles=obstacles)
        spin(craft, craft.airframe.hover_speed)
        craft.state["velocity"] = (0.0, 1.0, 0.0)
        craft.advance(2000)
        states.append(craft.state.tobytes())
    assert states[0] == states[1]


@pytest.mark.parametrize("seed", range(4))
def test_skipped_collision_checks_miss_no_contact(seed: int) -> None:
    """The shortcuts (free distance, gathered candidates) give the same flight as a search at every step."""
    rng = np.random.default_rng(seed)
    stones = [block(tuple(rng.uniform(-4.0, 4.0, 3) - (0, 0, 6)), tuple(rng.uniform(0.1, 0.6, 3))) for _ in range(150)]
    scene = solid(*stones)
    lazy, eager = (vehicle(obstacles=scene, camera_frd=CAMERA, position_ned=(-5.0, 0.0, -6.0)) for _ in range(2))
    for craft in (lazy, eager):
        craft.state["attitude"] = quat_from_euler(0.3, -0.2, 0.5)
    for k in range(4000):
        kick = (3.0 * np.cos(k / 400.0), 3.0 * np.sin(k / 300.0), 2.0 * np.sin(k / 700.0))
        eager.near["free"] = eager.near["holds"] = 0.0
        for craft in (lazy, eager):
            if k % 400 == 0:
                craft.state["velocity"] = kick
            craft.state["velocity"][2] -= GRAVITY * 1e-3
            craft.advance(1)
    assert lazy.state["hits"] >= 1
    assert lazy.state["hits"] == eager.state["hits"]
    assert lazy.state["position"] == pytest.approx(eager.state["position"], abs=1e-6)


def test_obstacles_sorted_for_a_smaller_vehicle_are_rejected() -> None:
    with pytest.raises(UsageError, match="reach"):
        vehicle(obstacles=replace(WALL, reach_m=0.2))


def test_nearest_points_agree_with_a_dense_search() -> None:
    rng = np.random.default_rng(5)
    u, v = np.meshgrid(np.linspace(0, 1, 201), np.linspace(0, 1, 201))
    u, v = u[u + v <= 1.0], v[u + v <= 1.0]
    for _ in range(60):
        corners = rng.normal(size=(1, 9)).astype(np.float32)
        point = rng.normal(size=3) * 2.0
        a, b, c = corners.reshape(3, 3).astype(float)
        best = np.linalg.norm(a + u[:, None] * (b - a) + v[:, None] * (c - a) - point, axis=1).min()
        nearest = in_triangle(corners, 0, *point)
        gap = np.linalg.norm(np.array(nearest[:3]) - point)
        assert best - 0.02 < gap <= best + 1e-6
    for place, deep, way in (((3.0, 0.0, 0.0), 1.0, (1, 0, 0)), ((0.0, -0.9, 0.1), -0.1, (0, -1, 0))):
        box = in_box((2.0, 1.0, 1.0), place)
        assert box[0] == pytest.approx(deep)
        assert box[2] == pytest.approx(way)


def test_the_lens_never_enters_the_suv_mesh() -> None:
    """The vehicle flies into the triangles of a shipped asset, from five directions and at two heights."""
    from episodes.maps import assets
    from episodes.maps.scene import Instance, Scene, Sun
    from episodes.world.obstacles import obstacles
    from foundation.terrain import FLAT

    mesh = assets.build("suv", "red", None)
    scene = Scene("test", (Instance(1, "suv", "suv", mesh, (0.0, 0.0, 0.0)),), FLAT, Sun((0, 0, -1)), 47.0, 8.0, 400.0)
    solids = obstacles(scene)
    triangles = solids.corners.reshape(-1, 3, 3).astype(float)
    low, high = triangles.min(axis=1) - 0.1, triangles.max(axis=1) + 0.1
    near = 0
    for yaw in np.radians((0.0, 40.0, 90.0, 180.0, 250.0)):
        for height in (0.6, 1.2):
            ahead = np.array((np.cos(yaw), np.sin(yaw), 0.0))
            craft = vehicle(
                obstacles=solids, camera_frd=CAMERA, position_ned=tuple(-5.0 * ahead + (0, 0, -height)), yaw=yaw
            )
            for lens in ram(craft, tuple(1.5 * ahead), 2500)[::20]:  # the vehicle may slide up the hood
                for t in map(int, np.flatnonzero(((lens > low) & (lens < high)).all(axis=1))):
                    assert np.linalg.norm(np.array(in_triangle(solids.corners, t, *lens)[:3]) - lens) > 0.0495
                    near += 1
            assert craft.state["hits"] > 0
    assert near > 100
