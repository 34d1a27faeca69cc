"""What the vehicle does by itself when something is lost: one table from condition to action.

The more severe of several actions wins. Sources: PX4 docs/en/config/safety.md and the parameter reference.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum

from autopilot.arming import POSITION_MODES, STICK_MODES
from autopilot.modes.flight import Flight
from autopilot.parameters import Parameters


class Action(IntEnum):
    """Reactions in order of severity."""

    NONE = 0
    WARN = 1
    STICKS = 2  # a manual mode, or a descent under its name when nobody holds the sticks
    HOLD = 3
    RETURN = 4
    LAND = 5
    DESCEND = 6
    DISARM = 7
    TERMINATE = 8


@dataclass(frozen=True, slots=True)
class Conditions:
    """What the supervision looks at, gathered by the commander."""

    mode: str  # the mode that was asked for
    offboard_signal: bool
    sticks_lost_s: float  # s since the last MANUAL_CONTROL; nan when the flight began without sticks
    station_lost_s: float  # s since the last ground station heartbeat; nan when there never was one
    battery: float  # 0 … 1, nan when unknown
    battery_at_arming: float
    position_valid: bool
    velocity_valid: bool
    flight_time_s: float
    home_distance_m: float  # horizontal; nan without a home
    home_height_m: float


@dataclass(frozen=True, slots=True)
class Failsafe:
    """A reaction and its cause."""

    cause: str = ""
    action: Action = Action.NONE
    shown: str = ""  # the manual mode that STICKS shows


QUIET = Failsafe()
_LINK_ACTIONS = {1: Action.HOLD, 2: Action.RETURN, 3: Action.LAND, 5: Action.TERMINATE, 6: Action.DISARM}
_OFFBOARD_ACTIONS = {3: Action.RETURN, 4: Action.LAND, 5: Action.HOLD, 6: Action.TERMINATE, 7: Action.DISARM}
_OFFBOARD_STICKS = {0: "POSCTL", 1: "ALTCTL", 2: "STABILIZED"}
_FENCE_ACTIONS = {1: Action.WARN, 2: Action.HOLD, 3: Action.RETURN, 4: Action.TERMINATE, 5: Action.LAND}
_EXEMPT_BIT = {"MISSION": 1, "HOLD": 2, "TAKEOFF": 2, "LAND": 2, "RETURN": 2, "OFFBOARD": 4}  # COM_RCL_EXCEPT


def _offboard_loss(c: Conditions, p: Parameters) -> Failsafe:
    if c.mode != "OFFBOARD" or c.offboard_signal:
        return QUIET
    choice = int(p["COM_OBL_RC_ACT"])
    action = _OFFBOARD_ACTIONS.get(choice, Action.STICKS)
    return Failsafe("offboard signal lost", action, _OFFBOARD_STICKS.get(choice, "POSCTL"))


def _manual_control_loss(c: Conditions, p: Parameters) -> Failsafe:
    if not c.sticks_lost_s > p["COM_RC_LOSS_T"] or int(p["COM_RCL_EXCEPT"]) & _EXEMPT_BIT.get(c.mode, 0):
        return QUIET
    return Failsafe("manual control lost", _LINK_ACTIONS.get(int(p["NAV_RCL_ACT"]), Action.NONE))


def _station_loss(c: Conditions, p: Parameters) -> Failsafe:
    if not c.station_lost_s > p["COM_DL_LOSS_T"] or c.mode == "LAND":
        return QUIET
    return Failsafe("ground station lost", _LINK_ACTIONS.get(int(p["NAV_DLL_ACT"]), Action.NONE))


def _battery(c: Conditions, p: Parameters) -> Failsafe:
    emergency, critical, low = p["BAT_EMERGEN_THR"], p["BAT_CRIT_THR"], p["BAT_LOW_THR"]
    if not c.battery < low or (c.battery_at_arming < low and c.battery >= critical):
        return QUIET  # a level that was there at arming is no news
    acts = int(p["COM_LOW_BAT_ACT"])
    if c.battery < emergency and acts in (2, 3):
        return Failsafe("battery at emergency level", Action.LAND)
    if c.battery < critical and acts == 4:
        return Failsafe("battery at critical level", Action.TERMINATE)
    if c.battery < critical and acts in (2, 3):
        return Failsafe("battery at critical level", Action.LAND if acts == 2 else Action.RETURN)
    return Failsafe("battery at critical level" if c.battery < critical else "battery low", Action.WARN)


def _position_loss(c: Conditions, p: Parameters) -> Failsafe:
    if c.position_valid or c.mode not in POSITION_MODES:
        return QUIET
    return Failsafe("position lost", Action.LAND if c.velocity_valid else Action.DESCEND)


def _flight_time(c: Conditions, p: Parameters) -> Failsafe:
    if not 0 < p["COM_FLT_TIME_MAX"] < c.flight_time_s:
        return QUIET
    return Failsafe("flight time over", Action.RETURN if p["COM_FLTT_LOW_ACT"] == 3 else Action.WARN)


def _fence(c: Conditions, p: Parameters) -> Failsafe:
    beyond = 0 < p["GF_MAX_HOR_DIST"] < c.home_distance_m or 0 < p["GF_MAX_VER_DIST"] < c.home_height_m
    if not beyond:
        return QUIET
    return Failsafe("geofence breached", _FENCE_ACTIONS.get(int(p["GF_ACTION"]), Action.NONE))


TABLE: tuple[Callable[[Conditions, Parameters], Failsafe], ...] = (
    _offboard_loss,
    _manual_control_loss,
    _station_loss,
    _battery,
    _position_loss,
    _flight_time,
    _fence,
)


def evaluate(conditions: Conditions, parameters: Parameters, overridden: frozenset[str] = frozenset()) -> Failsafe:
    """Return the most severe reaction due now. Causes in `overridden` (the pilot chose otherwise) only warn."""
    worst = QUIET
    for rule in TABLE:
        found = rule(conditions, parameters)
        if found.cause in overridden and found.action > Action.WARN:
            found = Failsafe(found.cause, Action.WARN)
        if found.action > worst.action:
            worst = found
    return worst


def reaction(failsafe: Failsafe, intended: str, *, sticks: bool, position: bool, home: bool) -> tuple[str, str]:
    """Return (mode shown, behaviour flown) for a failsafe, from what is available.

    A manual mode without sticks is shown all the same while the vehicle sinks at MPC_LAND_SPEED, as measured on PX4.
    """
    action = failsafe.action
    if action in (Action.NONE, Action.WARN, Action.STICKS, Action.DISARM):
        shown = failsafe.shown if action == Action.STICKS else intended
        return shown, "DESCEND" if shown in STICK_MODES and not sticks else shown
    if action == Action.TERMINATE:
        return "TERMINATION", "TERMINATION"
    if action == Action.HOLD and position:
        return "HOLD", "HOLD"
    if action == Action.RETURN and position and home:
        return "RETURN", "RETURN"
    return "LAND", "LAND" if position else "DESCEND"


def seconds_since(now_us: int, stamp_us: int | None) -> float:
    """Return the age in s, nan when it never happened."""
    return math.nan if stamp_us is None or stamp_us < 0 else (now_us - stamp_us) * 1e-6


def gather(
    flight: Flight,
    intended: str,
    *,
    offboard_signal: bool,
    armed_with_sticks: bool,
    station_heard_us: int | None,
    battery: float,
    battery_at_arming: float,
    takeoff_us: int,
) -> Conditions:
    """Return the conditions of this tick; times are vehicle µs, 0 or None = never."""
    state, home = flight.state, flight.home
    now, (n, e, z) = state.time_us, state.position_ned
    return Conditions(
        mode=intended,
        offboard_signal=offboard_signal,
        sticks_lost_s=seconds_since(now, flight.sticks.time_us) if armed_with_sticks else math.nan,
        station_lost_s=seconds_since(now, station_heard_us),
        battery=battery,
        battery_at_arming=battery_at_arming,
        position_valid=bool(state.position_valid),
        velocity_valid=bool(state.velocity_valid),
        flight_time_s=seconds_since(now, takeoff_us or None),
        home_distance_m=math.hypot(n - home.position_ned[0], e - home.position_ned[1]) if home else math.nan,
        home_height_m=home.position_ned[2] - z if home else math.nan,
    )
