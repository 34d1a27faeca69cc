"""LAND and DESCEND: down to the ground, with and without a position to hold."""

import math

from autopilot.commander.modes.flight import FlightContext, Mode
from autopilot.commander.modes.setpoint import NAN, CascadeSetpoint
from foundation.frames import Vec3

STOPPED_SPEED = 0.5  # m/s


def landing_speed(flight: FlightContext) -> float:
    """Return the sink rate (m/s): MPC_Z_V_AUTO_DN above MPC_LAND_ALT1, MPC_LAND_SPEED below MPC_LAND_ALT2."""
    p = flight.parameters
    high, low = float(p["MPC_LAND_ALT1"]), float(p["MPC_LAND_ALT2"])
    fast, slow = float(p["MPC_Z_V_AUTO_DN"]), float(p["MPC_LAND_SPEED"])
    share = (flight.height_above_ground() - low) / max(high - low, 0.1)
    return slow + (max(fast, slow) - slow) * min(max(share, 0.0), 1.0)


class Land(Mode):
    """Stops, latches the place and sinks over it; the commander disarms once it stands."""

    def __init__(self) -> None:
        self._place: Vec3 | None = None
        self._yaw = 0.0

    def enter(self, flight: FlightContext) -> None:
        self._place, self._yaw = None, flight.state.yaw

    def over(self, place_ned: Vec3) -> None:
        """Land over a chosen local position rather than where the vehicle stops."""
        self._place = place_ned

    def setpoint(self, flight: FlightContext) -> CascadeSetpoint:
        state, sink = flight.state, landing_speed(flight)
        if self._place is None and math.hypot(state.velocity_ned[0], state.velocity_ned[1]) < STOPPED_SPEED:
            self._place = state.position_ned
        if self._place is None:
            return CascadeSetpoint(velocity_ned=(0.0, 0.0, sink), yaw=self._yaw, speed_limit_down=max(sink, 1.5))
        return CascadeSetpoint(
            position_ned=(self._place[0], self._place[1], NAN),
            velocity_ned=(NAN, NAN, sink),
            yaw=self._yaw,
            speed_limit_down=max(sink, 1.5),
            speed_limit_horizontal=2.0,
        )


class Descend(Mode):
    """Sinks at MPC_LAND_SPEED without a place to hold: what is left when the position or the pilot is gone."""

    def __init__(self) -> None:
        self._yaw = 0.0

    def enter(self, flight: FlightContext) -> None:
        self._yaw = flight.state.yaw

    def setpoint(self, flight: FlightContext) -> CascadeSetpoint:
        sink = float(flight.parameters["MPC_LAND_SPEED"])
        if flight.state.velocity_valid:
            return CascadeSetpoint(velocity_ned=(0.0, 0.0, sink), yaw=self._yaw)
        return CascadeSetpoint(velocity_ned=(NAN, NAN, sink), acceleration_ned=(0.0, 0.0, NAN), yaw=self._yaw)
