"""The data that the flight modes share, the base class of the modes, and OFFBOARD, which flies external setpoints."""

import math
from dataclasses import dataclass, field

from autopilot.commander.plans import FenceArea, Home, Plans, areas, breach, home_at, mission_failures
from autopilot.estimator.estimated_state import EstimatedState
from autopilot.parameters import ParameterTable
from autopilot.records import FREE, KIND_TRAJECTORY, CascadeSetpoint
from foundation.frames import Vec3


@dataclass(slots=True)
class Received:
    """Data of the newest message of a kind."""

    time_us: int = -1  # µs of arrival, vehicle clock; -1 = never

    def fresh(self, now_us: int, timeout_s: float) -> bool:
        """Return whether the message arrived at most `timeout_s` ago."""
        return self.time_us >= 0 and now_us - self.time_us <= timeout_s * 1e6


@dataclass(slots=True)
class Sticks(Received):
    """The stick positions in the newest MANUAL_CONTROL."""

    forward: float = 0.0  # -1 … 1
    right: float = 0.0  # -1 … 1
    throttle: float = 0.0  # 0 … 1, 0.5 = hold altitude in the assisted modes
    yaw: float = 0.0  # -1 … 1, positive clockwise


@dataclass(slots=True)
class OffboardSignal(Received):
    """The newest valid offboard setpoint. It is stored in every mode, not only in OFFBOARD."""

    setpoint: CascadeSetpoint = field(default_factory=CascadeSetpoint)

    def supported(self, state: EstimatedState) -> bool:
        """Return whether the estimate of the quantity in the setpoint is valid (PX4 offboardCheck)."""
        s = self.setpoint
        if math.isfinite(s.position_ned[0]):
            return bool(state.position_valid)
        if math.isfinite(s.velocity_ned[0]):
            return bool(state.velocity_valid)
        return bool(state.attitude_valid)


@dataclass(slots=True)
class FollowedTarget(Received):
    """The newest FOLLOW_TARGET."""

    position_ned: Vec3 = (math.nan, math.nan, math.nan)  # m, local frame
    velocity_ned: Vec3 = (0.0, 0.0, 0.0)  # m/s; zero when the sender does not know it


@dataclass(slots=True)
class FlightContext:
    """The data that all modes share. The commander owns it."""

    state: EstimatedState
    parameters: ParameterTable
    home: Home | None = None
    landed: bool = True
    cruise_speed: float = math.nan  # m/s, set by DO_CHANGE_SPEED until the mode changes; nan = MPC_XY_CRUISE
    sticks: Sticks = field(default_factory=Sticks)
    offboard: OffboardSignal = field(default_factory=OffboardSignal)
    target: FollowedTarget = field(default_factory=FollowedTarget)
    plans: Plans = field(default_factory=Plans)
    _areas: tuple[FenceArea, ...] = ()  # last result of `fence_areas`
    _areas_of: tuple[int, float, float] | None = None  # version of the plans and origin, for which `_areas` holds

    def height_above_ground(self) -> float:
        """Return the height (m): the downward range if fresh, else above home, else above the local frame's origin."""
        distance = self.state.range_m()
        if math.isfinite(distance):
            return distance
        ground = self.home.position_ned[2] if self.home is not None else 0.0
        return ground - self.state.position_ned[2]

    def set_home(self, position_ned: Vec3 | None = None) -> bool:
        """Set home at a local position (m), by default the vehicle's. Returns False without a global position."""
        home = home_at(self.state, position_ned)
        self.home = home or self.home
        return home is not None

    def renew_home(self) -> None:
        """Set home at the vehicle's position, unless a client has chosen home (PX4's manual home)."""
        if self.home is None or not self.home.manual:
            self.set_home()

    def fence_areas(self) -> tuple[FenceArea, ...]:
        """Return the areas of the geofence; none before the local frame's origin is known."""
        if not self.plans.fence or not self.state.origin_set:
            return ()
        key = (self.plans.version, self.state.origin_lat_deg, self.state.origin_lon_deg)
        if key != self._areas_of:
            self._areas_of, self._areas = key, areas(self.plans.fence, self.state)
        return self._areas

    def breach(self) -> str:
        """Return the limit of the geofence that the vehicle's position breaks; empty if none."""
        return breach(self.state.position_ned, self.home, self.parameters, self.fence_areas())

    def mission_failures(self) -> list[str]:
        """Return the reasons why the mission cannot be flown from here; empty if it can."""
        return mission_failures(self.plans.mission, self.state, self.home, self.parameters, self.fence_areas())

    def change_speed(self, speed: float) -> None:
        """Set the horizontal speed (m/s) until the mode changes. A value not in (0, inf) restores MPC_XY_CRUISE."""
        limit = float(self.parameters["MPC_XY_VEL_MAX"])
        self.cruise_speed = min(speed, limit) if 0.0 < speed < math.inf else math.nan

    def cruise(self) -> float:
        """Return the horizontal speed (m/s) of automatic flight."""
        return self.cruise_speed if math.isfinite(self.cruise_speed) else float(self.parameters["MPC_XY_CRUISE"])


class Mode:
    """The behaviour of a flight mode: `enter` is called when the mode begins, `setpoint` at every tick after that."""

    next_mode: str | None = None  # next mode, set when this mode has finished
    rest: Vec3 | None = None  # m, local frame: the position for HOLD after the mode has finished

    def enter(self, flight: FlightContext) -> None:
        """Start the mode from the vehicle's present state."""

    def setpoint(self, flight: FlightContext) -> CascadeSetpoint:
        """Return the setpoint of this tick."""
        raise NotImplementedError


def flyable(setpoint: CascadeSetpoint) -> bool:
    """Return whether a trajectory setpoint has enough finite values for the cascade.

    The cascade needs a vertical and a horizontal quantity (position, velocity or acceleration). The north and the east
    component of a quantity must both be finite, or both not.
    """
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
    """OFFBOARD: adds speed limits to the external setpoint. A setpoint that is not `flyable` stops the vehicle."""

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
