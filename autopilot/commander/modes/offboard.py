"""OFFBOARD: the newest external setpoint, made safe for the cascade."""

import math

from autopilot.commander.modes.flight import FlightContext, Mode
from autopilot.records import FREE, KIND_TRAJECTORY, CascadeSetpoint


def flyable(setpoint: CascadeSetpoint) -> bool:
    """Return whether the cascade can fly a trajectory setpoint: z controlled, and north and east controlled alike."""
    finite = math.isfinite
    pn, pe, pd = setpoint.position_ned
    vn, ve, vd = setpoint.velocity_ned
    an, ae, ad = setpoint.acceleration_ned
    place, speed, push = finite(pn), finite(vn), finite(an)
    return (
        (place or speed or push)
        and (finite(pd) or finite(vd) or finite(ad))
        and place == finite(pe)
        and speed == finite(ve)
        and push == finite(ae)
    )


class Offboard(Mode):
    """Passes the setpoint on with the limits of the mode; one that cannot be flown stops the vehicle, as on PX4."""

    def __init__(self) -> None:
        self._source: CascadeSetpoint | None = None
        self._setpoint = CascadeSetpoint()

    def enter(self, flight: FlightContext) -> None:
        self._source = None

    def setpoint(self, flight: FlightContext) -> CascadeSetpoint:
        source = flight.offboard.setpoint
        if source is not self._source:
            self._source = source
            self._setpoint = self._limited(flight, source)
        return self._setpoint

    @staticmethod
    def _limited(flight: FlightContext, source: CascadeSetpoint) -> CascadeSetpoint:
        p = flight.parameters
        if source.kind != KIND_TRAJECTORY:
            return source
        yaw_free = not math.isfinite(source.yaw) and not math.isfinite(source.yaw_rate)
        flies = flyable(source)
        return CascadeSetpoint(
            source.kind,
            source.position_ned if flies else FREE,
            source.velocity_ned if flies else (0.0, 0.0, 0.0),
            source.acceleration_ned if flies else FREE,
            source.yaw,
            0.0 if yaw_free else source.yaw_rate,
            source.attitude,
            source.rates_frd,
            source.thrust,
            float(p["MPC_Z_VEL_MAX_UP"]),
            float(p["MPC_Z_VEL_MAX_DN"]),
            float(p["MPC_XY_VEL_MAX"]),
            source.thrust_limit,
        )
