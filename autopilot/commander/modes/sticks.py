"""From stick deflections to what they mean: deadzone and expo as PX4's, MPC_HOLD_DZ and MPC_*_EXPO."""

import math

from autopilot.parameters import ParameterTable


def shaped(stick: float, parameters: ParameterTable, expo: str) -> float:
    """Return a deflection (-1 … 1) after the deadzone MPC_HOLD_DZ and the cubic share named by `expo`."""
    dead = float(parameters["MPC_HOLD_DZ"])
    if abs(stick) <= dead:
        return 0.0
    x = math.copysign((min(abs(stick), 1.0) - dead) / (1.0 - dead), stick)
    share = float(parameters[expo])
    return (1.0 - share) * x + share * x**3


def within_circle(forward: float, right: float) -> tuple[float, float]:
    """Return the deflections shortened to unit length, so that a diagonal is not faster."""
    length = math.hypot(forward, right)
    return (forward, right) if length <= 1.0 else (forward / length, right / length)


def super_expo(stick: float, expo: float, extra: float) -> float:
    """Return a rate stick (-1 … 1) with MC_ACRO_EXPO and MC_ACRO_SUPEXPO; full deflection stays full deflection."""
    x = (1.0 - expo) * stick + expo * stick**3
    return x * (1.0 - extra) / (1.0 - abs(stick) * extra)


def throttle_thrust(throttle: float, hover: float, parameters: ParameterTable) -> float:
    """Return the collective thrust (0 … 1) of the throttle (0 … 1).

    MPC_THR_CURVE 0 puts hover thrust at mid-stick, 1 is a straight line; both from MPC_MANTHR_MIN to MPC_THR_MAX.
    """
    least, most = float(parameters["MPC_MANTHR_MIN"]), float(parameters["MPC_THR_MAX"])
    if parameters["MPC_THR_CURVE"] == 1:
        return least + (most - least) * throttle
    if throttle < 0.5:
        return least + (hover - least) * 2.0 * throttle
    return hover + (most - hover) * (2.0 * throttle - 1.0)
