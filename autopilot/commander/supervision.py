"""The watch over an armed vehicle: which failsafe is in force, since when, and what the pilot has overruled.

The pilot also takes over by moving the sticks (COM_RC_OVERRIDE, COM_RC_STICK_OV).
"""

import math
from collections.abc import Callable
from dataclasses import replace

from autopilot.commander.failsafe import (
    OFFBOARD_LOST,
    POSITION_LOST,
    QUIET,
    Conditions,
    Failsafe,
    Reaction,
    evaluate,
    seconds_since,
)
from autopilot.commander.health import STICK_MODES, AccuracyWatch, AttitudeWatch
from autopilot.commander.modes.flight import FlightContext, Sticks
from autopilot.parameters import ParameterTable
from foundation.mavlink import dialect

AUTO_BIT, OFFBOARD_BIT = 1, 2  # COM_RC_OVERRIDE


def overridable(mode: str, parameters: ParameterTable) -> bool:
    """Return whether stick movements may end this mode."""
    if mode in STICK_MODES or mode in ("TERMINATION", "ORBIT"):  # sticks are part of an orbit
        return False
    bit = OFFBOARD_BIT if mode == "OFFBOARD" else AUTO_BIT
    return bool(int(parameters["COM_RC_OVERRIDE"]) & bit)


class StickOverride:
    """Compares the sticks with where they were when the mode began."""

    def __init__(self) -> None:
        self._mode = ""
        self._reference: tuple[float, float, float, float] | None = None

    def moved(self, mode: str, sticks: Sticks, parameters: ParameterTable) -> bool:
        """Return whether a fresh stick has moved by more than COM_RC_STICK_OV (% of full deflection) in this mode."""
        now = (sticks.forward, sticks.right, sticks.yaw, 2.0 * sticks.throttle - 1.0)
        if mode != self._mode or self._reference is None:
            self._mode, self._reference = mode, now
            return False
        limit = 0.01 * float(parameters["COM_RC_STICK_OV"])
        return any(abs(a - b) > limit for a, b in zip(now, self._reference, strict=True))


StatusText = Callable[[int, str], None]  # severity (MAV_SEVERITY), text
# causes that end with the mode or cannot be argued with: choosing another mode is not remembered against them
UNDENIABLE = frozenset({OFFBOARD_LOST, POSITION_LOST})
DELAYED = frozenset({Reaction.RETURN, Reaction.LAND, Reaction.DESCEND})
NAMES = {Reaction.HOLD: "Hold", Reaction.RETURN: "Return", Reaction.LAND: "Land", Reaction.DESCEND: "Descend"}
LOOK_US = 100_000  # slow conditions (battery, links, fence) are looked at 10 times a second


class Supervision:
    """Follows the conditions of one flight.

    `failsafe` is what the vehicle does now: HOLD for COM_FAIL_ACT_T, in which the pilot may choose another mode, and
    then the action itself. `breach` is the geofence's limit that is broken, empty when none.
    """

    def __init__(self, parameters: ParameterTable, say: StatusText) -> None:
        self.failsafe = QUIET
        self.breach = ""
        self.station_heard_us: int | None = None  # last heartbeat of a ground station
        self._found = QUIET
        self._waiting_since_us: int | None = None
        self._overridden: frozenset[str] = frozenset()
        self._looked_us = 0
        self._armed_us = 0
        self._armed_with_sticks = False
        self._battery_at_arming = math.nan
        self._attitude = AttitudeWatch(parameters)
        self._accuracy = AccuracyWatch(parameters)
        self._parameters = parameters
        self._say = say

    @property
    def waiting(self) -> bool:
        """Whether the vehicle holds before it does what the failsafe demands."""
        return self.failsafe.action != self._found.action

    def begin(self, flight: FlightContext) -> None:
        """Start afresh with the arming of a vehicle."""
        self.end()
        self._armed_us, self._looked_us = flight.state.time_us, 0
        self._armed_with_sticks = self.sticks_fresh(flight)
        self._battery_at_arming = battery(flight)

    def end(self) -> None:
        """Forget everything with the disarming."""
        self.failsafe = self._found = QUIET
        self.breach = ""
        self._waiting_since_us, self._overridden = None, frozenset()
        self._attitude.reset()
        self._accuracy.reset()

    def overrule(self) -> None:
        """The pilot has chosen a mode: the present cause only warns until it has gone."""
        if self.failsafe.action > Reaction.WARN and self.failsafe.cause not in UNDENIABLE:
            self._overridden |= {self.failsafe.cause}
        self._found = QUIET if self._found.sticky else self._found
        self._looked_us = 0  # the choice counts at once

    def sticks_fresh(self, flight: FlightContext) -> bool:
        """Return whether somebody holds the sticks."""
        return flight.sticks.fresh(flight.state.time_us, self._parameters["COM_RC_LOSS_T"])

    def look(self, flight: FlightContext, mode: str, offboard_signal: bool, takeoff_us: int) -> None:
        """Follow one tick; `mode` is the one that was asked for, `takeoff_us` the lift-off (0 = none)."""
        now = flight.state.time_us
        urgent = (mode == "OFFBOARD" and not offboard_signal) or self.failsafe.cause == OFFBOARD_LOST
        if not urgent and now - self._looked_us < LOOK_US:
            return
        self._looked_us = now
        self._accuracy.look(flight.state)
        self.breach = flight.breach() if flight.state.position_valid else self.breach
        self._attitude.look(flight.state, controlled=mode != "ACRO")
        found = evaluate(
            self._conditions(flight, mode, offboard_signal, takeoff_us), self._parameters, self._overridden
        )
        if self._found.sticky and found.action < self._found.action:
            found = self._found
        in_force = self._in_force(now, found)
        if (found, in_force) != (self._found, self.failsafe):
            self._announce(found, in_force)
        self._found, self.failsafe = found, in_force
        if found.action == Reaction.NONE:
            self._overridden = frozenset()

    def _in_force(self, now: int, found: Failsafe) -> Failsafe:
        if not (found.delayed and found.action in DELAYED):
            self._waiting_since_us = None
            return found
        if self._waiting_since_us is None:
            self._waiting_since_us = now
        waits = now - self._waiting_since_us < self._parameters["COM_FAIL_ACT_T"] * 1e6
        return replace(found, action=Reaction.HOLD) if waits else found

    def _announce(self, found: Failsafe, in_force: Failsafe) -> None:
        if found.action == Reaction.WARN:
            self._say(dialect.MAV_SEVERITY_WARNING, f"Warning: {found.cause}")
        elif found.action > Reaction.WARN:
            text = f"Failsafe: {found.cause}"
            if found.action in NAMES:
                text += f", {NAMES[found.action]}"
            if in_force.action != found.action:
                text += f" in {float(self._parameters['COM_FAIL_ACT_T']):g} s"
            self._say(dialect.MAV_SEVERITY_CRITICAL, text)
        elif self.failsafe.action > Reaction.WARN:
            self._say(dialect.MAV_SEVERITY_INFO, f"Failsafe over: {self.failsafe.cause}")

    def _conditions(self, flight: FlightContext, mode: str, offboard_signal: bool, takeoff_us: int) -> Conditions:
        state, p = flight.state, self._parameters
        now = state.time_us
        lockdown_s = float(p["COM_LKDOWN_TKO"]) + float(p["COM_SPOOLUP_TIME"])
        return Conditions(
            mode=mode,
            offboard_signal=offboard_signal,
            sticks=self.sticks_fresh(flight),
            sticks_lost_s=seconds_since(now, flight.sticks.time_us) if self._armed_with_sticks else math.nan,
            station_lost_s=seconds_since(now, self.station_heard_us),
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
    """Return what is left in the battery (0 … 1), nan when unknown."""
    sensors = flight.state.sensors
    return float(sensors["battery_remaining"]) if int(sensors["battery_time_us"]) else math.nan
