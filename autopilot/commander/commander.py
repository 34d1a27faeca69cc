"""The commander: it executes requests, selects the flight mode, and writes the setpoint of the inner loop.

`intended` is the requested mode. `mode` is the mode in HEARTBEAT; the two differ during a failsafe.
Requests return the same MAV_RESULT as PX4 (measured).
"""

import math
from typing import Any

from autopilot.commander.ground import LANDING, AutoDisarm, LandDetector, LandingWatch, TakeoffRamp, wants_climb
from autopilot.commander.health import (
    EXTERNAL_MODES,
    NO_ARMING_MODES,
    STICK_MODES,
    StatusText,
    attitude_failures,
    mode_failures,
    preflight_failures,
)
from autopilot.commander.modes.automatic import Descend, Follow, HoldMode, Land, Orbit, ReturnHome, Takeoff
from autopilot.commander.modes.flight import FlightContext, Mode, Offboard
from autopilot.commander.modes.manual import Acro, AltitudeControl, PositionControl, Stabilized
from autopilot.commander.modes.mission import Mission
from autopilot.commander.plans import MISSION, PlanItem, moved
from autopilot.commander.supervision import (
    NO_FAILSAFE,
    Failsafe,
    Reaction,
    StickOverride,
    Supervision,
    overridable,
    reaction,
)
from autopilot.estimator.estimated_state import EstimatedState
from autopilot.parameters import ParameterTable
from autopilot.records import IDLE, CascadeSetpoint
from foundation.frames import Vec3
from foundation.mavlink import MODES, dialect

ACCEPTED = int(dialect.MAV_RESULT_ACCEPTED)
REJECTED = int(dialect.MAV_RESULT_TEMPORARILY_REJECTED)
DENIED = int(dialect.MAV_RESULT_DENIED)

HOME_LOOK_US = 1_000_000  # µs between two checks whether the disarmed vehicle has moved


class SetpointWriter:
    """Writes a CascadeSetpoint into a SETPOINT record if it has changed."""

    def __init__(self, record: Any) -> None:
        self._record = record
        self._last: tuple[CascadeSetpoint, bool] | None = None
        self.write(IDLE, armed=False)

    def write(self, setpoint: CascadeSetpoint, armed: bool) -> None:
        """Write the setpoint and the armed flag into the record."""
        if self._last == (setpoint, armed):
            return
        record = self._record
        for name, value in zip(CascadeSetpoint._fields, setpoint, strict=True):
            record[name] = value
        record["armed"] = armed
        self._last = (setpoint, armed)


class Terminated(Mode):
    """TERMINATION: the rotors idle."""

    def setpoint(self, flight: FlightContext) -> CascadeSetpoint:
        return IDLE


class Commander:
    """Runs the flight modes: reads `state` and writes to `writer`. `send_text` gets the texts for ground stations."""

    def __init__(
        self, state: EstimatedState, parameters: ParameterTable, writer: SetpointWriter, send_text: StatusText
    ) -> None:
        self.flight = FlightContext(state, parameters)
        self.parameters = parameters
        self.armed = False
        self.intended = "HOLD"
        self.mode = "HOLD"
        self.supervision = Supervision(parameters, send_text)
        self.takeoff_us = 0  # vehicle time of the last lift-off, 0 = none
        self.demand: CascadeSetpoint = IDLE  # setpoint of the active mode
        self.passed: CascadeSetpoint = IDLE  # setpoint of the inner loop, after the take-off ramp
        self.hold, self.takeoff, self.orbit, self.mission = HoldMode(), Takeoff(), Orbit(), Mission()
        self._behaviours = self._modes()
        self._active: Mode | None = None
        self._writer = writer
        self._send_text = send_text
        self._detector = LandDetector(parameters)
        self._ramp = TakeoffRamp(parameters)
        self._auto_disarm = AutoDisarm(parameters)
        self._landing = LandingWatch(send_text)
        self._mode_chosen_disarmed = True
        self._home_looked_us = 0
        self._override = StickOverride()

    def _modes(self) -> dict[str, Mode]:
        """Return the behaviour of each mode by name.

        PRECLAND lands in place: there is no landing beacon. External modes only have a name here: a failsafe replaces
        them before they fly.
        """
        land, stabilized = Land(), Stabilized()
        return {
            "HOLD": self.hold,
            "MISSION": self.mission,
            "FOLLOW": Follow(),
            "TAKEOFF": self.takeoff,
            "LAND": land,
            "PRECLAND": land,
            "DESCEND": Descend(),
            "RETURN": ReturnHome(),
            "ORBIT": self.orbit,
            "OFFBOARD": Offboard(),
            "POSCTL": PositionControl(),
            "ALTCTL": AltitudeControl(),
            "STABILIZED": stabilized,
            "MANUAL": stabilized,
            "ACRO": Acro(),
            "TERMINATION": Terminated(),
            **dict.fromkeys(EXTERNAL_MODES, self.hold),
        }

    # queries

    @property
    def landed(self) -> bool:
        return self._detector.landed

    @property
    def custom_mode(self) -> int:
        """HEARTBEAT.custom_mode of `mode`."""
        return MODES[self.mode].custom_mode

    @property
    def failsafe(self) -> Failsafe:
        """The active failsafe; NO_FAILSAFE if none is active."""
        return self.supervision.failsafe

    @property
    def in_failsafe(self) -> bool:
        return self.failsafe.action > Reaction.WARN

    def arming_failures(self) -> list[str]:
        """Return the reasons why the vehicle would refuse to arm in its present mode; empty if it would arm."""
        mode = self._mode_after_arming()
        if mode in NO_ARMING_MODES:
            return [f"mode {mode} cannot arm"]
        failures = preflight_failures(self.flight.state, self.parameters) + self._mode_failures(mode)
        if self.parameters["GF_ACTION"] > Reaction.WARN and self.flight.breach():
            failures.append("outside the geofence")
        return failures

    # requests

    def arm(self, force: bool = False) -> int:
        """Start the rotors; return ACCEPTED (also if already armed), or send reasons and return REJECTED or DENIED."""
        if self.armed:
            return ACCEPTED
        mode = self._mode_after_arming()
        if not force:
            if mode in NO_ARMING_MODES:
                self._send_text(dialect.MAV_SEVERITY_CRITICAL, f"Arming denied: mode {mode}")
                return DENIED
            reasons = self.arming_failures()
            if reasons:
                for reason in reasons[:3]:
                    self._send_text(dialect.MAV_SEVERITY_CRITICAL, f"Arming denied: {reason}")
                return REJECTED
        now = self.flight.state.time_us
        self.intended = mode
        self.armed = True
        self._auto_disarm.arm(now)
        self.supervision.begin(self.flight)
        self._active = None
        self._ramp.arm(now)
        self.flight.renew_home()
        self._send_text(dialect.MAV_SEVERITY_INFO, "Armed")
        self._supervise(now)
        return ACCEPTED

    def disarm(self, force: bool = False, why: str = "by command") -> int:
        """Stop the rotors. Returns DENIED in the air unless forced."""
        if not self.armed:
            return ACCEPTED
        if not (force or self.landed):
            self._send_text(dialect.MAV_SEVERITY_CRITICAL, "Disarming denied: not landed")
            return DENIED
        self.armed, self.takeoff_us = False, 0
        self.supervision.end()
        self._mode_chosen_disarmed = False
        self.mode = self.intended
        self._active = None
        self._idle()
        self._detector.update(self.flight.state, False, False, IDLE)
        self.flight.landed = True
        self._send_text(dialect.MAV_SEVERITY_INFO, f"Disarmed {why}")
        self._landing.ended(self.flight.state)
        return ACCEPTED

    def set_mode(self, mode: str) -> int:
        """Request a flight mode by name (see `foundation.mavlink.MODES`).

        An armed vehicle returns REJECTED if the flight is terminated, or if the mode cannot be flown now.
        """
        if self.mode == "TERMINATION" and self.armed:
            return REJECTED
        if self.armed:
            reasons = self._mode_failures(mode)
            if reasons:
                self._send_text(dialect.MAV_SEVERITY_CRITICAL, f"Mode {mode} refused: {reasons[0]}")
                return REJECTED
        self._choose(mode)
        if self.armed:
            self._supervise(self.flight.state.time_us)
        else:
            self.mode = mode
        return ACCEPTED

    def _choose(self, mode: str) -> None:
        self.supervision.overrule()
        self._mode_chosen_disarmed = True
        if mode != "TAKEOFF":
            self.takeoff.aim(math.nan)
        if mode != self.intended or self.mode != mode:
            self.intended = mode
            self.flight.cruise_speed = math.nan
            self._active = None

    def take_off(self, z_ned: float) -> int:
        """Request TAKEOFF to a local z (m, NED); nan means the height MIS_TAKEOFF_ALT."""
        if self.mode == "TAKEOFF" and self.armed:
            if not self.landed:
                return ACCEPTED  # the same command repeated: keep the first target
            self._active = None  # still on the ground: enter the mode again with the new height
        self.takeoff.aim(z_ned)
        result = self.set_mode("TAKEOFF")
        if result != ACCEPTED:
            self.takeoff.aim(math.nan)
        return result

    def reposition(self, position_ned: Vec3, yaw: float, speed: float) -> int:
        """Fly to a local position (m, NED) in HOLD. For nan, the vehicle keeps its present coordinate or yaw.

        A `speed` (m/s) that is not positive means MPC_XY_CRUISE. A disarmed vehicle only selects HOLD.
        """
        result = self.set_mode("HOLD")
        if result != ACCEPTED or not self.armed:
            return result
        here = self.flight.state.position_ned
        n, e, z = (w if math.isfinite(w) else h for w, h in zip(position_ned, here, strict=True))
        self.hold.go_to((n, e, z), yaw)
        self.flight.change_speed(speed)
        return result

    def circle(self, centre_ned: Vec3, radius: float, speed: float, yaw_behaviour: int = 0) -> int:
        """Request ORBIT. A nan coordinate of the centre means the vehicle's own. `yaw_behaviour`: ORBIT_YAW_BEHAVIOUR.

        Returns DENIED if the vehicle is armed and the radius (m) is not in 1 … MC_ORBIT_RAD_MAX. Returns REJECTED if
        the vehicle has fallen over on the ground.
        """
        here = self.flight.state.position_ned
        n, e, z = (w if math.isfinite(w) else h for w, h in zip(centre_ned, here, strict=True))
        limit = float(self.parameters["MC_ORBIT_RAD_MAX"])
        if self.armed and not 1.0 <= abs(radius) <= limit:
            return DENIED
        if self.landed and (fallen := attitude_failures(self.flight.state, self.parameters)):
            self._send_text(dialect.MAV_SEVERITY_CRITICAL, f"Orbit denied: {fallen[0]}")
            return REJECTED
        self.orbit.around((n, e, z), radius, speed, yaw_behaviour)
        if self.mode == "ORBIT" and self.armed:
            return ACCEPTED
        return self.set_mode("ORBIT")

    def replace_plan(self, kind: int, items: tuple[PlanItem, ...]) -> None:
        """Replace the mission (0), fence (1) or rally points (2). A changed mission starts at its first item.

        If the vehicle flies a mission and cannot fly the new one, it returns, as PX4 does.
        """
        if self.flight.plans.replace(kind, items) and kind == MISSION:
            self.mission.rewind()
            if self._active is self.mission and items:
                if failures := self.flight.mission_failures():
                    self._send_text(dialect.MAV_SEVERITY_CRITICAL, f"Mission refused: {failures[0]}, Return")
                    self._choose("RETURN")
                else:
                    self.mission.enter(self.flight)

    def fly_item(self, number: int) -> bool:
        """Continue the mission at an item. Returns False if the mission has no item with this number."""
        if not 0 <= number < len(self.flight.plans.mission):
            return False
        self.mission.rewind(number)
        if self._active is self.mission:
            self.mission.enter(self.flight)
        return True

    def terminate(self) -> int:
        """End the flight at once: the rotors idle until the vehicle is disarmed. A disarmed vehicle returns DENIED."""
        if not self.armed:
            return DENIED
        self.intended = self.mode = "TERMINATION"
        self._active = None
        self._send_text(dialect.MAV_SEVERITY_EMERGENCY, "Flight terminated")
        return ACCEPTED

    # the tick

    def tick(self) -> None:
        """Run one step with the newest state."""
        flight, state = self.flight, self.flight.state
        now = state.time_us
        if not self.armed:
            self._follow_home_on_ground(now)
            self._idle()
            return
        self._supervise(now)
        if not self.armed:
            return
        if self._active is None:
            self._activate()
        active = self._active
        assert active is not None
        demand = active.setpoint(flight)
        if active.next_mode is not None and active is self._behaviours[self.intended]:
            self._finish(active.next_mode)
        self.demand = demand
        self.passed = self._ramp.gate(demand, state, flight.landed or self._detector.contact)
        self._writer.write(self.passed, True)
        self._follow_ground(now, demand)

    def _finish(self, following: str) -> None:
        rest = self._active.rest if self._active is not None else None
        if self._active is self.mission and self.mission.complete:
            self._send_text(dialect.MAV_SEVERITY_INFO, "Mission finished")
        self.intended = self.mode = following
        self.flight.cruise_speed = math.nan
        self._activate()
        if following == "HOLD" and rest is not None:
            self.hold.go_to(rest, math.nan)

    def _follow_ground(self, now: int, demand: CascadeSetpoint) -> None:
        state, was = self.flight.state, self.flight.landed
        climbing = wants_climb(demand, state)
        self._detector.update(state, True, climbing, demand)
        landed = self.flight.landed = self._detector.landed
        if landed and not was:
            self._send_text(dialect.MAV_SEVERITY_INFO, "Landing detected")
        elif was and not landed:
            self.takeoff_us = now
            self._send_text(dialect.MAV_SEVERITY_INFO, "Take-off detected")
        self._landing.follow(state, self.mode in LANDING and not landed)
        reason = self._auto_disarm.reason(now, landed, climbing)
        if reason:
            self.disarm(why=reason)

    def _supervise(self, now: int) -> None:
        """Activate the intended mode, or the mode of the failsafe."""
        if self.intended == "TERMINATION":
            return
        offboard_signal = self.intended == "OFFBOARD" and self._offboard_usable()
        self.supervision.look(self.flight, self.intended, offboard_signal, self.takeoff_us)
        if self.flight.sticks.time_us >= 0:
            self._yield_to_sticks()
        shown, behaviour = self._reaction()
        failsafe = self.supervision.failsafe
        if failsafe.action == Reaction.DISARM:
            self.disarm(force=True, why=f"by failsafe: {failsafe.cause}")
            return
        if failsafe.action == Reaction.TERMINATE:
            self.terminate()
            return
        if shown != self.mode or self._active is not self._behaviours[behaviour]:
            if shown != self.mode:
                self.flight.cruise_speed = math.nan
            self.mode = shown
            self._active = self._behaviours[behaviour]
            self._active.enter(self.flight)

    def _reaction(self) -> tuple[str, str]:
        """Return (mode in HEARTBEAT, name of the behaviour to fly)."""
        if self.intended == "TERMINATION":
            return "TERMINATION", "TERMINATION"  # no failsafe may fly on
        if self.supervision.failsafe is NO_FAILSAFE and self.intended not in STICK_MODES:
            return self.intended, self.intended  # `reaction` would return the same values, more slowly
        return reaction(
            self.failsafe,
            self.intended,
            sticks=self._sticks_fresh(),
            position=bool(self.flight.state.position_valid),
            home=self.flight.home is not None,
        )

    def _yield_to_sticks(self) -> None:
        """Switch to POSCTL or ALTCTL if the pilot moves the sticks in an automatic mode."""
        sticks = self.flight.sticks
        if self.flight.landed or not overridable(self.mode, self.parameters):
            self._override.forget()
            return
        if not self._sticks_fresh() or (self.in_failsafe and self.supervision.waiting):
            return
        if self._override.moved(self.mode, sticks, self.parameters):
            self._send_text(dialect.MAV_SEVERITY_INFO, "Pilot took over using sticks")
            self._choose("POSCTL" if self.flight.state.position_valid else "ALTCTL")

    def _activate(self) -> None:
        self._active = self._behaviours[self._reaction()[1]]
        self._active.enter(self.flight)

    def _idle(self) -> None:
        self.demand = self.passed = IDLE
        self._writer.write(IDLE, self.armed)

    # availability

    def _mode_failures(self, mode: str) -> list[str]:
        return mode_failures(
            mode,
            self.flight.state,
            self.parameters,
            home=self.flight.home is not None,
            sticks=self._sticks_fresh(),
            offboard=self._offboard_usable(),
            mission=self.flight.mission_failures() if mode == "MISSION" else [],
        )

    def _mode_after_arming(self) -> str:
        """Return the mode in which the vehicle would arm.

        After an automatic landing the mode is still LAND or RETURN, which forbid arming. The vehicle then arms in HOLD,
        unless a client has chosen a mode since the disarming.
        """
        if self.intended in NO_ARMING_MODES and not self._mode_chosen_disarmed:
            return "HOLD"
        return self.intended

    def _offboard_usable(self) -> bool:
        offboard, state = self.flight.offboard, self.flight.state
        return offboard.fresh(state.time_us, self.parameters["COM_OF_LOSS_T"]) and offboard.supported(state)

    def _sticks_fresh(self) -> bool:
        return self.supervision.sticks_fresh(self.flight)

    def _follow_home_on_ground(self, now: int) -> None:
        """Keep home at the vehicle's position while disarmed, so that clients get a home before arming.

        A home stays if a client or a mission chose its position.
        """
        if now - self._home_looked_us < HOME_LOOK_US:
            return
        self._home_looked_us = now
        if self.flight.home is None or moved(self.flight.home, self.flight.state):
            self.flight.renew_home()
