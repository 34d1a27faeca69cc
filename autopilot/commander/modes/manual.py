"""Modes that the sticks (MANUAL_CONTROL) control: POSCTL, ALTCTL, STABILIZED and ACRO.

A stick deflection has the same effect as on PX4: deadzone and expo are MPC_HOLD_DZ and MPC_*_EXPO.
"""

import math

from autopilot.commander.modes.flight import FlightContext, Mode
from autopilot.parameters import ParameterTable
from autopilot.records import FREE, KIND_ATTITUDE, KIND_RATES, NAN, CascadeSetpoint
from foundation.frames import GRAVITY, Vec3, quat_from_euler


def shaped(stick: float, parameters: ParameterTable, expo: str) -> float:
    """Return a deflection (-1 … 1) after the deadzone MPC_HOLD_DZ and a cubic expo (parameter `expo`)."""
    dead = float(parameters["MPC_HOLD_DZ"])
    if abs(stick) <= dead:
        return 0.0
    x = math.copysign((min(abs(stick), 1.0) - dead) / (1.0 - dead), stick)
    share = float(parameters[expo])
    return (1.0 - share) * x + share * x**3


def within_circle(forward: float, right: float) -> tuple[float, float]:
    """Return the deflections, limited to a length of 1, so that a diagonal is not faster."""
    length = math.hypot(forward, right)
    return (forward, right) if length <= 1.0 else (forward / length, right / length)


def super_expo(stick: float, expo: float, extra: float) -> float:
    """Return the deflection of a rate stick (-1 … 1) after the two expos of ACRO. Full deflection is unchanged.

    `expo` and `extra` are MC_ACRO_EXPO and MC_ACRO_SUPEXPO (yaw: MC_ACRO_EXPO_Y and MC_ACRO_SUPEXPOY). They are limited
    to 0 … 1 and 0 … 0.99, as in PX4's Functions.hpp.
    """
    expo, extra = min(max(expo, 0.0), 1.0), min(max(extra, 0.0), 0.99)
    x = (1.0 - expo) * stick + expo * stick**3
    return x * (1.0 - extra) / (1.0 - abs(stick) * extra)


def throttle_thrust(throttle: float, hover: float, parameters: ParameterTable) -> float:
    """Return the collective thrust (0 … 1) of the throttle (0 … 1).

    MPC_THR_CURVE 0: hover thrust at mid-stick; 1: a straight line. Both curves run from MPC_MANTHR_MIN to MPC_THR_MAX.
    """
    least, most = float(parameters["MPC_MANTHR_MIN"]), float(parameters["MPC_THR_MAX"])
    if parameters["MPC_THR_CURVE"] == 1:
        return least + (most - least) * throttle
    if throttle < 0.5:
        return least + (hover - least) * 2.0 * throttle
    return hover + (most - hover) * (2.0 * throttle - 1.0)


def climb(flight: FlightContext) -> float:
    """Return the vertical velocity (m/s, NED) that the throttle commands."""
    p = flight.parameters
    stick = shaped(2.0 * flight.sticks.throttle - 1.0, p, "MPC_Z_MAN_EXPO")
    return -stick * float(p["MPC_Z_VEL_MAX_UP"] if stick > 0.0 else p["MPC_Z_VEL_MAX_DN"])


def stick_turn(flight: FlightContext) -> float:
    """Return the yaw rate (rad/s) that the yaw stick commands."""
    return shaped(flight.sticks.yaw, flight.parameters, "MPC_YAW_EXPO") * math.radians(
        flight.parameters["MPC_MAN_Y_MAX"]
    )


def _sticks(flight: FlightContext) -> tuple[float, float]:
    p, sticks = flight.parameters, flight.sticks
    return within_circle(shaped(sticks.forward, p, "MPC_XY_MAN_EXPO"), shaped(sticks.right, p, "MPC_XY_MAN_EXPO"))


def _rotated(yaw: float, forward: float, right: float) -> tuple[float, float]:
    c, s = math.cos(yaw), math.sin(yaw)
    return c * forward - s * right, s * forward + c * right


class HeldHeight:
    """Stores the height to hold, when the throttle is centred and the vehicle is slow (MPC_HOLD_MAX_Z)."""

    def __init__(self) -> None:
        self._z = NAN

    def forget(self) -> None:
        self._z = NAN

    def z(self, flight: FlightContext, speed: float) -> float:
        """Return the height to hold (m, NED); nan while the commanded vertical speed `speed` (m/s) is not 0."""
        if speed != 0.0 or flight.landed:
            self._z = NAN
        elif not math.isfinite(self._z) and abs(flight.state.velocity_ned[2]) < flight.parameters["MPC_HOLD_MAX_Z"]:
            self._z = flight.state.position_ned[2]
        return self._z


class PositionControl(Mode):
    """POSCTL: the sticks command the velocity relative to the heading; centred sticks hold the position."""

    def __init__(self) -> None:
        self._place: Vec3 = FREE
        self._height = HeldHeight()

    def enter(self, flight: FlightContext) -> None:
        self._place = FREE
        self._height.forget()

    def setpoint(self, flight: FlightContext) -> CascadeSetpoint:
        state, p = flight.state, flight.parameters
        forward, right = _sticks(flight)
        ahead, back, side = (float(p[name]) for name in ("MPC_VEL_MANUAL", "MPC_VEL_MAN_BACK", "MPC_VEL_MAN_SIDE"))
        forward *= back if forward < 0.0 <= back else ahead  # a negative limit means the forward limit
        right *= side if side >= 0.0 else ahead
        vn, ve = _rotated(state.yaw, forward, right)
        vd = climb(flight)
        held_n, held_e, _ = self._place
        moving = math.hypot(state.velocity_ned[0], state.velocity_ned[1]) > p["MPC_HOLD_MAX_XY"]
        if vn != 0.0 or ve != 0.0 or flight.landed:
            held_n, held_e = NAN, NAN
        elif not math.isfinite(held_n) and not moving:
            held_n, held_e = state.position_ned[0], state.position_ned[1]
        self._place = (held_n, held_e, self._height.z(flight, vd))
        return CascadeSetpoint(
            position_ned=self._place,
            velocity_ned=(vn, ve, vd),
            yaw_rate=stick_turn(flight),
            speed_limit_up=float(p["MPC_Z_VEL_MAX_UP"]),
            speed_limit_down=float(p["MPC_Z_VEL_MAX_DN"]),
        )


class AltitudeControl(Mode):
    """ALTCTL: the sticks command the tilt; the throttle commands the vertical speed."""

    def __init__(self) -> None:
        self._height = HeldHeight()

    def enter(self, flight: FlightContext) -> None:
        self._height.forget()

    def setpoint(self, flight: FlightContext) -> CascadeSetpoint:
        p = flight.parameters
        tilt = math.radians(p["MPC_MAN_TILT_MAX"])
        forward, right = _sticks(flight)
        an, ae = _rotated(flight.state.yaw, GRAVITY * math.tan(tilt * forward), GRAVITY * math.tan(tilt * right))
        vd = climb(flight)
        return CascadeSetpoint(
            position_ned=(NAN, NAN, self._height.z(flight, vd)),
            velocity_ned=(NAN, NAN, vd),
            acceleration_ned=(an, ae, NAN),
            yaw_rate=stick_turn(flight),
            speed_limit_up=float(p["MPC_Z_VEL_MAX_UP"]),
            speed_limit_down=float(p["MPC_Z_VEL_MAX_DN"]),
        )


def _hover(flight: FlightContext) -> float:
    return flight.state.hover_thrust or float(flight.parameters["MPC_THR_HOVER"])


class Stabilized(Mode):
    """STABILIZED and MANUAL: the sticks command tilt and thrust."""

    def setpoint(self, flight: FlightContext) -> CascadeSetpoint:
        p, sticks = flight.parameters, flight.sticks
        tilt = math.radians(p["MPC_MAN_TILT_MAX"])
        forward, right = within_circle(sticks.forward, sticks.right)
        return CascadeSetpoint(
            kind=KIND_ATTITUDE,
            attitude=quat_from_euler(tilt * right, -tilt * forward, flight.state.yaw),
            yaw_rate=stick_turn(flight),
            thrust=min(max(throttle_thrust(sticks.throttle, _hover(flight), p), 0.0), 1.0),
        )


class Acro(Mode):
    """ACRO: the sticks command body rates (MC_ACRO_*_MAX) and thrust; nothing levels the vehicle."""

    def setpoint(self, flight: FlightContext) -> CascadeSetpoint:
        p, sticks = flight.parameters, flight.sticks
        expo, extra = float(p["MC_ACRO_EXPO"]), float(p["MC_ACRO_SUPEXPO"])
        yaw = super_expo(sticks.yaw, float(p["MC_ACRO_EXPO_Y"]), float(p["MC_ACRO_SUPEXPOY"]))
        return CascadeSetpoint(
            kind=KIND_RATES,
            rates_frd=(
                super_expo(sticks.right, expo, extra) * math.radians(p["MC_ACRO_R_MAX"]),
                -super_expo(sticks.forward, expo, extra) * math.radians(p["MC_ACRO_P_MAX"]),
                yaw * math.radians(p["MC_ACRO_Y_MAX"]),
            ),
            thrust=min(max(throttle_thrust(sticks.throttle, _hover(flight), p), 0.0), 1.0),
        )
