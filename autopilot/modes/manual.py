"""POSCTL, ALTCTL and STABILIZED, flown by MANUAL_CONTROL."""

import math

from autopilot.modes.flight import Flight, Mode
from autopilot.modes.setpoint import FREE, NAN, Setpoint
from autopilot.records import KIND_ATTITUDE
from dronecats.border.frames import GRAVITY, Vec3, quat_from_euler

DEADZONE = 0.05
HOLD_SPEED = 0.4  # m/s, below which centred sticks latch the position


def _shaped(stick: float) -> float:
    return 0.0 if abs(stick) < DEADZONE else stick


def _climb(flight: Flight) -> float:
    """Return the vertical speed (m/s, NED) that the throttle asks for."""
    stick = _shaped(2.0 * flight.sticks.throttle - 1.0)
    p = flight.parameters
    return -stick * float(p["MPC_Z_VEL_MAX_UP"] if stick > 0.0 else p["MPC_Z_VEL_MAX_DN"])


def _turn(flight: Flight) -> float:
    return _shaped(flight.sticks.yaw) * math.radians(flight.parameters["MPC_MAN_Y_MAX"])


def _rotated(yaw: float, forward: float, right: float) -> tuple[float, float]:
    c, s = math.cos(yaw), math.sin(yaw)
    return c * forward - s * right, s * forward + c * right


class PositionControl(Mode):
    """Sticks command velocity over the heading; centred sticks hold the place."""

    def __init__(self) -> None:
        self._place: Vec3 = FREE

    def enter(self, flight: Flight) -> None:
        self._place = FREE

    def setpoint(self, flight: Flight) -> Setpoint:
        state, sticks = flight.state, flight.sticks
        speed = float(flight.parameters["MPC_VEL_MANUAL"])
        vn, ve = _rotated(state.yaw, _shaped(sticks.forward) * speed, _shaped(sticks.right) * speed)
        vd = _climb(flight)
        held_n, held_e, held_z = self._place
        moving = math.hypot(state.velocity_ned[0], state.velocity_ned[1]) > HOLD_SPEED
        if vn != 0.0 or ve != 0.0 or flight.landed:
            held_n, held_e = NAN, NAN
        elif not math.isfinite(held_n) and not moving:
            held_n, held_e = state.position_ned[0], state.position_ned[1]
        if vd != 0.0 or flight.landed:
            held_z = NAN
        elif not math.isfinite(held_z) and abs(state.velocity_ned[2]) < HOLD_SPEED:
            held_z = state.position_ned[2]
        self._place = (held_n, held_e, held_z)
        return Setpoint(position_ned=self._place, velocity_ned=(vn, ve, vd), yaw_rate=_turn(flight))


class AltitudeControl(Mode):
    """Sticks command tilt; the altitude follows the throttle."""

    def setpoint(self, flight: Flight) -> Setpoint:
        tilt = math.radians(flight.parameters["MPC_MAN_TILT_MAX"])
        forward = GRAVITY * math.tan(tilt * _shaped(flight.sticks.forward))
        right = GRAVITY * math.tan(tilt * _shaped(flight.sticks.right))
        an, ae = _rotated(flight.state.yaw, forward, right)
        return Setpoint(velocity_ned=(NAN, NAN, _climb(flight)), acceleration_ned=(an, ae, NAN), yaw_rate=_turn(flight))


class Stabilized(Mode):
    """Sticks command tilt and thrust; MPC_THR_CURVE 0 puts hover thrust at mid-stick."""

    def setpoint(self, flight: Flight) -> Setpoint:
        sticks = flight.sticks
        tilt = math.radians(flight.parameters["MPC_MAN_TILT_MAX"])
        hover = flight.state.hover_thrust or float(flight.parameters["MPC_THR_HOVER"])
        least, x = float(flight.parameters["MPC_MANTHR_MIN"]), sticks.throttle
        thrust = least + (hover - least) * 2.0 * x if x < 0.5 else hover + (1.0 - hover) * (2.0 * x - 1.0)
        return Setpoint(
            kind=KIND_ATTITUDE,
            attitude=quat_from_euler(tilt * sticks.right, -tilt * sticks.forward, flight.state.yaw),
            yaw_rate=_turn(flight),
            thrust=min(max(thrust, 0.0), 1.0),
        )
