"""TAKEOFF: straight up to MIS_TAKEOFF_ALT above the ground it stands on, then HOLD."""

import math

from autopilot.commander.modes.flight import FlightContext, Mode
from autopilot.commander.modes.setpoint import CascadeSetpoint
from foundation.frames import Vec3

ARRIVED_M = 0.3
LEAST_CLIMB_M = 0.5


class Takeoff(Mode):
    """Climbs at MPC_TKO_SPEED above the place where the mode was entered (or armed)."""

    def __init__(self) -> None:
        self._target: Vec3 = (0.0, 0.0, 0.0)
        self._yaw = 0.0
        self._asked_z = math.nan

    def aim(self, z_ned: float) -> None:
        """Choose the local z (m, NED) to climb to; nan = MIS_TAKEOFF_ALT above the ground. Holds for the next entry."""
        self._asked_z = z_ned

    def enter(self, flight: FlightContext) -> None:
        self.next_mode = None
        n, e, z = flight.state.position_ned
        target = z - float(flight.parameters["MIS_TAKEOFF_ALT"])
        if self._asked_z < z - LEAST_CLIMB_M:  # a lower one (clients send 0 for 'any') or nan means the default
            target = self._asked_z
        elif not flight.landed and flight.home is not None:
            # in the air already: climb to the altitude above home, never down
            target = min(flight.home.position_ned[2] - float(flight.parameters["MIS_TAKEOFF_ALT"]), z)
        self._asked_z = math.nan
        self.rest = self._target = (n, e, target)
        self._yaw = flight.state.yaw

    def setpoint(self, flight: FlightContext) -> CascadeSetpoint:
        if not flight.landed and flight.state.position_ned[2] - self._target[2] < ARRIVED_M:
            self.next_mode = "HOLD"
        return CascadeSetpoint(
            position_ned=self._target,
            yaw=self._yaw,
            speed_limit_up=float(flight.parameters["MPC_TKO_SPEED"]),
            speed_limit_horizontal=2.0,
        )
