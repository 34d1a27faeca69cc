"""What the vehicle does by itself when something is lost: one table from condition to action.

The more severe of several actions wins. Sources: PX4 docs/en/config/safety.md and the parameter reference.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum

from autopilot.commander.health import POSITION_MODES, STICK_MODES
from autopilot.parameters import ParameterTable


class Reaction(IntEnum):
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
    sticks: bool  # somebody holds them
    sticks_lost_s: float  # s since the last MANUAL_CONTROL; nan when the flight began without sticks
    station_lost_s: float  # s since the last ground station heartbeat; nan when there never was one
    battery: float  # 0 … 1, nan when unknown
    battery_at_arming: float
    position_valid: bool
    velocity_valid: bool
    altitude_valid: bool
    flight_time_s: float
    fence_breach: str  # which limit, empty when none
    attitude_failed: bool
    just_armed: bool  # within COM_LKDOWN_TKO of the spool-up


@dataclass(frozen=True, slots=True)
class Failsafe:
    """A reaction and its cause."""

    cause: str = ""
    action: Reaction = Reaction.NONE
    shown: str = ""  # the manual mode that STICKS shows
    delayed: bool = True  # COM_FAIL_ACT_T of HOLD come first; not where the mode itself can no longer be flown
    sticky: bool = False  # lasts until another mode is chosen, although the condition has passed


QUIET = Failsafe()
FENCE_BREACHED, OFFBOARD_LOST, POSITION_LOST = "geofence breached", "offboard signal lost", "position lost"
FLIGHT_TERMINATION_BREAKER = 121212  # CBRK_FLIGHTTERM: termination by the failure detector is switched off
_LINK_ACTIONS = {1: Reaction.HOLD, 2: Reaction.RETURN, 3: Reaction.LAND, 5: Reaction.TERMINATE, 6: Reaction.DISARM}
_OFFBOARD_ACTIONS = {3: Reaction.RETURN, 4: Reaction.LAND, 5: Reaction.HOLD, 6: Reaction.TERMINATE, 7: Reaction.DISARM}
_OFFBOARD_STICKS = {0: "POSCTL", 1: "ALTCTL", 2: "STABILIZED"}
_FENCE_ACTIONS = {1: Reaction.WARN, 2: Reaction.HOLD, 3: Reaction.RETURN, 4: Reaction.TERMINATE, 5: Reaction.LAND}
_LANDING = frozenset({"LAND", "PRECLAND"})
# a lost link stops no landing, and a take-off only once it has reached its height: it is safer there than at half of it
_NEAR_GROUND = _LANDING | {"TAKEOFF"}
_AUTO = ("HOLD", "TAKEOFF", "LAND", "PRECLAND", "RETURN", "ORBIT", "FOLLOW")
_EXEMPT_BIT = {"MISSION": 1, "OFFBOARD": 4} | dict.fromkeys(_AUTO, 2)  # COM_RCL_EXCEPT, COM_DLL_EXCEPT


def _offboard_loss(c: Conditions, p: ParameterTable) -> Failsafe:
    if c.mode != "OFFBOARD" or c.offboard_signal:
        return QUIET
    choice = int(p["COM_OBL_RC_ACT"])
    action = _OFFBOARD_ACTIONS.get(choice, Reaction.STICKS)
    return Failsafe(OFFBOARD_LOST, action, _OFFBOARD_STICKS.get(choice, "POSCTL"), delayed=False)


def _manual_control_loss(c: Conditions, p: ParameterTable) -> Failsafe:
    if not c.sticks_lost_s > p["COM_RC_LOSS_T"] or p["COM_RC_IN_MODE"] == 4:
        return QUIET
    if int(p["COM_RCL_EXCEPT"]) & _EXEMPT_BIT.get(c.mode, 0) or c.mode in _NEAR_GROUND:
        return QUIET
    return Failsafe("manual control lost", _LINK_ACTIONS.get(int(p["NAV_RCL_ACT"]), Reaction.NONE))


def _station_loss(c: Conditions, p: ParameterTable) -> Failsafe:
    if not c.station_lost_s > p["COM_DL_LOSS_T"] or c.mode in _NEAR_GROUND:
        return QUIET
    if int(p["COM_DLL_EXCEPT"]) & _EXEMPT_BIT.get(c.mode, 0):
        return QUIET
    return Failsafe("ground station lost", _LINK_ACTIONS.get(int(p["NAV_DLL_ACT"]), Reaction.NONE))


def _battery(c: Conditions, p: ParameterTable) -> Failsafe:
    emergency, critical, low = p["BAT_EMERGEN_THR"], p["BAT_CRIT_THR"], p["BAT_LOW_THR"]
    if not c.battery < low or (c.battery_at_arming < low and c.battery >= critical):
        return QUIET  # a level that was there at arming is no news
    acts = int(p["COM_LOW_BAT_ACT"])
    if c.battery < emergency and acts in (2, 3):
        return Failsafe("battery at emergency level", Reaction.LAND)
    if c.battery < critical and acts == 4:
        return Failsafe("battery at critical level", Reaction.TERMINATE)
    if c.battery < critical and acts in (2, 3):
        return Failsafe("battery at critical level", Reaction.LAND if acts == 2 else Reaction.RETURN)
    return Failsafe("battery at critical level" if c.battery < critical else "battery low", Reaction.WARN)


def _position_loss(c: Conditions, p: ParameterTable) -> Failsafe:
    if c.mode == "ALTCTL" and not c.altitude_valid:
        return Failsafe("altitude lost", Reaction.STICKS, "STABILIZED", delayed=False)
    if c.position_valid or c.mode not in POSITION_MODES:
        return QUIET
    if c.mode == "POSCTL" and c.sticks:
        shown = "ALTCTL" if c.altitude_valid else "STABILIZED"
        return Failsafe(POSITION_LOST, Reaction.STICKS, shown, delayed=False)
    return Failsafe(POSITION_LOST, Reaction.LAND if c.velocity_valid else Reaction.DESCEND, delayed=False)


def _flight_time(c: Conditions, p: ParameterTable) -> Failsafe:
    over = 0 < p["COM_FLT_TIME_MAX"] < c.flight_time_s
    return Failsafe("flight time over", Reaction.RETURN) if over else QUIET


def _fence(c: Conditions, p: ParameterTable) -> Failsafe:
    if not c.fence_breach:
        return QUIET
    action = _FENCE_ACTIONS.get(int(p["GF_ACTION"]), Reaction.NONE)
    return Failsafe(FENCE_BREACHED, action, sticky=action in (Reaction.RETURN, Reaction.LAND))


def _attitude_failure(c: Conditions, p: ParameterTable) -> Failsafe:
    if not c.attitude_failed:
        return QUIET
    if c.just_armed:
        return Failsafe("attitude failure", Reaction.DISARM)
    if p["CBRK_FLIGHTTERM"] == FLIGHT_TERMINATION_BREAKER:
        return Failsafe("attitude failure", Reaction.WARN)
    return Failsafe("attitude failure", Reaction.TERMINATE)


TABLE: tuple[Callable[[Conditions, ParameterTable], Failsafe], ...] = (
    _offboard_loss,
    _manual_control_loss,
    _station_loss,
    _battery,
    _position_loss,
    _flight_time,
    _fence,
    _attitude_failure,
)


def evaluate(conditions: Conditions, parameters: ParameterTable, overridden: frozenset[str] = frozenset()) -> Failsafe:
    """Return the most severe reaction due now. Causes in `overridden` (the pilot chose otherwise) only warn."""
    worst = QUIET
    for rule in TABLE:
        found = rule(conditions, parameters)
        if found.action == Reaction.RETURN and (conditions.mode == "RETURN" or conditions.mode in _LANDING):
            found = Failsafe(found.cause, Reaction.WARN)  # it is on its way already
        if found.cause in overridden and Reaction.WARN < found.action < Reaction.DISARM:
            found = Failsafe(found.cause, Reaction.WARN)
        if found.action > worst.action:
            worst = found
    return worst


def reaction(failsafe: Failsafe, intended: str, *, sticks: bool, position: bool, home: bool) -> tuple[str, str]:
    """Return (mode shown, behaviour flown) for a failsafe, from what is available.

    A manual mode without sticks is shown all the same while the vehicle sinks at MPC_LAND_SPEED, as measured on PX4.
    """
    action = failsafe.action
    if action in (Reaction.NONE, Reaction.WARN, Reaction.STICKS, Reaction.DISARM):
        shown = failsafe.shown if action == Reaction.STICKS else intended
        return shown, "DESCEND" if shown in STICK_MODES and not sticks else shown
    if action == Reaction.TERMINATE:
        return "TERMINATION", "TERMINATION"
    if action == Reaction.HOLD and position:
        return "HOLD", "HOLD"
    if action == Reaction.RETURN and position and home:
        return "RETURN", "RETURN"
    return "LAND", "LAND" if position else "DESCEND"


def seconds_since(now_us: int, stamp_us: int | None) -> float:
    """Return the age in s, nan when it never happened."""
    return math.nan if stamp_us is None or stamp_us < 0 else (now_us - stamp_us) * 1e-6
