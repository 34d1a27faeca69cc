"""HOLD: stop and stay, or fly to the place that DO_REPOSITION named."""

import math

from autopilot.commander.modes.flight import FlightContext, Mode
from autopilot.commander.modes.setpoint import NAN, CascadeSetpoint
from autopilot.commander.modes.travel import approach_speed
from foundation.frames import Vec3

STOPPED_SPEED = 0.3  # m/s, below which the vehicle counts as stopped and its place is latched
BRAKE_LIMIT_US = 6_000_000  # latch whatever happens after this


class HoldMode(Mode):
    """Brakes on entry, latches the position once slow, then holds it; `go_to` moves the held place."""

    def __init__(self) -> None:
        self._target: Vec3 | None = None
        self._yaw = 0.0
        self._entered_us = 0
        self._z = 0.0

    def enter(self, flight: FlightContext) -> None:
        state = flight.state
        self._target, self._yaw, self._entered_us = None, state.yaw, state.time_us
        self._z = state.position_ned[2]

    def go_to(self, position_ned: Vec3, yaw: float) -> None:
        """Fly to a local position (m); a nan yaw (rad) keeps the present heading."""
        self._target = position_ned
        if math.isfinite(yaw):
            self._yaw = yaw

    def setpoint(self, flight: FlightContext) -> CascadeSetpoint:
        p, state = flight.parameters, flight.state
        up, down = float(p["MPC_Z_V_AUTO_UP"]), float(p["MPC_Z_V_AUTO_DN"])
        if self._target is None:
            vn, ve, vd = state.velocity_ned
            slow = math.sqrt(vn * vn + ve * ve + vd * vd) < STOPPED_SPEED
            if not slow and not flight.landed and state.time_us - self._entered_us < BRAKE_LIMIT_US:
                return CascadeSetpoint(velocity_ned=(0.0, 0.0, 0.0), yaw=self._yaw, yaw_rate=0.0)
            self._target = state.position_ned
        target = self._target
        distance = math.hypot(target[0] - state.position_ned[0], target[1] - state.position_ned[1])
        return CascadeSetpoint(
            position_ned=target,
            yaw=self._yaw,
            yaw_rate=NAN,
            speed_limit_up=up,
            speed_limit_down=down,
            speed_limit_horizontal=approach_speed(distance, flight.cruise(), float(p["MPC_ACC_HOR"])),
        )
