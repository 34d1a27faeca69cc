"""The link to a PX4, or to the project's autopilot, which speaks the same MAVLink. Every flight uses this class."""

import math
import time
from collections.abc import Callable

from foundation.errors import LinkError
from foundation.frames import Vec3
from foundation.mavlink import MODES, dialect
from foundation.setpoints import Hold, PicturePose, Setpoint
from hil.link.autopilots import setpoint_message
from hil.link.conversation import GIMBAL, SILENCE_S, Conversation
from hil.link.course import Arrival
from hil.link.envelope import Limits, admit, broken_off, with_local_exclusions
from hil.link.offboard import Destination, OffboardSetpoint, OffboardStream, SetpointRate, TurnProgress
from hil.link.streams import TICK_US
from hil.link.telemetry import VehicleState
from hil.link.transport import Transport

BRAKE_S = 0.5  # s of vehicle time for which setpoints hold the vehicle at the end of a flight, before mode Hold
ROUND_RATE = math.radians(60.0)  # rad/s, yaw rate of the full turn in `fly_to`
GIVEN_S = 1.5  # s that Hold or Offboard must last to be a hand-over; a heartbeat in this time would show a failsafe
OVERTAKEN_US = 300_000  # µs in which a message with the previous mode may still arrive on a link that reorders
ARMED_S = 10.0  # s of attempts to arm, because a pre-arm check may fail for a moment
OFFERED_S = 2.0  # s of attempts to enter Offboard while it is temporarily refused
DISARMED_US = 1_500_000  # µs for which a flying vehicle reports `disarmed` before it counts: more than one heartbeat
CAUSE_US = 2_000_000  # µs; the text of a failsafe may arrive this long before the mode that the failsafe sets
FOREIGN_S = 600.0  # s for a person to arm; after that, the same time to take off and hand over
LEADS_TO = {"TAKEOFF": ("HOLD",), "RETURN": ("LAND", "HOLD")}  # mode → modes to which PX4 switches from it by itself
HOMEWARD = ("LAND", "RETURN")  # modes that end on the ground; we send no orders after them
ENDINGS = {"land": "LAND", "return": "RETURN", "hold": "HOLD"}  # modes for the end of a flight


class TakeoverError(LinkError):
    """A pilot, a ground station or a failsafe has ended Offboard and controls the vehicle now."""


class EnvelopeError(LinkError):
    """The envelope (safety limits) ends the flight, because the battery or the time is used up."""


class Link(Conversation):
    """A conversation that also sets modes, arms, and streams setpoints in Offboard.

    Only `tick` and `keep_up` send setpoints, and the agent calls them. So an agent that hangs, crashes or is killed
    sends none.
    """

    def __init__(
        self,
        transport: Transport,
        *,
        silence_s: float = SILENCE_S,
        key: bytes = b"",
        unix_s: Callable[[], float] = time.time,
        limits: Limits | None = None,
        dry: bool = False,
        simulated: bool = False,
    ) -> None:
        """`limits`: the safety envelope of every setpoint. `dry`: send nothing that would move the vehicle.

        `silence_s`, `key`, `unix_s`: as in `Conversation`. `simulated`: a simulated vehicle, whose failsafes are part
        of its flight, for example after a crash. They are not a takeover: the stream of setpoints continues, and PX4
        returns to Offboard when it can.
        """
        super().__init__(transport, silence_s=silence_s, key=key, unix_s=unix_s)
        self.limits = limits
        self.dry = dry
        self.on_setpoint: Callable[[OffboardSetpoint], None] = lambda setpoint: None  # gets every setpoint, sent or not
        self.on_limit: Callable[[tuple[str, ...]], None] = lambda names: (
            None
        )  # gets the names of the acting limits when they change
        self._stream = OffboardStream()
        self._rate = SetpointRate()
        self._offboard = False
        self._expected: tuple[str, ...] = ()  # modes that our last order leads to; (): no check for a takeover
        self._leaving: tuple[str, ...] = ()  # earlier modes, accepted until OVERTAKEN_US after `_obeyed_us`
        self._obeyed_us = 0  # µs, vehicle clock when telemetry first showed an expected mode; 0: not yet
        self._taken_by: str | None = None
        self._overridden = False  # whether a failsafe has overridden a mode that we ordered
        self.simulated = simulated
        self.failsafe = ""  # what PX4 does in Offboard when setpoints stop, in words; empty: unknown
        self._strayed_us = 0  # µs, when a simulated vehicle entered a mode that we did not order
        self._failed = False  # whether a failsafe of a simulated vehicle has caused the present mode
        self._offboard_us = 0  # µs, vehicle clock at the start of Offboard
        self._ended = False  # whether the envelope has ended the flight
        self._limited: tuple[str, ...] = ()
        self._home_ned: Vec3 | None = None  # m, local frame; home as fixed by `settle_envelope`
        self._first_ned: Vec3 | None = None  # m, local frame; used as home until the autopilot sends its home
        self._tried_to_arm = False
        self._flew_armed = False  # whether the vehicle has been armed in the present Offboard
        self._disarmed_us: int | None = None  # µs, first heartbeat that reports the vehicle as disarmed
        self._armed_us = 0  # µs, last heartbeat that reports the vehicle as armed

    # -- modes ---------------------------------------------------------------------------------------------------

    def set_mode(self, name: str) -> None:
        """Switch the flight mode. Raises LinkError when refused."""
        if self.dry:
            return
        if name != "OFFBOARD":
            self._offboard = False
        self._expect(name, *LEADS_TO.get(name, ()))
        # on a lossy link our setpoints may arrive late, and an autopilot may refuse Offboard until they arrive
        insist_s = OFFERED_S if name == "OFFBOARD" else 0.0
        mode = MODES[name]
        self.order(f"mode {name}", dialect.MAV_CMD_DO_SET_MODE, 1, mode.main, mode.sub, insist_s=insist_s)
        if name in HOMEWARD:
            self._expected = ()

    def arm(self) -> None:
        """Arm, with attempts for ARMED_S. Raises LinkError if all fail."""
        if self.dry:
            return
        self._tried_to_arm = True
        self._expect(self.state.mode, "TAKEOFF", "HOLD")
        self.order("arming", dialect.MAV_CMD_COMPONENT_ARM_DISARM, 1, insist_s=ARMED_S)
        self.wait_for(lambda state: state.armed, 5.0, "arming")

    def may_fly(self) -> bool:
        """Return whether the vehicle may be armed or in the air by our orders, so that we must land it.

        A vehicle that a person armed counts only after the hand-over. Then it also counts while it is silent after a
        reboot. Heartbeats lag by up to a second. So if we ordered arming and no heartbeat shows an armed vehicle, this
        function orders disarming: the vehicle obeys on the ground and refuses in the air.
        """
        if not self._tried_to_arm or self.state.armed:
            may_be_armed = self.state.armed or not self.state.heartbeat_us
            return may_be_armed and (self._offboard or self._tried_to_arm)
        return bool(self.command(dialect.MAV_CMD_COMPONENT_ARM_DISARM, 0) != dialect.MAV_RESULT_ACCEPTED)

    def await_handover(self, notify: Callable[[str], None] = lambda line: None) -> None:
        """Wait until a person has armed, taken off and handed over by switching to Hold or Offboard.

        On the ground no setpoint is sent, so that the vehicle cannot be armed in Offboard. In the air the setpoint is
        always the vehicle's present place. Passing through Hold to another mode is not a hand-over.
        Raises LinkError if arming, or the hand-over after it, takes more than FOREIGN_S.
        """
        self.wait_for(lambda state: state.armed, FOREIGN_S, "arming by a person")
        notify("armed: take off, and hand over by switching to Hold (or Offboard) …")
        end_us, given_us = self.time_us + round(FOREIGN_S * 1e6), None
        while given_us is None or self.time_us < given_us + round(GIVEN_S * 1e6):
            given_us = (given_us or self.time_us) if self._is_given(self.state) else None
            if self.time_us >= end_us:
                raise LinkError(f"no person took off and handed over within {FOREIGN_S:g} s")
            self._stream.stop()
            if self.state.landed is False:
                self._stream.fly(Hold())
            self.tick()
        self._stream.stop()
        self._expect(self.state.mode)

    def _is_given(self, state: VehicleState) -> bool:
        """Return whether the vehicle is handed over. A vehicle that a failsafe holds is not."""
        calm = state.armed and state.system_status == dialect.MAV_STATE_ACTIVE
        return calm and state.landed is False and state.mode in ("HOLD", "OFFBOARD")

    # -- takeovers -----------------------------------------------------------------------------------------------

    @property
    def is_left_to_failsafe(self) -> bool:
        """Whether the vehicle is probably in Offboard and gets no setpoints from us."""
        return self.state.mode in ("", "OFFBOARD") and not self.streaming

    @property
    def taken_by(self) -> str | None:
        """The mode to which another pilot has switched the vehicle; None: no takeover."""
        return self._taken_by

    def _expect(self, *modes: str) -> None:
        """Count modes other than `modes` as takeovers; the present mode only after one of `modes` was seen."""
        if self._taken_by is None:
            # telemetry is late: it may show the mode of the previous order only after this one
            unshown = () if self._obeyed_us else self._expected
            self._expected, self._leaving, self._obeyed_us = modes, (self.state.mode, *unshown), 0

    def _noticed(self) -> None:
        mode, armed = self.state.mode, self.state.armed
        if not mode or self._taken_by is not None or not (self._offboard or self._tried_to_arm or armed):
            return  # no mode yet, already taken over, or nothing to take over
        disarmed = self._reports_disarmed()
        believed = disarmed and (self.simulated or self._is_disarmed())
        if mode in self._expected:
            self._obeyed_us = self._obeyed_us or self.time_us
        if self._obeyed_us and self.time_us > self._obeyed_us + OVERTAKEN_US:
            # OFFBOARD stays: a late message may show this mode after we left it
            self._leaving = tuple(left for left in self._leaving if left == "OFFBOARD")
        if believed or (self._expected and mode not in (*self._expected, *self._leaving)):
            if self.simulated and self._is_failsafe(disarmed):
                return
            self._overridden = self.state.overridden_mode in self._expected
            self._taken_by, self._offboard, self._expected = "disarmed" if disarmed else mode, False, ()
            self._stream.stop()
        else:
            self._strayed_us, self._failed = 0, False

    def _reports_disarmed(self) -> bool:
        """Return whether the vehicle, armed earlier in this Offboard, now reports `disarmed`."""
        self._flew_armed = self._offboard and (self._flew_armed or self.state.armed)
        self._armed_us = self.state.heartbeat_us if self.state.armed else self._armed_us
        if not self._flew_armed or self.state.armed:
            self._disarmed_us = None
        elif self._disarmed_us is None:
            self._disarmed_us = self.state.heartbeat_us
        return self._disarmed_us is not None

    def _is_disarmed(self) -> bool:
        """Return whether the report `disarmed` counts: on the ground always, in the air after DISARMED_US."""
        assert self._disarmed_us is not None
        return self.state.landed is not False or self.state.heartbeat_us >= self._disarmed_us + DISARMED_US

    def _is_failsafe(self, disarmed: bool) -> bool:
        """Return whether a failsafe has changed the mode; True until the next heartbeat, which shows failsafes."""
        self._strayed_us = self._strayed_us or self.time_us
        self._failed |= disarmed or self.state.system_status >= dialect.MAV_STATE_CRITICAL
        return self._failed or self.state.heartbeat_us <= self._strayed_us  # the heartbeat may be late on a bad link

    def tick(self) -> None:
        """Wait for the next tick of vehicle time (20 Hz, or the higher rate of `stream_at`), then send the setpoint.

        Raises LinkError; TakeoverError if the vehicle was taken over; EnvelopeError if the envelope ends the flight.
        """
        super().tick()
        if self._taken_by is not None and not self.dry:
            raise self._takeover()
        if self._offboard and self.limits is not None:
            self._watch(self.limits)

    def _takeover(self) -> TakeoverError:
        self._tried_to_arm = False
        change = "disarmed" if self._taken_by == "disarmed" else f"switched to {self._taken_by}"
        texts = self.texts.since(self.time_us - CAUSE_US)
        words = f"; the autopilot said: {texts}" if texts else ""
        # the status comes once a second, with the heartbeat; CURRENT_MODE shows the overridden mode earlier
        critical = self.state.system_status >= dialect.MAV_STATE_CRITICAL
        failsafe = critical or self._overridden or "failsafe" in texts.lower()
        cause = "by its own failsafe" if failsafe else "by a person or program, which controls it now"
        # a simulated PX4 has the simulator's clock: its restart is a gap in telemetry, not a clock set back
        if self._taken_by == "disarmed" and self._gap_us > self._armed_us and not failsafe:
            cause = "by a restart of its autopilot, a person or a program: its telemetry was interrupted"
        return TakeoverError(f"the vehicle was {change} {cause}{words}")

    def _watch(self, limits: Limits) -> None:
        """Raise EnvelopeError, once, if the flight must end."""
        reason = broken_off(self.state, limits, (self.time_us - self._offboard_us) / 1e6)
        if reason is not None and not self._ended:
            self._ended = True
            raise EnvelopeError(reason)

    # -- offboard ------------------------------------------------------------------------------------------------

    def fly(self, setpoint: Setpoint, seconds: float | None = None, seen: PicturePose | None = None) -> None:
        """Send this setpoint from the next tick on. After `seconds` of vehicle time, send a hold instead.

        The setpoint's angles count from the pose `seen`; None: from the held heading.
        """
        ends_us = None if seconds is None else self.time_us + round(seconds * 1e6)
        self._stream.fly(setpoint, ends_us, self.time_us, seen)

    def watch_gimbal(self) -> None:
        """Ask for the attitude of the camera's gimbal, together with the other streams."""
        self.streams.wanted[GIMBAL] = TICK_US

    def point_camera(self, pitch: float) -> None:
        """Command the camera's gimbal to a pitch (rad, up from the horizon). Raises LinkError when it is refused."""
        command, nan = dialect.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW, math.nan
        flags = dialect.GIMBAL_MANAGER_FLAGS_PITCH_LOCK | dialect.GIMBAL_MANAGER_FLAGS_ROLL_LOCK
        self.order("the gimbal's angle", command, math.degrees(pitch), nan, nan, nan, flags, 0, 0)

    @property
    def streaming(self) -> bool:
        """Whether setpoints are being sent."""
        return self._stream.setpoint is not None

    def sight(self, time_us: int) -> PicturePose:
        """Return the vehicle's estimated pose at a time (µs, vehicle clock). Raises LinkError."""
        sight = self.track.at(time_us)
        if sight is None:
            raise LinkError("the autopilot has sent neither position nor heading")
        return sight

    @property
    def steady(self) -> bool:
        """Whether a turn is over: the nose is within 1° of the final heading and turns slower than 5°/s.

        If a move follows the turn, the position must also be within 5 cm of the line of that move.
        """
        state = self.state
        if self.dry:
            return True  # nothing will turn, so there is nothing to wait for
        if state.position_ned is None or state.euler is None:
            return False
        return self._stream.steady(state.position_ned, state.euler[2], state.yaw_rate or 0.0)

    def stream_at(self, hz: float | None) -> None:
        """Send `hz` setpoints per second of vehicle time from now on; None: one at every tick.

        Above 20 Hz, telemetry and ticks get this rate too.
        """
        tick_us = min(TICK_US, round(1e6 / hz)) if hz else TICK_US
        self._rate = SetpointRate(hz if tick_us == TICK_US else None)
        if tick_us != self.tick_us:
            self.tick_us = tick_us
            for interval in self.streams.quicken(tick_us):
                self._request(interval.message_id, interval.interval_us)

    def start_offboard(self) -> None:
        """Send the setpoint of `fly`, then enter Offboard. Raises LinkError if refused."""
        if self._taken_by is not None:
            raise self._takeover()
        self.tick()
        if self.dry:
            return
        self._offboard, self._offboard_us = True, self.time_us  # set before the order, which may act even if it raises
        if self.state.mode == "OFFBOARD":
            self._expect("OFFBOARD")
            return
        try:
            self.set_mode("OFFBOARD")
        except LinkError:
            self._offboard = self.state.mode == "OFFBOARD"
            raise
        self.wait_for(lambda state: state.mode == "OFFBOARD", 3.0, "offboard mode")

    def stop_stream(self) -> None:
        """Send no setpoint from now on. Unless a mode is set, the autopilot's own failsafe follows."""
        self._offboard = False
        self._stream.stop()

    def stop_offboard(self) -> None:
        """Order the autopilot to hold. Send setpoints until it has left Offboard."""
        self.set_mode("HOLD")
        # the acknowledgement precedes telemetry, and our own hold must not look like a takeover
        self.wait_for(lambda state: state.mode != "OFFBOARD", 3.0, "leaving offboard")
        self._stream.stop()

    def give_up(self, then: str = "land") -> None:
        """End a flight: hold by setpoints, switch to mode Hold, then do `then`: land, return or hold.

        A vehicle that was taken over gets no order. Raises LinkError if the last order is refused.
        """
        if self._taken_by is not None or self.dry:
            self.stop_stream()
            return
        if self._offboard:
            self.fly(Hold())
            self.wait(BRAKE_S)
        refusal: LinkError | None = None
        try:
            self.set_mode("HOLD")
        except LinkError as error:  # a vehicle that cannot hold may still be able to land
            refusal = error
        self.stop_stream()
        if self._taken_by is not None:
            raise self._takeover()
        if then != "hold":
            self.set_mode(ENDINGS[then])
        elif refusal:
            raise refusal
        self._expected = ()  # the autopilot and the safety pilot control the vehicle now

    def fly_to(self, position_ned: Vec3, yaw: float, *, round_first: bool = False) -> Arrival:
        """Fly to a place (m, local frame) from the next tick on, and stay there; return the check of the arrival.

        `round_first`: make one full turn on the way, which ends at the heading `yaw`.
        """
        turning = TurnProgress(yaw, ROUND_RATE, 2.0 * math.pi, None) if round_first else None
        self._stream.fly_to(Destination(position_ned, yaw, turning))
        due_us = self.time_us + (round(2.0 * math.pi / ROUND_RATE * 1e6) if round_first else 0)
        return Arrival(position_ned, yaw, due_us)

    def _speak(self) -> None:
        """Send the heartbeat and the present setpoint, if they are due. `tick` calls this."""
        super()._speak()
        setpoint = self._setpoint(self.state) if self._taken_by is None else None
        if setpoint is None or not self.mode_is_known() or not self._rate.due(self.time_us):
            return
        self.on_setpoint(setpoint)
        if not self.dry:
            self.send(setpoint_message(setpoint, self.time_us // 1000, self.system, self.component))

    def _setpoint(self, state: VehicleState) -> OffboardSetpoint | None:
        if state.position_ned is None or state.velocity_ned is None or state.euler is None:
            return None
        setpoint = self._stream.streamed(state.position_ned, state.velocity_ned, state.euler[2], self.time_us)
        if setpoint is None or self.limits is None:
            return setpoint
        admitted = admit(setpoint, state, self._home(state), self.limits, self.time_us, self.behind_us)
        if admitted.limited != self._limited:
            self._limited = admitted.limited
            self.on_limit(admitted.limited)
        return admitted.setpoint

    def settle_envelope(self) -> None:
        """Fix the places of the limits, so that a later change of home does not move them. Raises LinkError."""
        if self.limits is not None:
            self.limits, self._home_ned = with_local_exclusions(self.limits, self.state), self.state.home_ned

    def _home(self, state: VehicleState) -> Vec3:
        """Return home in the local frame: the autopilot's, or the vehicle's place at the first call."""
        home = self._home_ned or state.home_ned
        if home is not None:
            return home
        assert state.position_ned is not None
        self._first_ned = self._first_ned or state.position_ned
        return self._first_ned
