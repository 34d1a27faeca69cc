"""Rotors and battery: actuator commands set the rotor speeds, which set the force and moment on the body.

Rotors are not perfectly balanced. The heavy side of a rotor shakes the frame once per turn. Its force grows with
the square of the speed. So accelerometer and gyroscope measure vibration as on a real frame.

Signs: body axes are forward, right, down. A rotor of spin +1 turns counter-clockwise seen from above, that is about -z;
its drag torque turns the body about +z.
"""

import math

import numpy as np

from foundation.compiled import Record, njit
from foundation.frames import Vec3
from vehicles.records import STEP_S, Load

NOMINAL_CELL_V = 3.8  # V per cell at which a rotor reaches its `speed_max`: a LiPo cell in mid-discharge
PERIOD_US = 10_000  # µs between updates of the battery, which changes slowly
EFFICIENCY = 0.7  # shaft power / electrical power of motor and speed controller; usual for hobby power trains

# V per cell at 0, 5, 10, 20 … 100 % charge at rest: the usual shape of a LiPo's discharge curve at low current.
_CHARGE = np.array([0.0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0])
_VOLTAGE = np.array([3.0, 3.45, 3.62, 3.72, 3.76, 3.79, 3.83, 3.88, 3.94, 4.01, 4.09, 4.2])
COLLAPSE = -0.01  # charge (share of the capacity) at which the voltage of an over-discharged pack is 0


@njit(cache=True)
def open_circuit(charge: float) -> float:
    """Return the volts of one cell at rest for a charge in [0, 1]; below 0 they fall to 0 at COLLAPSE."""
    volts: float = _VOLTAGE[-1]
    if charge <= 0.0:
        volts = max(_VOLTAGE[0] * (1.0 - charge / COLLAPSE), 0.0)
        return volts
    for i in range(1, len(_CHARGE)):
        if charge <= _CHARGE[i]:
            share = (charge - _CHARGE[i - 1]) / (_CHARGE[i] - _CHARGE[i - 1])
            volts = _VOLTAGE[i - 1] + share * (_VOLTAGE[i] - _VOLTAGE[i - 1])
            break
    return volts


@njit(cache=True)
def drain_battery(params: Record, state: Record) -> None:
    """Drain the pack by the present power over `PERIOD_US`; writes charge, voltage and current."""
    rest = params.cells * open_circuit(state.charge_ah / params.capacity_ah)
    power = state.rotor_power / EFFICIENCY + params.avionics_w
    # this uses the terminal voltage of the last update, which differs negligibly at 100 Hz
    current = power / max(state.voltage, 0.5 * rest, 0.1) if rest > 0.0 else 0.0
    state.current = current
    state.voltage = max(rest - current * params.resistance_ohm, 0.0)
    state.charge_ah = max(state.charge_ah - current * PERIOD_US / 3.6e9, params.charge_least_ah)


# Advance ratio V / (n·D) at which a fixed-pitch propeller has no thrust. UIUC Propeller Data Site: 10x4.7 and 5x3
# propellers reach C_T = 0 between 0.6 and 0.7, and C_T falls almost linearly towards it.
ADVANCE_ZERO_THRUST = 0.65
# Torque at ADVANCE_ZERO_THRUST, as a share of the static torque. Same source: C_P is about half of its static value.
TORQUE_LEFT = 0.5
# Highest thrust factor in descent. In a faster descent, the rotor meets its own wake and the linear law does not hold.
THRUST_GAIN_MAX = 1.5
# height in rotor radii; the formula of Cheeseman and Bennett (1955) holds above it. Below, the gain is constant.
GROUND_EFFECT_NEAREST = 0.5
GROUND_EFFECT_FARTHEST = 4.0  # height in rotor radii; higher up, the gain of less than 0.4 % is neglected
# m/s, speed of a rotor's centre of mass around its axis at hover: balance grade G 16 of ISO 21940-11, the coarse
# grade for propeller shafts. The hovering X500 then vibrates with 0.4 m/s² (1σ) on each axis. Quadrotors in public PX4
# logs (the test files of flight-review-rs; means over 5 ms, above 10 Hz) have 1.3 to 2.2 m/s² forward and right, 1.4 to
# 5.2 m/s² down.
IMBALANCE_SPEED = 0.016
FIRST_TURN = 2.4  # rad between the first angles of successive rotors, so that they do not shake in phase
REVOLUTION = 2.0 * math.pi
STANDSTILL = 0.1  # rad/s, speed below which a rotor that slows down stops


@njit(cache=True)
def commanded_speed(armed: int, command: float, idle: float, ceiling: float) -> float:
    """Return the commanded speed (rad/s) of a rotor, from `idle` to `ceiling` (rad/s); 0 if disarmed."""
    if armed == 0:
        return 0.0
    share = command if command > 0.0 else 0.0  # a NaN command compares false and gives idle speed
    if share > 1.0:
        share = 1.0
    return max(share * ceiling, idle)


@njit(cache=True)
def inflow_gain(climb: float, speed: float, radius: float) -> tuple[float, float]:
    """Return factors (thrust, torque) for an axial climb speed (m/s) at a rotor speed (rad/s); both are 1 at hover."""
    if speed < 1.0:
        return 0.0, 0.0
    advance = math.pi * climb / (speed * radius) / ADVANCE_ZERO_THRUST  # J = V / (n·D) = π·V / (ω·R)
    thrust = min(max(1.0 - advance, 0.0), THRUST_GAIN_MAX)
    return thrust, TORQUE_LEFT + (1.0 - TORQUE_LEFT) * thrust


@njit(cache=True)
def ground_gain(height: float, radius: float) -> float:
    """Return the thrust near the ground relative to free air. `height`: m from the ground to the rotor disc."""
    if height > GROUND_EFFECT_FARTHEST * radius:
        return 1.0
    z = max(height, GROUND_EFFECT_NEAREST * radius)
    return 1.0 / (1.0 - (radius / (4.0 * z)) ** 2)


@njit(cache=True)
def advance_rotors(
    params: Record, state: Record, actuators: Record, air: Vec3, rates: Vec3, near_ground: float
) -> Load:
    """Advance the rotor speeds by one step and return the load of the rotors on the body.

    `air` (m/s, FRD) is the body's velocity through the air, `near_ground` the factor of `ground_gain`.
    Returns (force N FRD, moment N·m FRD, angular momentum of the rotors about z in N·m·s); writes the shaft power.
    """
    fx = fy = fz = mx = my = mz = momentum = power = 0.0
    thrust_coefficient, torque_coefficient = params.thrust_coefficient, params.torque_coefficient
    armed = actuators.armed
    ceiling = params.speed_max * state.voltage / (NOMINAL_CELL_V * params.cells)  # rad/s at this voltage
    idle = min(params.speed_idle, ceiling)
    for i in range(params.rotors):
        x, y, z = params.rotor_position[i, 0], params.rotor_position[i, 1], params.rotor_position[i, 2]
        spin = params.rotor_spin[i]
        before = state.rotor_speed[i]
        share = state.rotor_health[i] * state.rotor_fault[i]
        error = commanded_speed(armed, actuators.command[i], idle, ceiling) * share - before
        change = error * (params.gain_up if error > 0.0 else params.gain_down)
        if error < 0.0 and before < STANDSTILL:
            change = error  # stiction stops the rotor; an exponential never reaches 0
        speed = before + change
        state.rotor_speed[i] = speed

        # velocity of the hub through the air
        u = air[0] + rates[1] * z - rates[2] * y
        v = air[1] + rates[2] * x - rates[0] * z
        w = air[2] + rates[0] * y - rates[1] * x
        gain_thrust, gain_torque = inflow_gain(-w, speed, params.rotor_radius)
        thrust = thrust_coefficient * speed * speed * gain_thrust * near_ground
        torque = torque_coefficient * speed * speed * gain_torque
        drag = params.blade_drag * speed
        # The heavy side pulls outwards as it turns. The arms bend, so that a force of about the same size acts along z.
        turn = state.rotor_turn[i] + speed * STEP_S  # less than one revolution per step
        if turn >= REVOLUTION:
            turn -= REVOLUTION  # same bits as `%`, without the division
        state.rotor_turn[i] = turn
        shake = params.imbalance * speed * speed
        forward = shake * math.cos(turn)
        dx, dy, dz = forward - drag * u, -spin * shake * math.sin(turn) - drag * v, forward - thrust

        fx += dx
        fy += dy
        fz += dz
        mx += y * dz - z * dy
        my += z * dx - x * dz
        mz += x * dy - y * dx + spin * (torque + params.rotor_inertia * change / STEP_S)
        momentum -= spin * params.rotor_inertia * speed
        power += torque * speed
        if change > 0.0:
            power += params.rotor_inertia * change / STEP_S * speed
    state.rotor_power = power
    return (fx, fy, fz), (mx, my, mz), momentum
