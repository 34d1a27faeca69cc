"""OFFBOARD: the newest external setpoint, made safe for the cascade."""

import math

from autopilot.modes.flight import Flight, Mode
from autopilot.modes.setpoint import FREE, Setpoint
from autopilot.records import KIND_TRAJECTORY


def flyable(setpoint: Setpoint) -> bool:
    """Return whether the cascade can fly a trajectory setpoint: z controlled, and north and east controlled alike."""
    p, v, a = setpoint.position_ned, setpoint.velocity_ned, setpoint.acceleration_ned
    for axis in range(3):
        if not (math.isfinite(p[axis]) or math.isfinite(v[axis]) or math.isfinite(a[axis])):
            return False
    return all(math.isfinite(kind[0]) == math.isfinite(kind[1]) for kind in (p, v, a))


class Offboard(Mode):
    """Passes the setpoint on with the limits of the mode; one that cannot be flown stops the vehicle, as on PX4."""

    def __init__(self) -> None:
        self._source: Setpoint | None = None
        self._setpoint = Setpoint()

    def enter(self, flight: Flight) -> None:
        self._source = None

    def setpoint(self, flight: Flight) -> Setpoint:
        source = flight.offboard.setpoint
        if source is not self._source:
            self._source = source
            self._setpoint = self._limited(flight, source)
        return self._setpoint

    @staticmethod
    def _limited(flight: Flight, source: Setpoint) -> Setpoint:
        p = flight.parameters
        if source.kind != KIND_TRAJECTORY:
            return source
        yaw_free = not math.isfinite(source.yaw) and not math.isfinite(source.yaw_rate)
        flies = flyable(source)
        return source._replace(
            velocity_ned=source.velocity_ned if flies else (0.0, 0.0, 0.0),
            position_ned=source.position_ned if flies else FREE,
            acceleration_ned=source.acceleration_ned if flies else FREE,
            yaw_rate=0.0 if yaw_free else source.yaw_rate,
            speed_limit_up=float(p["MPC_Z_VEL_MAX_UP"]),
            speed_limit_down=float(p["MPC_Z_VEL_MAX_DN"]),
            speed_limit_horizontal=float(p["MPC_XY_VEL_MAX"]),
        )
