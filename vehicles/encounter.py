"""Collisions between two vehicles, with equal and opposite forces.

Each vehicle is modelled as one ball around its rotors. The fleet checks every pair of vehicles before each tick. If the
two balls will touch within the tick, both vehicles get the impulse of the contact as a force over the tick, so that
their accelerometers measure it.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from foundation.compiled import Record, njit
from foundation.frames import Quat, Vec3
from foundation.record_reader import reader
from vehicles.collision import BREAKING, FRICTION, HIT_LEAST, mobility
from vehicles.ground import CRASH_BODY
from vehicles.multirotor import Multirotor
from vehicles.records import rotate, rotate_inverse

DRONE = -2  # for another vehicle, in fields with an obstacle's number; `collision.BOX` there stands for the moving box
TOUCH_MARGIN_M = 1e-3  # m, safety margin of `Ball.may_touch`
RESTITUTION = 0.3  # coefficient for plastic and carbon: a bump loses most of its energy
SEPARATION_RATE = 3.0  # 1/s, speed at which overlapping balls are driven apart, per m of overlap


@njit(cache=True)
def _first_touch(gap: Vec3, speed: Vec3, reach: float, tick_s: float) -> float:
    """Return when (s) two balls touch within the tick; 0 if they overlap already, -1 if they do not touch.

    `gap` (m), `speed` (m/s): position and velocity of one centre relative to the other. `reach` (m): sum of the radii.
    """
    apart = gap[0] * gap[0] + gap[1] * gap[1] + gap[2] * gap[2] - reach * reach
    if apart <= 0.0:
        return 0.0
    closing = gap[0] * speed[0] + gap[1] * speed[1] + gap[2] * speed[2]
    square = speed[0] * speed[0] + speed[1] * speed[1] + speed[2] * speed[2]
    inside = closing * closing - square * apart
    if closing >= 0.0 or inside <= 0.0:
        return -1.0
    when = (-closing - math.sqrt(inside)) / square
    return when if when < tick_s else -1.0


@njit(cache=True)
def _attitude(state: Record) -> Quat:
    return state.attitude[0], state.attitude[1], state.attitude[2], state.attitude[3]


@njit(cache=True)
def _point_velocity(state: Record, arm: Vec3) -> Vec3:
    """Return the velocity (m/s, NED) of a point at `arm` (m, NED) from the vehicle's origin."""
    x, y, z = rotate(_attitude(state), (state.rates[0], state.rates[1], state.rates[2]))
    return (
        state.velocity[0] + y * arm[2] - z * arm[1],
        state.velocity[1] + z * arm[0] - x * arm[2],
        state.velocity[2] + x * arm[1] - y * arm[0],
    )


@njit(cache=True)
def _push(state: Record, arm: Vec3, force: Vec3, sign: float) -> None:
    turn = (
        arm[1] * force[2] - arm[2] * force[1],
        arm[2] * force[0] - arm[0] * force[2],
        arm[0] * force[1] - arm[1] * force[0],
    )
    moment = rotate_inverse(_attitude(state), turn)
    for i in range(3):
        state.external_force[i] += sign * force[i]
        state.external_torque[i] += sign * moment[i]


@njit(cache=True)
def _note(params: Record, state: Record, closing: float, arm: Vec3) -> None:
    """Note a hit at `closing` (m/s). Above CRASH_BODY it is a crash, above BREAKING the nearest propeller breaks.

    `arm` (m, NED) goes from the vehicle's origin to the point of contact.
    """
    state.hits += 1
    state.hit_speed = closing
    state.hit_owner = DRONE
    if closing > CRASH_BODY:
        state.crashed = 1
    if closing > BREAKING:
        x, y, z = rotate_inverse(_attitude(state), arm)
        best, nearest = -1e9, 0
        for i in range(params.rotors):
            hub = params.rotor_position[i]
            along = hub[0] * x + hub[1] * y + hub[2] * z
            if along > best:
                best, nearest = along, i
        state.rotor_health[nearest] = 0.0


@njit(cache=True)
def _note_contact(state: Record, near: Record, closing: float, tick_s: float) -> None:
    """Note a contact in `near`, even one too slow for a hit. If the vehicle is on the ground, note only the time."""
    near.newest_us = state.time_us
    if state.on_ground != 0:
        return
    if near.leant_on != DRONE or near.leant_us < state.time_us - 1.5e6 * tick_s:
        near.leant_speed = closing
    near.leant_us, near.leant_on = state.time_us, DRONE


@njit(cache=True)
def _push_apart(plant: Record, size: float, other_plant: Record, other_size: float, tick_s: float) -> bool:
    """Add the contact to both vehicles' external forces and torques; return whether they touch within the tick."""
    params, state, others, other = plant.params, plant.state, other_plant.params, other_plant.state
    p, q, v, u = state.position, other.position, state.velocity, other.velocity
    gap = (p[0] - q[0], p[1] - q[1], p[2] - q[2])
    speed = (v[0] - u[0], v[1] - u[1], v[2] - u[2])
    reach = size + other_size
    when = _first_touch(gap, speed, reach, tick_s)
    if when < 0.0:
        return False
    gap = (gap[0] + speed[0] * when, gap[1] + speed[1] * when, gap[2] + speed[2] * when)
    between = math.sqrt(gap[0] * gap[0] + gap[1] * gap[1] + gap[2] * gap[2])
    normal = (gap[0] / between, gap[1] / between, gap[2] / between) if between > 1e-6 else (0.0, 0.0, -1.0)
    arm = (-size * normal[0], -size * normal[1], -size * normal[2])
    other_arm = (other_size * normal[0], other_size * normal[1], other_size * normal[2])
    here, there = _point_velocity(state, arm), _point_velocity(other, other_arm)
    x, y, z = here[0] - there[0], here[1] - there[1], here[2] - there[2]
    closing = -(x * normal[0] + y * normal[1] + z * normal[2])
    leaving = SEPARATION_RATE * max(reach - between, 0.0) + (RESTITUTION * closing if closing > HIT_LEAST else 0.0)
    if closing > HIT_LEAST:
        _note(params, state, closing, arm)
        _note(others, other, closing, other_arm)
    _note_contact(state, plant.near, closing, tick_s)
    _note_contact(other, other_plant.near, closing, tick_s)
    press = max(leaving + closing, 0.0) / (1.0 / params.mass + 1.0 / others.mass) / tick_s
    x, y, z = x + closing * normal[0], y + closing * normal[1], z + closing * normal[2]
    sliding = math.sqrt(x * x + y * y + z * z)
    force = (press * normal[0], press * normal[1], press * normal[2])
    if sliding > 1e-6:
        way = (x / sliding, y / sliding, z / sliding)
        ease = _mobility(params, state, arm, way) + _mobility(others, other, other_arm, way)
        rub = min(FRICTION * press, sliding / ease / tick_s)
        force = (force[0] - rub * way[0], force[1] - rub * way[1], force[2] - rub * way[2])
    _push(state, arm, force, 1.0)
    _push(other, other_arm, force, -1.0)
    return True


@njit(cache=True)
def _mobility(params: Record, state: Record, arm: Vec3, way: Vec3) -> float:
    q = _attitude(state)
    return mobility(params, rotate_inverse(q, arm), rotate_inverse(q, way))


def push_apart(one: Multirotor, other: Multirotor, tick_s: float) -> bool:
    """Add the forces of a contact in the coming tick to both vehicles. Return whether they touch."""
    return bool(_push_apart(one.record, bounding_radius(one), other.record, bounding_radius(other), tick_s))


@dataclass(frozen=True, slots=True)
class Ball:
    """A vehicle's ball at the beginning of a tick. Plain numbers keep the check of all pairs of a fleet fast."""

    position: Sequence[float]  # (3,) m, NED
    velocity: Sequence[float]  # (3,) m/s
    radius_m: float

    def may_touch(self, other: "Ball", tick_s: float) -> bool:
        """Return False only if the balls certainly do not touch within a tick."""
        room = math.dist(self.position, other.position) - self.radius_m - other.radius_m - TOUCH_MARGIN_M
        return room <= math.dist(self.velocity, other.velocity) * tick_s


def balls(vehicles: Sequence[Multirotor]) -> Callable[[], list[Ball]]:
    """Return a function that returns the vehicles' balls at the time of its call."""
    looks = [(reader(vehicle.state, "position", "velocity"), bounding_radius(vehicle)) for vehicle in vehicles]

    def look() -> list[Ball]:
        return [Ball(numbers[:3], numbers[3:], radius_m) for numbers, radius_m in ((at(), size) for at, size in looks)]

    return look


def bounding_radius(vehicle: Multirotor) -> float:
    """Return the radius (m) of the ball around a vehicle's rotors."""
    curve = vehicle.airframe.curve
    return curve.radius_m + max(math.hypot(*rotor.position_frd) for rotor in vehicle.airframe.rotors)
