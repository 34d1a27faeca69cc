"""Failsafes: a table of rules from conditions to actions, and the supervision of an armed vehicle.

The most severe of several actions wins. `Supervision` stores the active failsafe, its start, and the causes that the
pilot has overruled. The pilot can take over by moving the sticks (COM_RC_OVERRIDE, COM_RC_STICK_OV). Sources: PX4
docs/en/config/safety.md and the parameter reference.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import NamedTuple

from autopilot.commander.health import (
    EXTERNAL_MODES,
    POSITION_MODES,
    STICK_MODES,
    UNREGISTERED,
    AccuracyWatch,
    AttitudeWatch,
    StatusText,
)
from autopilot.commander.modes.flight import FlightContext, Sticks
from autopilot.parameters import ParameterTable
from foundation.mavlink import dialect


class Reaction(IntEnum):
    """Reactions in order of severity."""

    NONE = 0
    WARN = 1
    STICKS = 2  # a manual mode; the vehicle descends if there is no stick input
    HOLD = 3
    RETURN = 4
    LAND = 5
    DESCEND = 6
    DISARM = 7
    TERMINATE = 8


class Conditions(NamedTuple):
    """The inputs of the rules."""

    mode: str  # the requested mode
    offboard_signal: bool
    sticks: bool  # whether there is stick input
    sticks_lost_s: float  # s since the last MANUAL_CONTROL; nan if there was none in this flight
    station_lost_s: float  # s since the last ground station heartbeat; nan if there never was one
    battery: float  # charge (0 … 1), nan if unknown
    battery_at_arming: float
    position_valid: bool
    velocity_valid: bool
    altitude_valid: bool
    flight_time_s: float  # s since the last lift-off; nan before it
    fence_breach: str  # the limit that is broken, empty if none
    attitude_failed: bool
    just_armed: bool  # within COM_SPOOLUP_TIME + COM_LKDOWN_TKO of the arming


@dataclass(frozen=True, slots=True)
class Failsafe:
    """A reaction and its cause."""

    cause: str = ""
    action: Reaction = Reaction.NONE
    shown: str = ""  # the manual mode, if the action is STICKS
    delayed: bool = True  # the vehicle first holds for COM_FAIL_ACT_T; False if the present mode can no longer fly
    sticky: bool = False  # the action stays after the condition has ended, until another mode is chosen


NO_FAILSAFE = Failsafe()
FENCE_BREACHED, OFFBOARD_LOST, POSITION_LOST = "geofence breached", "offboard signal lost", "position lost"
FLIGHT_TERMINATION_BREAKER = 121212  # CBRK_FLIGHTTERM: this value switches off the termination by the failure detector
_LINK_ACTIONS = {1: Reaction.HOLD, 2: Reaction.RETURN, 3: Reaction.LAND, 5: Reaction.TERMINATE, 6: Reaction.DISARM}
_OFFBOARD_ACTIONS = {3: Reaction.RETURN, 4: Reaction.LAND, 5: Reaction.HOLD, 6: Reaction.TERMINATE, 7: Reaction.DISARM}
_OFFBOARD_STICKS = {0: "POSCTL", 1: "ALTCTL", 2: "STABILIZED"}
_FENCE_ACTIONS = {1: Reaction.WARN, 2: Reaction.HOLD, 3: Reaction.RETURN, 4: Reaction.TERMINATE, 5: Reaction.LAND}
_LANDING = frozenset({"LAND", "PRECLAND"})
# a lost link does not interrupt a landing or a take-off; after a take-off the mode changes, and the failsafe acts
_NEAR_GROUND = _LANDING | {"TAKEOFF"}
_AUTO = ("HOLD", "TAKEOFF", "LAND", "PRECLAND", "RETURN", "ORBIT", "FOLLOW")
_EXEMPT_BIT = {"MISSION": 1, "OFFBOARD": 4} | dict.fromkeys(_AUTO, 2)  # bits in COM_RCL_EXCEPT and COM_DLL_EXCEPT


def _stick_mode(c: Conditions, mode: str) -> str:
    """Return the manual mode `mode`, or the next simpler one that the estimate allows."""
    if mode == "POSCTL" and not c.position_valid:
        mode = "ALTCTL"
    return "STABILIZED" if mode == "ALTCTL" and not c.altitude_valid else mode


def _offboard_loss(c: Conditions, p: ParameterTable) -> Failsafe:
    if c.mode != "OFFBOARD" or c.offboard_signal:
        return NO_FAILSAFE
    choice = int(p["COM_OBL_RC_ACT"])
    action = _OFFBOARD_ACTIONS.get(choice, Reaction.STICKS)
    shown = _OFFBOARD_STICKS.get(choice, "POSCTL")
    return Failsafe(OFFBOARD_LOST, action, _stick_mode(c, shown) if c.sticks else shown, delayed=False)


def _manual_control_loss(c: Conditions, p: ParameterTable) -> Failsafe:
    if not c.sticks_lost_s > p["COM_RC_LOSS_T"] or p["COM_RC_IN_MODE"] == 4:
        return NO_FAILSAFE
    if int(p["COM_RCL_EXCEPT"]) & _EXEMPT_BIT.get(c.mode, 0) or c.mode in _NEAR_GROUND:
        return NO_FAILSAFE
    return _link_loss("manual control lost", p["NAV_RCL_ACT"])


def _station_loss(c: Conditions, p: ParameterTable) -> Failsafe:
    if not c.station_lost_s > p["COM_DL_LOSS_T"] or c.mode in _NEAR_GROUND:
        return NO_FAILSAFE
    if int(p["COM_DLL_EXCEPT"]) & _EXEMPT_BIT.get(c.mode, 0):
        return NO_FAILSAFE
    return _link_loss("ground station lost", p["NAV_DLL_ACT"])


def _link_loss(cause: str, choice: float) -> Failsafe:
    """Return the failsafe of a lost link. A return or landing continues when the link is back: PX4's failsafe.cpp."""
    action = _LINK_ACTIONS.get(int(choice), Reaction.NONE)
    return Failsafe(cause, action, sticky=action in (Reaction.RETURN, Reaction.LAND))


def _battery(c: Conditions, p: ParameterTable) -> Failsafe:
    emergency, critical, low = p["BAT_EMERGEN_THR"], p["BAT_CRIT_THR"], p["BAT_LOW_THR"]
    if not c.battery < low or (c.battery_at_arming < low and c.battery >= critical):
        return NO_FAILSAFE  # no warning if the battery was already low at arming
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
        return NO_FAILSAFE
    if c.mode == "POSCTL" and c.sticks:
        return Failsafe(POSITION_LOST, Reaction.STICKS, _stick_mode(c, "POSCTL"), delayed=False)
    return Failsafe(POSITION_LOST, Reaction.LAND if c.velocity_valid else Reaction.DESCEND, delayed=False)


def _no_such_mode(c: Conditions, p: ParameterTable) -> Failsafe:
    """Return home from an external mode, as PX4 does. Only a forced arming can lead to such a mode."""
    return Failsafe(UNREGISTERED, Reaction.RETURN, delayed=False) if c.mode in EXTERNAL_MODES else NO_FAILSAFE


def _flight_time(c: Conditions, p: ParameterTable) -> Failsafe:
    over = 0 < p["COM_FLT_TIME_MAX"] < c.flight_time_s
    return Failsafe("flight time over", Reaction.RETURN) if over else NO_FAILSAFE


def _fence(c: Conditions, p: ParameterTable) -> Failsafe:
    if not c.fence_breach:
        return NO_FAILSAFE
    action = _FENCE_ACTIONS.get(int(p["GF_ACTION"]), Reaction.NONE)
    return Failsafe(FENCE_BREACHED, action, sticky=action in (Reaction.HOLD, Reaction.RETURN, Reaction.LAND))


def _attitude_failure(c: Conditions, p: ParameterTable) -> Failsafe:
    if not c.attitude_failed:
        return NO_FAILSAFE
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
    _no_such_mode,
    _flight_time,
    _fence,
    _attitude_failure,
)


def evaluate(conditions: Conditions, parameters: ParameterTable, overridden: frozenset[str] = frozenset()) -> Failsafe:
    """Return the most severe failsafe of all rules. For `overridden` causes, actions STICKS … DESCEND become WARN."""
    worst = NO_FAILSAFE
    for rule in TABLE:
        due = rule(conditions, parameters)
        if due.action == Reaction.RETURN and (conditions.mode == "RETURN" or conditions.mode in _LANDING):
            due = Failsafe(due.cause, Reaction.WARN)  # the vehicle already returns or lands
        if due.cause in overridden and Reaction.WARN < due.action < Reaction.DISARM:
            due = Failsafe(due.cause, Reaction.WARN)
        if due.action > worst.action:
            worst = due
    return worst


def reaction(failsafe: Failsafe, intended: str, *, sticks: bool, position: bool, home: bool) -> tuple[str, str]:
    """Return (mode in HEARTBEAT, name of the behaviour to fly) for a failsafe.

    `sticks`, `position` and `home`: whether each is available. In a manual mode without sticks, HEARTBEAT shows the
    manual mode while the vehicle descends at MPC_LAND_SPEED, as measured on PX4.
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
    """Return the age (s) of a time stamp; nan if there is none."""
    return math.nan if stamp_us is None or stamp_us < 0 else (now_us - stamp_us) * 1e-6


AUTO_BIT, OFFBOARD_BIT = 1, 2  # in COM_RC_OVERRIDE


def overridable(mode: str, parameters: ParameterTable) -> bool:
    """Return whether stick movements may end this mode."""
    if mode in STICK_MODES or mode in ("TERMINATION", "ORBIT"):  # in ORBIT, sticks change the circle
        return False
    bit = OFFBOARD_BIT if mode == "OFFBOARD" else AUTO_BIT
    return bool(int(parameters["COM_RC_OVERRIDE"]) & bit)


class StickOverride:
    """Detects stick movements: compares the sticks with their positions at the start of the mode."""

    def __init__(self) -> None:
        self._mode = ""
        self._reference: tuple[float, float, float, float] | None = None

    def forget(self) -> None:
        """Use the next stick positions as the reference."""
        self._reference = None

    def moved(self, mode: str, sticks: Sticks, parameters: ParameterTable) -> bool:
        """Return whether a stick has moved by more than COM_RC_STICK_OV (% of full deflection) in this mode."""
        now = (sticks.forward, sticks.right, sticks.yaw, 2.0 * sticks.throttle - 1.0)
        if mode != self._mode or self._reference is None:
            self._mode, self._reference = mode, now
            return False
        limit = 0.01 * float(parameters["COM_RC_STICK_OV"])
        return any(abs(a - b) > limit for a, b in zip(now, self._reference, strict=True))


# causes that the pilot cannot overrule: OFFBOARD_LOST ends when the mode changes, POSITION_LOST leaves no choice
NOT_OVERRIDABLE = frozenset({OFFBOARD_LOST, POSITION_LOST})
DELAYED = frozenset({Reaction.RETURN, Reaction.LAND, Reaction.DESCEND})
NAMES = {Reaction.HOLD: "Hold", Reaction.RETURN: "Return", Reaction.LAND: "Land", Reaction.DESCEND: "Descend"}
LOOK_US = 100_000  # µs between two checks; a lost offboard signal is noticed at once


class Supervision:
    """Decides on the failsafe of an armed vehicle.

    `failsafe` is the present reaction. If it is delayed, its action is HOLD for COM_FAIL_ACT_T, so that the pilot can
    choose another mode. `breach` is the broken limit of the geofence, empty if none.
    """

    def __init__(self, parameters: ParameterTable, send_text: StatusText) -> None:
        self.failsafe = NO_FAILSAFE
        self.breach = ""
        self.station_seen_us: int | None = None  # last heartbeat of a ground station
        self._due = NO_FAILSAFE
        self._waiting_since_us: int | None = None
        self._overridden: frozenset[str] = frozenset()
        self._looked_us = 0
        self._armed_us = 0
        self._had_sticks = False  # in this flight; before, a loss cannot be noticed
        self._battery_at_arming = math.nan
        self._attitude = AttitudeWatch(parameters)
        self._accuracy = AccuracyWatch(parameters)
        self._parameters = parameters
        self._send_text = send_text

    @property
    def waiting(self) -> bool:
        """True while the vehicle holds for COM_FAIL_ACT_T, before the action itself."""
        return self.failsafe.action != self._due.action

    def begin(self, flight: FlightContext) -> None:
        """Start the supervision at arming."""
        self.end()
        self._armed_us, self._looked_us = flight.state.time_us, 0
        self._had_sticks = self.sticks_fresh(flight)
        self._battery_at_arming = battery(flight)

    def end(self) -> None:
        """End the supervision at disarming."""
        self.failsafe = self._due = NO_FAILSAFE
        self.breach = ""
        self._waiting_since_us, self._overridden = None, frozenset()
        self._attitude.reset()
        self._accuracy.reset()

    def overrule(self) -> None:
        """Overrule the present failsafe, because the pilot has chosen a mode.

        The cause then only warns, until all causes of failsafes have ended.
        """
        if self.failsafe.action > Reaction.WARN and self.failsafe.cause not in NOT_OVERRIDABLE:
            self._overridden |= {self.failsafe.cause}
        self._due = NO_FAILSAFE if self._due.sticky else self._due
        self._looked_us = 0  # the next `look` checks the conditions at once

    def sticks_fresh(self, flight: FlightContext) -> bool:
        """Return whether MANUAL_CONTROL arrived within COM_RC_LOSS_T."""
        return flight.sticks.fresh(flight.state.time_us, self._parameters["COM_RC_LOSS_T"])

    def look(self, flight: FlightContext, mode: str, offboard_signal: bool, takeoff_us: int) -> None:
        """Update the failsafe at a tick. `mode`: the requested mode; `takeoff_us`: time of the lift-off (0 = none)."""
        now = flight.state.time_us
        urgent = (mode == "OFFBOARD" and not offboard_signal) or self.failsafe.cause == OFFBOARD_LOST
        if not urgent and now - self._looked_us < LOOK_US:
            return
        self._looked_us = now
        self.breach = flight.breach() if flight.state.position_valid else self.breach
        self._attitude.look(flight.state, controlled=mode != "ACRO")
        due = evaluate(self._conditions(flight, mode, offboard_signal, takeoff_us), self._parameters, self._overridden)
        if self._due.sticky and due.action < self._due.action:
            due = self._due
        in_force = self._in_force(now, due)
        if (due, in_force) != (self._due, self.failsafe):
            self._announce(due, in_force)
        self._due, self.failsafe = due, in_force
        if due.action == Reaction.NONE:
            self._overridden = frozenset()
        self._accuracy.look(flight.state)  # sets accuracy limits, which apply from the next tick on

    def _in_force(self, now: int, due: Failsafe) -> Failsafe:
        if not (due.delayed and due.action in DELAYED):
            self._waiting_since_us = None
            return due
        if self._waiting_since_us is None:
            self._waiting_since_us = now
        waits = now - self._waiting_since_us < self._parameters["COM_FAIL_ACT_T"] * 1e6
        return replace(due, action=Reaction.HOLD) if waits else due

    def _announce(self, due: Failsafe, in_force: Failsafe) -> None:
        if due.action == Reaction.WARN:
            self._send_text(dialect.MAV_SEVERITY_WARNING, f"Warning: {due.cause}")
        elif due.action > Reaction.WARN:
            text = f"Failsafe: {due.cause}"
            if due.action in NAMES:
                text += f", {NAMES[due.action]}"
            if in_force.action != due.action:
                text += f" in {float(self._parameters['COM_FAIL_ACT_T']):g} s"
            self._send_text(dialect.MAV_SEVERITY_CRITICAL, text)
        elif self.failsafe.action > Reaction.WARN:
            self._send_text(dialect.MAV_SEVERITY_INFO, f"Failsafe over: {self.failsafe.cause}")

    def _conditions(self, flight: FlightContext, mode: str, offboard_signal: bool, takeoff_us: int) -> Conditions:
        state, p = flight.state, self._parameters
        now, sticks = state.time_us, self.sticks_fresh(flight)
        self._had_sticks |= sticks
        lockdown_s = float(p["COM_LKDOWN_TKO"]) + float(p["COM_SPOOLUP_TIME"])
        return Conditions(
            mode=mode,
            offboard_signal=offboard_signal,
            sticks=sticks,
            sticks_lost_s=seconds_since(now, flight.sticks.time_us) if self._had_sticks else math.nan,
            station_lost_s=seconds_since(now, self.station_seen_us),
            battery=battery(flight),
            battery_at_arming=self._battery_at_arming,
            position_valid=bool(state.position_valid),
            velocity_valid=bool(state.velocity_valid),
            altitude_valid=bool(state.altitude_valid),
            flight_time_s=seconds_since(now, takeoff_us or None),
            fence_breach=self.breach,
            attitude_failed=self._attitude.failed,
            just_armed=(now - self._armed_us) * 1e-6 < lockdown_s,
        )


def battery(flight: FlightContext) -> float:
    """Return the remaining charge of the battery (0 … 1); nan if unknown."""
    time_us, remaining = flight.state.battery()
    return remaining if time_us else math.nan
