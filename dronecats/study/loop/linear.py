"""The cascade linearised about a hover, sample by sample as it is computed, and the delay python-control grants it.

`autopilot.design.loop_shaping` shapes its loops on an airframe's constants, at the battery's nominal voltage and in
still air. This is the same cascade about a hover that was flown: the voltage at the rotors, the air's damping, what
is sampled and held at which rate, and filters that lie in the feedback alone.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from autopilot.control.cascade import ACCELERATION_CUTOFF, ATTITUDE_PERIOD_US, OUTER_PERIOD_US
from autopilot.design.loop_shaping import FREQUENCIES, Complex, Gains, Response, loops, rotor_lag, yaw_lead
from dronecats.study.loop.cascade_loops import TURNS, CascadeLoop
from foundation.airframe import Airframe
from foundation.frames import Vec3
from vehicles.records import STEP_S
from vehicles.rigid_body import air_drag
from vehicles.rotor import EFFICIENCY, NOMINAL_CELL_V, push

DENSE = np.geomspace(0.1, 1000.0, 1_000)  # rad/s; below half of the 1 kHz at which all is sampled
SMALL = 1e-3  # rad/s, m/s: by which a hover is disturbed to see what the air does about it


@dataclass(frozen=True, slots=True)
class HoverPoint:
    """What a hover adds to an airframe's constants."""

    torque_gain: float  # × the nominal: thrust goes with the square of the voltage
    lift_gain: float  # × the asked: more of all rotors' thrust takes some of the battery's voltage
    rate_damping: Vec3  # 1/s, roll, pitch, yaw
    velocity_damping: Vec3  # 1/s, forward, right, down


@dataclass(frozen=True, slots=True)
class DelayMargin:
    """How late a loop's feedback may come until it oscillates, and how fast it does then."""

    delay_s: float  # inf: no delay makes it oscillate
    frequency: float  # rad/s


def hover_point(airframe: Airframe, plant: Any) -> HoverPoint:
    """Return the linearisation of the air and the battery about a hover, whose PLANT record is looked at."""
    params, voltage = plant["params"], float(plant["state"]["voltage"])
    nominal = NOMINAL_CELL_V * airframe.battery.cells
    turned: list[float] = []
    moved: list[float] = []
    for axis in range(3):
        slopes = []
        for sign in (1.0, -1.0):
            still = (0.0, 0.0, 0.0)
            off = (sign * SMALL * (axis == 0), sign * SMALL * (axis == 1), sign * SMALL * (axis == 2))
            _, moment, _ = push(params, plant["state"].copy(), plant["actuators"], still, off, 1.0)
            force, _, _ = push(params, plant["state"].copy(), plant["actuators"], off, still, 1.0)
            drag = air_drag(params, off)
            slopes.append((moment[axis], force[axis] + drag[axis]))
        turned.append((slopes[1][0] - slopes[0][0]) / (2.0 * SMALL * airframe.inertia_frd[axis]))
        moved.append((slopes[1][1] - slopes[0][1]) / (2.0 * SMALL * airframe.mass_kg))
    return HoverPoint(
        torque_gain=(voltage / nominal) ** 2,
        lift_gain=1.0 / (1.0 + 2.0 * sag(airframe, plant)),
        rate_damping=(turned[0], turned[1], turned[2]),
        velocity_damping=(moved[0], moved[1], moved[2]),
    )


def sag(airframe: Airframe, plant: Any) -> float:
    """Return by what share the voltage falls when all rotors turn so much faster that their thrust grows by one share.

    Power goes with the cube of the speed, so with the 1.5th power of thrust; the current that it takes with the voltage
    that its own sag leaves.
    """
    state, ohm = plant["state"], airframe.battery.resistance_ohm
    voltage, current = float(state["voltage"]), float(state["current"])
    power = float(state["rotor_power"]) / EFFICIENCY
    return 1.5 * ohm * power / voltage**2 / (1.0 - ohm * current / voltage)


def held(z: Complex, samples: int) -> Complex:
    """Return what holding every `samples`-th sample makes of a signal."""
    total: Complex = sum(z**-k for k in range(samples)) / samples  # type: ignore[assignment]
    return total


def follower(z: Complex, weight: float) -> Complex:
    """Return y += weight · (x - y), computed before y is used."""
    return weight * z / (z - (1.0 - weight))


def low_pass(z: Complex, cutoff: float, period_s: float) -> Complex:
    """Return the cascade's first-order low-pass of a cutoff (rad/s)."""
    weight = period_s * cutoff
    return follower(z, weight / (1.0 + weight))


def rotors(z: Complex, airframe: Airframe) -> Complex:
    """Return what becomes of a command until it turns a rotor: the mean of spinning up and down, a sample later."""
    gain = 1.0 - math.exp(-STEP_S / rotor_lag(airframe))
    return gain / (z - (1.0 - gain))


def grown(z: Complex, damping: float) -> Complex:
    """Return the integral over time of something that acts throughout a sample, against a damping (1/s)."""
    return STEP_S * z / (z - (1.0 - damping * STEP_S))


def between(z: Complex) -> Complex:
    """Return the mean of two samples, a half before the newer one: what motion is integrated with."""
    return 0.5 * (1.0 + 1.0 / z)


def linearised(airframe: Airframe, gains: Gains, point: HoverPoint) -> dict[str, Response]:
    """Return L(s) of every loop by the names of `LOOPS`, each about its feedback, for s = jω."""

    def rate(axis: int, s: Complex) -> tuple[Complex, Complex]:
        """Return (L, the rate for a rate setpoint)."""
        z = np.exp(STEP_S * s)
        lead = yaw_lead(airframe) if axis == 2 else 0.0
        turned = point.torque_gain * rotors(z, airframe) * (1.0 + lead * (1.0 - 1.0 / z) / STEP_S)
        turned = turned * grown(z, point.rate_damping[axis])
        felt = low_pass(z, 2.0 * math.pi * gains.gyro_cutoff_hz, STEP_S)
        slope = low_pass(z, 2.0 * math.pi * gains.gyro_derivative_cutoff_hz, STEP_S) * (1.0 - 1.0 / z) / STEP_S
        ahead = gains.rate_p[axis] + gains.rate_i[axis] * STEP_S / (z - 1.0)
        loop = turned * felt * (ahead + gains.rate_d[axis] * slope)
        return loop, ahead * turned / (1.0 + loop)

    def attitude(axis: int, s: Complex) -> tuple[Complex, Complex]:
        """Return (L, the attitude for an attitude setpoint, as it stands on average within a sample)."""
        z = np.exp(STEP_S * s)
        _, turning = rate(axis, s)
        asked = gains.attitude_p[axis] * held(z, round(ATTITUDE_PERIOD_US * 1e-6 / STEP_S)) * turning
        loop = asked * grown(z, 0.0)  # the estimator adds up the newest rate
        return loop, loop * between(z) / (1.0 + loop)

    def velocity(axis: int, s: Complex) -> Complex:
        z = np.exp(STEP_S * s)
        samples = round(OUTER_PERIOD_US * 1e-6 / STEP_S)
        period, slow = samples * STEP_S, z**samples
        felt = low_pass(slow, ACCELERATION_CUTOFF, period) * (1.0 - 1.0 / z) / STEP_S
        asked = gains.velocity_p[axis] + gains.velocity_i[axis] * period / (slow - 1.0) + gains.velocity_d[axis] * felt
        pushed = point.lift_gain * rotors(z, airframe) if axis == 2 else attitude(1, s)[1] * between(z)
        loop: Complex = asked * held(z, samples) * pushed * grown(z, point.velocity_damping[axis])
        return loop

    def first(part: Callable[[int, Complex], tuple[Complex, Complex]], axis: int) -> Response:
        return lambda s: part(axis, s)[0]

    return {
        **{f"{name} rate": first(rate, axis) for axis, name in enumerate(TURNS)},
        **{f"{name} attitude": first(attitude, axis) for axis, name in enumerate(TURNS)},
        "horizontal velocity": lambda s: velocity(0, s),
        "vertical velocity": lambda s: velocity(2, s),
    }


def delay_margin(loop: Response, frequencies: NDArray[np.float64] = DENSE) -> DelayMargin:
    """Return the least delay in the feedback that makes a loop oscillate, from python-control's phase margins.

    A delay τ turns the phase by -τω at a crossover ω and leaves the gain alone, so it is the phase margin over ω, the
    least over all crossovers.
    """
    import control

    response = control.FRD(loop(1j * frequencies), frequencies)
    _, phases, _, _, crossovers, _ = control.stability_margins(response, returnall=True)
    found = [
        DelayMargin(math.radians(float(phase) % 360.0) / float(omega), float(omega))
        for phase, omega in zip(phases, crossovers, strict=True)
        if math.isfinite(phase) and omega > 0.0
    ]
    return min(found, key=lambda each: each.delay_s, default=DelayMargin(math.inf, math.nan))


def designed(airframe: Airframe, gains: Gains, loop: CascadeLoop) -> DelayMargin:
    """Return the delay margin of a loop as `dronecats tune` draws it: on the airframe's constants alone."""
    return delay_margin(loops(airframe, gains)[loop.name], FREQUENCIES)
