"""A simulated multirotor: actuators → rotors → forces → motion → sensors → truth, in steps of 1 ms.

The motion of a step is one Runge-Kutta step. The rotors' force, moment and angular momentum h are constant in body axes
over the step. Air drag, gravity and the ground are evaluated at each of the four stages. The rotation follows Euler's
equation, with moment M and the rotors as gyroscopes: I · dω/dt = M - ω × (I · ω + h)
"""

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from foundation.airframe import Airframe
from foundation.compiled import Grid, Record, njit
from foundation.errors import UsageError
from foundation.frames import GRAVITY, Quat, Vec3, quat_from_euler
from foundation.sensors import ACTUATORS, MAX_ROTORS, SENSORS, TRUTH
from foundation.terrain import FLAT, OPEN, HeightField, Obstacles
from vehicles import ground
from vehicles.collision import collide, fresh_near, solids_record
from vehicles.faults import Fault, apply_rotor_faults, fault_record
from vehicles.ground import at_rest, candidates, freeze_at_rest, in_reach, peaks, support, surface, update_contacts
from vehicles.records import AIR, FAULTS, PARAMS, STATE, STEP_S, STEP_US, Load, quat_normalized, rotate, rotate_inverse
from vehicles.rotor import (
    COLLAPSE,
    FIRST_TURN,
    IMBALANCE_SPEED,
    advance_rotors,
    drain_battery,
    ground_gain,
    open_circuit,
)
from vehicles.rotor import PERIOD_US as BATTERY_PERIOD_US
from vehicles.sensors import MEMORY, SUITE, Suite, fresh_memory, sample, scale_slow_errors, suite_record
from vehicles.solids import NEAR, SOLIDS, SolidTriangles
from vehicles.wind import CALM, Wind, gust, streams
from vehicles.wind import PERIOD_US as WIND_PERIOD_US


@njit(cache=True)
def _moved(a: Vec3, b: Vec3, s: float) -> Vec3:
    return (a[0] + b[0] * s, a[1] + b[1] * s, a[2] + b[2] * s)


@njit(cache=True)
def _turned(a: Quat, b: Quat, s: float) -> Quat:
    return (a[0] + b[0] * s, a[1] + b[1] * s, a[2] + b[2] * s, a[3] + b[3] * s)


@njit(cache=True)
def _mean(a: Vec3, b: Vec3, c: Vec3, d: Vec3) -> Vec3:
    """Return the weighted mean of the four stages, per component."""
    return (
        (a[0] + 2.0 * (b[0] + c[0]) + d[0]) / 6.0,
        (a[1] + 2.0 * (b[1] + c[1]) + d[1]) / 6.0,
        (a[2] + 2.0 * (b[2] + c[2]) + d[2]) / 6.0,
    )


@njit(cache=True)
def air_drag(params: Record, air: Vec3) -> Vec3:
    """Return the drag (N, FRD) of the frame at the velocity `air` (m/s, FRD) through the air."""
    return (
        -(params.drag_linear[0] + params.drag_quadratic[0] * abs(air[0])) * air[0],
        -(params.drag_linear[1] + params.drag_quadratic[1] * abs(air[1])) * air[1],
        -(params.drag_linear[2] + params.drag_quadratic[2] * abs(air[2])) * air[2],
    )


@njit(cache=True)
def derivative(
    params: Record,
    state: Record,
    down: Grid,
    load: Load,
    wind: Vec3,
    mask: int,
    position: Vec3,
    velocity: Vec3,
    attitude: Quat,
    rates: Vec3,
) -> tuple[Vec3, Quat, Vec3]:
    """Return (acceleration m/s² NED, attitude rate 1/s, angular acceleration rad/s² FRD).

    `load` is (force N FRD, moment N·m FRD, rotor angular momentum about z); `wind` is m/s NED,
    `down` the terrain's NED z (m) on a grid, and `mask` has one bit per contact point that may touch the ground.
    """
    force, moment, momentum = load
    air = rotate_inverse(attitude, (velocity[0] - wind[0], velocity[1] - wind[1], velocity[2] - wind[2]))
    drag = air_drag(params, air)
    ax, ay, az = rotate(attitude, (force[0] + drag[0], force[1] + drag[1], force[2] + drag[2]))
    mx, my, mz = moment
    if mask != 0:
        ground, turn = support(params, state, down, mask, position, attitude, velocity, rates)
        ax, ay, az = ax + ground[0], ay + ground[1], az + ground[2]
        tx, ty, tz = rotate_inverse(attitude, turn)
        mx, my, mz = mx + tx, my + ty, mz + tz
    ax += state.external_force[0]
    ay += state.external_force[1]
    az += state.external_force[2]
    ix, iy, iz = params.inertia[0], params.inertia[1], params.inertia[2]
    p, q, r = rates
    hx, hy, hz = ix * p, iy * q, iz * r + momentum
    turning = (
        (mx + state.external_torque[0] - (q * hz - r * hy)) / ix,
        (my + state.external_torque[1] - (r * hx - p * hz)) / iy,
        (mz + state.external_torque[2] - (p * hy - q * hx)) / iz,
    )
    w, x, y, z = attitude
    attitude_rate = (
        0.5 * (-x * p - y * q - z * r),
        0.5 * (w * p + y * r - z * q),
        0.5 * (w * q - x * r + z * p),
        0.5 * (w * r + x * q - y * p),
    )
    mass = params.mass
    return (ax / mass, ay / mass, az / mass + GRAVITY), attitude_rate, turning


@njit(cache=True)
def move(params: Record, state: Record, down: Grid, load: Load, wind: Vec3, mask: int) -> None:
    """Advance the motion in `state` by one step (RK4); store the mean rates and the specific force."""
    h = STEP_S
    half = 0.5 * h
    p = (state.position[0], state.position[1], state.position[2])
    v = (state.velocity[0], state.velocity[1], state.velocity[2])
    q = (state.attitude[0], state.attitude[1], state.attitude[2], state.attitude[3])
    w = (state.rates[0], state.rates[1], state.rates[2])

    a1, q1, w1 = derivative(params, state, down, load, wind, mask, p, v, q, w)
    v2 = _moved(v, a1, half)
    a2, q2, w2 = derivative(
        params, state, down, load, wind, mask, _moved(p, v, half), v2, _turned(q, q1, half), _moved(w, w1, half)
    )
    v3 = _moved(v, a2, half)
    a3, q3, w3 = derivative(
        params, state, down, load, wind, mask, _moved(p, v2, half), v3, _turned(q, q2, half), _moved(w, w2, half)
    )
    v4 = _moved(v, a3, h)
    a4, q4, w4 = derivative(
        params, state, down, load, wind, mask, _moved(p, v3, h), v4, _turned(q, q3, h), _moved(w, w3, h)
    )

    acceleration = _mean(a1, a2, a3, a4)
    state.position[0], state.position[1], state.position[2] = _moved(p, _mean(v, v2, v3, v4), h)
    state.velocity[0], state.velocity[1], state.velocity[2] = _moved(v, acceleration, h)
    state.rates[0], state.rates[1], state.rates[2] = _moved(w, _mean(w1, w2, w3, w4), h)
    turned_at = _mean(w, _moved(w, w1, half), _moved(w, w2, half), _moved(w, w3, h))
    state.mean_rates[0], state.mean_rates[1], state.mean_rates[2] = turned_at
    turned = quat_normalized(
        (
            q[0] + h * (q1[0] + 2.0 * (q2[0] + q3[0]) + q4[0]) / 6.0,
            q[1] + h * (q1[1] + 2.0 * (q2[1] + q3[1]) + q4[1]) / 6.0,
            q[2] + h * (q1[2] + 2.0 * (q2[2] + q3[2]) + q4[2]) / 6.0,
            q[3] + h * (q1[3] + 2.0 * (q2[3] + q3[3]) + q4[3]) / 6.0,
        )
    )
    state.attitude[0], state.attitude[1], state.attitude[2], state.attitude[3] = turned
    # the mean over the step, as a real accelerometer measures, so that its sum matches the change of velocity
    felt = rotate_inverse(turned, (acceleration[0], acceleration[1], acceleration[2] - GRAVITY))
    state.specific_force[0], state.specific_force[1], state.specific_force[2] = felt


PLANT = np.dtype(
    [
        ("params", PARAMS),
        ("state", STATE),
        ("air", AIR),
        ("suite", SUITE),
        ("memory", MEMORY),
        ("faults", FAULTS),
        ("actuators", ACTUATORS),
        ("sensors", SENSORS),
        ("truth", TRUTH),
        ("solids", SOLIDS),
        ("near", NEAR),
    ],
    align=True,
)


@njit(cache=True)
def step(plant: Record, down: Grid, peak: Grid, triangles: SolidTriangles) -> None:
    """Advance one vehicle by exactly STEP_US: reads `actuators`, writes `state`, `air`, `memory`, `sensors`, `truth`.

    The arguments are a Multirotor's `kernel_args`.
    """
    params, state, air, faults = plant.params, plant.state, plant.air, plant.faults
    if air.w20 > 0.0 and state.time_us >= air.next_us:
        air.next_us += WIND_PERIOD_US
        gust(air, state.velocity, state.height)
    breeze = (air.mean[0] + air.gust[0], air.mean[1] + air.gust[1], air.mean[2] + air.gust[2])

    position = (state.position[0], state.position[1], state.position[2])
    attitude = (state.attitude[0], state.attitude[1], state.attitude[2], state.attitude[3])
    through_air = rotate_inverse(
        attitude, (state.velocity[0] - breeze[0], state.velocity[1] - breeze[1], state.velocity[2] - breeze[2])
    )
    below, _, _ = surface(params, down, position[0], position[1])
    state.height = below - position[2]
    upright = 1.0 - 2.0 * (attitude[1] ** 2 + attitude[2] ** 2)  # cosine of the tilt
    near_ground = ground_gain(state.height + params.rotor_height, params.rotor_radius) if upright > 0.5 else 1.0
    mask = candidates(params, state, down, attitude) if in_reach(params, peak, position) else 0

    rates = (state.rates[0], state.rates[1], state.rates[2])
    if faults.count > 0:
        apply_rotor_faults(faults, state, params.rotors)
    load = advance_rotors(params, state, plant.actuators, through_air, rates, near_ground)
    if state.time_us % BATTERY_PERIOD_US == 0:
        drain_battery(params, state)

    if mask != 0 and at_rest(params, state, load, breeze):
        freeze_at_rest(state)
    else:
        move(params, state, down, load, breeze, mask)
        update_contacts(params, state, down, load, mask)
    collide(params, state, plant.solids, plant.near, triangles)
    state.upside_down = 1 if upright < 0.0 else 0
    state.time_us += STEP_US

    sample(plant, down, triangles)
    _write_truth(state, plant.truth)


@njit(cache=True)
def _write_truth(state: Record, truth: Record) -> None:
    truth.time_us = state.time_us
    for i in range(3):
        truth.position_ned[i] = state.position[i]
        truth.velocity_ned[i] = state.velocity[i]
        truth.rates_frd[i] = state.rates[i]
        truth.accel_frd[i] = state.specific_force[i]
    for i in range(4):
        truth.attitude[i] = state.attitude[i]


@njit(cache=True)
def run(steps: int, plant: Record, down: Grid, peak: Grid, triangles: SolidTriangles) -> None:
    """Advance one vehicle by `steps` steps with the present actuator commands."""
    for _ in range(steps):
        step(plant, down, peak, triangles)


class PlantArguments(NamedTuple):
    """The arguments of `step` for one vehicle."""

    plant: np.void  # record of the type PLANT
    down: NDArray[np.float64]  # m, NED z of the terrain on a grid
    peak: NDArray[np.float64]  # m, NED z of the highest terrain within the vehicle's reach, on the same grid
    triangles: SolidTriangles


class Multirotor:
    """One simulated vehicle: its records and its time.

    `params`, `state`, `air`, `suite`, `memory` and `faults` are records of `vehicles.records` and `vehicles.sensors`;
    `sensors`, `actuators` and `truth` are records of `foundation.sensors`. All of them are fields of `record`
    (type PLANT). `kernel_args` are the arguments of `step`: this record, the ground and the obstacles.
    """

    def __init__(
        self,
        airframe: Airframe,
        *,
        seed: int,
        origin: tuple[float, float, float],  # latitude, longitude (degrees) and altitude (m) of the map's NED origin
        terrain: HeightField = FLAT,
        obstacles: Obstacles = OPEN,
        camera_frd: Vec3 | None = None,  # m, place of a camera that sticks out of the frame and collides too
        position_ned: Vec3 = (0.0, 0.0, 0.0),
        yaw: float = 0.0,
        wind: Wind | None = None,
        suite: Suite | None = None,
        faults: Iterable[Fault] = (),
    ) -> None:
        """Place a level vehicle at `position_ned` (m) with heading `yaw` (rad), or on the ground if that is higher.

        Raises UsageError for a pose that is not finite, an impossible fault, or obstacles sorted for a smaller vehicle.
        """
        if not all(math.isfinite(x) for x in (*position_ned, yaw, *origin)):
            raise UsageError(f"vehicle pose {position_ned}, yaw {yaw}, origin {origin} must be finite numbers")
        wind, suite = wind or CALM, suite or Suite()
        gusts, errors = streams(seed, 2)
        self.airframe = airframe
        self.record = plant = np.zeros(1, PLANT)[0]
        self.params, self.state, self.air, self.suite, self.memory, self.faults = (
            plant["params"], plant["state"], plant["air"], plant["suite"], plant["memory"], plant["faults"],
        )  # fmt: skip
        self.actuators, self.sensors, self.truth = plant["actuators"], plant["sensors"], plant["truth"]
        self.solids, self.near = plant["solids"], plant["near"]
        plant["params"] = parameters(airframe, terrain)
        self.air["rng"][0] = gusts
        self._origin = origin
        self.set_wind(wind)
        self.set_sensor_suite(suite)
        plant["memory"] = fresh_memory(suite, int(errors))
        plant["faults"] = fault_record(faults, len(airframe.rotors), suite.gps_period_us, suite.gps_age_us)
        self.sensors["range_m"] = math.nan
        self.obstacles = obstacles
        plant["solids"] = solids_record(self.params, obstacles, camera_frd)
        plant["near"] = fresh_near()
        self.kernel_args = PlantArguments(
            plant,
            np.ascontiguousarray(terrain.down, dtype=np.float64),
            peaks(terrain, float(self.params["reach"])),
            SolidTriangles(obstacles.corners, obstacles.bounds, obstacles.start, obstacles.index, obstacles.owner),
        )
        if len(obstacles.corners) and self.solids["reach"] > obstacles.reach_m:
            raise UsageError(
                f"airframe '{airframe.name}' reaches {self.solids['reach']:.2f} m from its origin, but the obstacles "
                f"are sorted for {obstacles.reach_m:g} m: build them with a larger reach"
            )
        self._boot = terrain, position_ned, yaw
        self._place(*self._boot)

    def restore(self) -> None:
        """Reset the vehicle to its first pose, undamaged and with a full battery. Its time and sensors continue."""
        time_us, plant = int(self.state["time_us"]), self.record
        plant["state"] = np.zeros(1, STATE)[0]
        plant["near"] = fresh_near()
        self.state["time_us"] = time_us
        self._place(*self._boot)

    def keep_charge(self, share: float) -> None:
        """From now on, do not drain the battery below this share of its capacity."""
        self.params["charge_least_ah"] = share * self.airframe.battery.capacity_ah

    def advance(self, steps: int) -> None:
        """Advance by `steps` milliseconds with the present actuator commands."""
        run(steps, *self.kernel_args)

    def set_wind(self, wind: Wind) -> None:
        """Set the wind from now on."""
        self.air["mean"], self.air["w20"] = wind.mean_ned, wind.w20
        self.air["next_us"] = self.state["time_us"]

    def set_sensor_suite(self, suite: Suite) -> None:
        """Use this sensor suite from now on. Errors drawn at boot and the times of samples stay.

        Slowly varying errors are scaled at once. Otherwise they would change only in a minute or more.
        """
        before, self.record["suite"] = self.record["suite"].copy(), suite_record(suite, self._origin)
        scale_slow_errors(self.memory, before, self.record["suite"])

    def place_box(self, position_ned: Vec3, yaw: float, velocity_ned: Vec3, yaw_rate: float) -> None:
        """Set the moving box's pose (m, rad) at this vehicle's time and its velocities (m/s, rad/s).

        `position_ned` is the place of the asset's origin. Raises UsageError if the obstacles have no moving box.
        """
        box, solids = self.obstacles.moving, self.solids
        if box is None:
            raise UsageError("these obstacles have no moving box: build them from a scene with a movable solid")
        c, s = math.cos(yaw), math.sin(yaw)
        x, y, z = box.centre_frd
        x, y = c * x - s * y, s * x + c * y
        solids["box_centre"] = (position_ned[0] + x, position_ned[1] + y, position_ned[2] + z)
        solids["box_velocity"] = (velocity_ned[0] - yaw_rate * y, velocity_ned[1] + yaw_rate * x, velocity_ned[2])
        solids["box_half"], solids["box_yaw"], solids["box_yaw_rate"] = box.half_m, yaw, yaw_rate
        solids["box_reach"] = math.hypot(*box.half_m) + solids["reach"]
        solids["box_time_us"], solids["box"] = self.state["time_us"], 1

    def _place(self, terrain: HeightField, position_ned: Vec3, yaw: float) -> None:
        north, east, down = position_ned
        lowest = max(point[2] for point in self.airframe.contact_points_frd)
        feet = sum(1 for point in self.airframe.contact_points_frd if point[2] > lowest - 1e-9)
        sag = self.airframe.mass_kg * GRAVITY / (feet * float(self.params["contact_stiffness"]))
        below = terrain.at(north, east)
        c, s = math.cos(yaw), math.sin(yaw)
        # on a slope or a kerb, the foot on the highest ground sets the height: no foot may begin inside the ground
        stands = min(
            terrain.at(north + c * x - s * y, east + s * x + c * y) - z for x, y, z in self.airframe.contact_points_frd
        )
        down = min(down, stands + sag)
        state = self.state
        state["position"] = (north, east, down)
        state["attitude"] = quat_from_euler(0.0, 0.0, yaw)
        state["rotor_health"] = state["rotor_fault"] = 1.0
        state["rotor_turn"] = FIRST_TURN * np.arange(MAX_ROTORS)
        state["height"] = below - down
        state["charge_ah"] = self.airframe.battery.capacity_ah
        state["voltage"] = self.airframe.battery.cells * open_circuit(1.0)
        _write_truth(state, self.truth)


def parameters(airframe: Airframe, terrain: HeightField = FLAT) -> np.void:
    """Return the PARAMS record of an airframe over a terrain."""
    record: np.void = np.zeros(1, PARAMS)[0]
    curve, pack, points = airframe.curve, airframe.battery, airframe.contact_points_frd
    record["mass"], record["inertia"] = airframe.mass_kg, airframe.inertia_frd
    record["drag_linear"], record["drag_quadratic"] = airframe.drag_linear_frd, airframe.drag_quadratic_frd
    count = len(airframe.rotors)
    record["rotors"] = count
    record["rotor_position"][:count] = [r.position_frd for r in airframe.rotors]
    record["rotor_spin"][:count] = [r.spin for r in airframe.rotors]
    record["rotor_height"] = -sum(r.position_frd[2] for r in airframe.rotors) / count
    record["thrust_coefficient"], record["torque_coefficient"] = curve.thrust_coefficient, curve.torque_coefficient
    record["speed_max"], record["speed_idle"] = curve.speed_max, curve.speed_idle
    record["gain_up"] = 1.0 - math.exp(-STEP_S / curve.time_constant_up_s)
    record["gain_down"] = 1.0 - math.exp(-STEP_S / curve.time_constant_down_s)
    record["rotor_inertia"], record["rotor_radius"] = curve.inertia, curve.radius_m
    record["blade_drag"] = curve.drag_coefficient
    record["imbalance"] = curve.rotating_kg * IMBALANCE_SPEED / airframe.hover_speed
    record["contacts"] = len(points)
    record["contact_position"][: len(points)] = points
    lowest = max(point[2] for point in points)
    # the lowest points are feet; landing gear may be uneven by 2 %
    record["contact_is_foot"][: len(points)] = [point[2] > lowest - 0.02 * max(lowest, 0.0) - 1e-9 for point in points]
    record["contact_stiffness"] = airframe.mass_kg * ground.RESONANCE**2 / 4.0
    record["contact_damping"] = 2.0 * ground.DAMPING_RATIO * airframe.mass_kg * ground.RESONANCE / 4.0
    record["reach"] = max(math.dist(point, (0.0, 0.0, 0.0)) for point in points)
    record["cells"], record["capacity_ah"] = pack.cells, pack.capacity_ah
    record["charge_least_ah"] = COLLAPSE * pack.capacity_ah
    record["resistance_ohm"], record["avionics_w"] = pack.resistance_ohm, pack.avionics_w
    record["ground_north"], record["ground_east"] = terrain.origin_north, terrain.origin_east
    record["ground_cell"] = terrain.cell_m
    return record
