"""Linearises the control cascade about a hover in discrete time, and computes delay margins with python-control.

`autopilot.control.loop_design` designs the loops with an airframe's constants, at nominal voltage and without air
damping. This module linearises the same cascade about a simulated hover. It adds the voltage at the rotors, the damping
by the air, the sample-and-hold of slower loops, and the filters in the feedback path.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from autopilot.control.cascade import ACCELERATION_CUTOFF, ATTITUDE_PERIOD_US, OUTER_PERIOD_US
from autopilot.control.loop_design import FREQUENCIES, Complex, Gains, Response, loops, rotor_lag, yaw_lead
from dronecats.study.loop.hover import TURNS, CascadeLoop
from foundation.airframe import Airframe
from foundation.frames import Vec3
from vehicles.multirotor import air_drag
from vehicles.records import STEP_S
from vehicles.rotor import EFFICIENCY, NOMINAL_CELL_V, advance_rotors

FREQUENCIES_DENSE = np.geomspace(0.1, 1000.0, 1_000)  # rad/s; below half of the sampling rate of 1 kHz
SMALL = 1e-3  # rad/s or m/s: disturbance of the hover from which the air's damping is computed numerically


@dataclass(frozen=True, slots=True)
class HoverPoint:
    """The properties of a hover that are not airframe constants."""

    torque_gain: float  # torque / nominal torque; thrust and torque grow with the square of the voltage
    lift_gain: float  # lift / commanded lift; below 1, since more thrust lowers the battery's voltage
    rate_damping: Vec3  # 1/s, deceleration / rate: roll, pitch, yaw
    velocity_damping: Vec3  # 1/s, deceleration / velocity: forward, right, down


@dataclass(frozen=True, slots=True)
class DelayMargin:
    """The delay at which a loop begins to oscillate, and the frequency of the oscillation."""

    delay_s: float  # s, in the feedback; inf: no delay makes the loop oscillate
    frequency: float  # rad/s; nan: no delay makes the loop oscillate


def hover_point(airframe: Airframe, plant: Any) -> HoverPoint:
    """Return the linearisation of air and battery about a hover. `plant`: PLANT record of the hover; unchanged."""
    params, voltage = plant["params"], float(plant["state"]["voltage"])
    nominal = NOMINAL_CELL_V * airframe.battery.cells
    rate_damping, velocity_damping = [], []
    for axis in range(3):
        slopes = []
        for sign in (1.0, -1.0):
            rest = (0.0, 0.0, 0.0)
            disturbance = (sign * SMALL * (axis == 0), sign * SMALL * (axis == 1), sign * SMALL * (axis == 2))
            _, moment, _ = advance_rotors(params, plant["state"].copy(), plant["actuators"], rest, disturbance, 1.0)
            force, _, _ = advance_rotors(params, plant["state"].copy(), plant["actuators"], disturbance, rest, 1.0)
            drag = air_drag(params, disturbance)
            slopes.append((moment[axis], force[axis] + drag[axis]))
        rate_damping.append((slopes[1][0] - slopes[0][0]) / (2.0 * SMALL * airframe.inertia_frd[axis]))
        velocity_damping.append((slopes[1][1] - slopes[0][1]) / (2.0 * SMALL * airframe.mass_kg))
    return HoverPoint(
        torque_gain=(voltage / nominal) ** 2,
        lift_gain=1.0 / (1.0 + 2.0 * sag(airframe, plant)),
        rate_damping=(rate_damping[0], rate_damping[1], rate_damping[2]),
        velocity_damping=(velocity_damping[0], velocity_damping[1], velocity_damping[2]),
    )


def sag(airframe: Airframe, plant: Any) -> float:
    """Return the relative drop of the voltage per relative increase of the thrust of all rotors.

    Power is proportional to the cube of the rotor speed, and so to thrust to the power of 1.5. At a lower voltage, the
    same power needs a higher current, which increases the drop: the last factor below.
    """
    state, ohm = plant["state"], airframe.battery.resistance_ohm
    voltage, current = float(state["voltage"]), float(state["current"])
    power = float(state["rotor_power"]) / EFFICIENCY
    return 1.5 * ohm * power / voltage**2 / (1.0 - ohm * current / voltage)


def zero_order_hold(z: Complex, samples: int) -> Complex:
    """Return the response of a hold that keeps every `samples`-th sample."""
    total: Complex = sum(z**-k for k in range(samples)) / samples  # type: ignore[assignment]
    return total


def smoother(z: Complex, weight: float) -> Complex:
    """Return the response of y += weight · (x - y); y is used after its update."""
    return weight * z / (z - (1.0 - weight))


def low_pass(z: Complex, cutoff: float, period_s: float) -> Complex:
    """Return the response of the cascade's first-order low-pass with a cutoff (rad/s)."""
    weight = period_s * cutoff
    return smoother(z, weight / (1.0 + weight))


def rotor_response(z: Complex, airframe: Airframe) -> Complex:
    """Return the response of the rotors to a command: the mean lag of spin-up and spin-down, and one sample's delay."""
    gain = 1.0 - math.exp(-STEP_S / rotor_lag(airframe))
    return gain / (z - (1.0 - gain))


def integrator(z: Complex, damping: float) -> Complex:
    """Return the response of an integrator with a damping (1/s), for an input that is constant during a sample."""
    return STEP_S * z / (z - (1.0 - damping * STEP_S))


def midpoint(z: Complex) -> Complex:
    """Return the response of the mean of the last two samples; the simulation integrates motion with this mean."""
    return 0.5 * (1.0 + 1.0 / z)


def linear_loops(airframe: Airframe, gains: Gains, point: HoverPoint) -> dict[str, Response]:
    """Return the open-loop response L(s), s = jω, of every loop by its name in `LOOPS`."""

    def rate(axis: int, s: Complex) -> tuple[Complex, Complex]:
        """Return (L, closed loop from rate setpoint to rate)."""
        z = np.exp(STEP_S * s)
        lead = yaw_lead(airframe) if axis == 2 else 0.0
        plant = point.torque_gain * rotor_response(z, airframe) * (1.0 + lead * (1.0 - 1.0 / z) / STEP_S)
        plant = plant * integrator(z, point.rate_damping[axis])
        gyro = low_pass(z, 2.0 * math.pi * gains.gyro_cutoff_hz, STEP_S)
        derivative = low_pass(z, 2.0 * math.pi * gains.gyro_derivative_cutoff_hz, STEP_S) * (1.0 - 1.0 / z) / STEP_S
        controller = gains.rate_p[axis] + gains.rate_i[axis] * STEP_S / (z - 1.0)
        loop = plant * gyro * (controller + gains.rate_d[axis] * derivative)
        return loop, controller * plant / (1.0 + loop)

    def attitude(axis: int, s: Complex) -> tuple[Complex, Complex]:
        """Return (L, closed loop from attitude setpoint to the mean attitude of a sample)."""
        z = np.exp(STEP_S * s)
        _, turning = rate(axis, s)
        rate_loop = gains.attitude_p[axis] * zero_order_hold(z, round(ATTITUDE_PERIOD_US * 1e-6 / STEP_S)) * turning
        loop = rate_loop * integrator(z, 0.0)  # no `midpoint` here: the estimator integrates the newest rate
        return loop, loop * midpoint(z) / (1.0 + loop)

    def velocity(axis: int, s: Complex) -> Complex:
        z = np.exp(STEP_S * s)
        samples = round(OUTER_PERIOD_US * 1e-6 / STEP_S)
        period, slow = samples * STEP_S, z**samples
        acceleration = low_pass(slow, ACCELERATION_CUTOFF, period) * (1.0 - 1.0 / z) / STEP_S
        controller = gains.velocity_p[axis] + gains.velocity_i[axis] * period / (slow - 1.0)
        controller = controller + gains.velocity_d[axis] * acceleration
        actuation = point.lift_gain * rotor_response(z, airframe) if axis == 2 else attitude(1, s)[1] * midpoint(z)
        loop: Complex = (
            controller * zero_order_hold(z, samples) * actuation * integrator(z, point.velocity_damping[axis])
        )
        return loop

    def first(function: Callable[[int, Complex], tuple[Complex, Complex]], axis: int) -> Response:
        return lambda s: function(axis, s)[0]

    return {
        **{f"{name} rate": first(rate, axis) for axis, name in enumerate(TURNS)},
        **{f"{name} attitude": first(attitude, axis) for axis, name in enumerate(TURNS)},
        "horizontal velocity": lambda s: velocity(0, s),
        "vertical velocity": lambda s: velocity(2, s),
    }


def delay_margin(loop: Response, frequencies: NDArray[np.float64] = FREQUENCIES_DENSE) -> DelayMargin:
    """Return the smallest delay in the feedback that makes a loop oscillate, from python-control's phase margins.

    A delay τ changes the phase by -τω at a crossover frequency ω and keeps the gain. So the delay margin is the phase
    margin divided by ω, and the smallest one of all crossovers counts.
    """
    import control

    response = control.FRD(loop(1j * frequencies), frequencies)
    _, phases, _, _, crossovers, _ = control.stability_margins(response, returnall=True)
    margins = [
        DelayMargin(math.radians(float(phase) % 360.0) / float(omega), float(omega))
        for phase, omega in zip(phases, crossovers, strict=True)
        if math.isfinite(phase) and omega > 0.0
    ]
    return min(margins, key=lambda margin: margin.delay_s, default=DelayMargin(math.inf, math.nan))


def designed_margin(airframe: Airframe, gains: Gains, loop: CascadeLoop) -> DelayMargin:
    """Return the delay margin of a loop as `dronecats tune` computes it, from the airframe's constants only."""
    return delay_margin(loops(airframe, gains)[loop.name], FREQUENCIES)
