"""One rule for each failsafe parameter of the autopilot. These parameters set what the vehicle does by itself.

A wrong proposal is dangerous, so a rule proposes only a value that is right for every vehicle. If the right value is
the owner's choice, the rule only shows the present one. Sources: PX4's parameter reference; failsafe.cpp, if a rule
names it; our own measurements where the reference gives no answer.

The parameters of the autopilot's geofence have rules too: the geofence is the last limit if our safety envelope fails.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from foundation.mavlink import dialect
from foundation.protocol import SPEED_MAX
from hil.link.link import Link
from hil.link.parameters import Parameters, Value
from hil.preflight.observation import Change, Finding, Row, RuleResult, bad, good, unclear

OFFBOARD_LOSS = {0: "Position", 1: "Altitude", 2: "Stabilized", 3: "Return", 4: "Land", 5: "Hold", 6: "Terminate",
                 7: "Disarm"}  # fmt: skip
LINK_LOSS = {0: "nothing", 1: "Hold", 2: "Return", 3: "Land", 5: "Terminate", 6: "Disarm"}
LOW_BATTERY = {0: "a warning", 1: "Return", 2: "Land", 3: "Return, then Land", 4: "Terminate"}
KILLING = (5, 6)  # values of NAV_RCL_ACT and NAV_DLL_ACT that stop the motors in the air
EXCEPT_OFFBOARD = 4  # bit 2 of COM_RCL_EXCEPT: in offboard, lost sticks are ignored
# bits of COM_RC_OVERRIDE: moving the sticks takes over in automatic modes (bit 0) and in offboard (bit 1)
OVERRIDE = 1 | 2
MANUAL_SLOTS = (0, 1, 2, 6, 8, 9)  # COM_FLTMODEn: Manual, Altitude, Position, Acro, Stabilized, Position Slow
SLOTS = tuple(f"COM_FLTMODE{n}" for n in range(1, 7))
# s, lowest, highest and proposed COM_OF_LOSS_T. Below 0.5 s a short gap of the radio would end Offboard.
LOSS_LEAST, LOSS_MOST, LOSS_GOOD = 0.5, 1.0, 0.5
FENCE_ACTIONS = {0: "nothing", 1: "a warning", 2: "Hold", 3: "Return", 4: "Terminate", 5: "Land"}
FENCE_RADIUS = 150.0  # m from home: more than the envelope's 100 m, so the fence acts only if the envelope fails
FENCE_HEIGHT = 120.0  # m: the legal ceiling in the EU and the USA, and more than RTL_RETURN_ALT's default of 60 m
OBEYED = {1: "unsigned messages are obeyed over USB only", 2: "unsigned messages are ignored"}  # MAV_SIGN_CFG
UNKNOWN_ACTION = "an unknown action"
RETURN_OR_LAND = "choose 2 (Return) or 3 (Land)"


@dataclass(frozen=True, slots=True)
class Situation:
    """The facts that the rules use."""

    values: Mapping[str, Value | None]  # by parameter name; None: the autopilot did not send the value
    sticks: bool = False  # stick input of a transmitter (the pilot's radio) reaches the autopilot
    version: tuple[int, int] = (0, 0)  # of the firmware; (0, 0) when unknown
    station: bool = False  # heartbeats of a ground station arrive on this link
    fence_points: int | None = None  # points of the uploaded geofence; None: no reply


FailsafeRule = Callable[[Situation, Value], RuleResult]


def _wrong(new: Value, why: str, reason: str) -> RuleResult:
    """Return a failed result that proposes the value `new`."""
    return RuleResult(False, why, f"set it to {new:g}, which --fix proposes", new, reason)


def _offboard_loss(s: Situation, value: Value) -> RuleResult:
    """Judge COM_OBL_RC_ACT, the action when setpoints stop.

    Measured without sticks: with the value 0 the mode becomes POSCTL, and the vehicle sinks at 0.7 m/s. With 5 the
    vehicle stops and holds its position.
    """
    lost = f"when our setpoints stop: {OFFBOARD_LOSS.get(int(value), UNKNOWN_ACTION)}"
    if value == 5:
        return good(f"{lost}, it stays in place")
    if value in (3, 4):
        return good(f"{lost}, as configured; with 5 it stays in place")
    if value in (6, 7):
        effect = "the vehicle would fall when our setpoints stop"
    elif s.sticks:
        effect = "the vehicle would follow the sticks, even a throttle that is down"
    else:
        effect = "without stick input the vehicle sinks to the ground in that mode"
    return _wrong(5, f"{lost}. {effect[0].upper()}{effect[1:]}", f"{effect}; with Hold it stays in place")


def _offboard_timeout(s: Situation, value: Value) -> RuleResult:
    """Judge COM_OF_LOSS_T, the time (s) for which the vehicle still flies the last velocity when setpoints stop."""
    effect = f"the last setpoint goes on for {value:g} s, {value * SPEED_MAX:.1f} m at {SPEED_MAX:g} m/s"
    reason = f"the failsafe then acts {LOSS_GOOD:g} s after the last setpoint; the agent sends 20 setpoints a second"
    if not LOSS_LEAST <= value <= LOSS_MOST:
        too = "long" if value > LOSS_MOST else "short for a radio with gaps"
        return _wrong(LOSS_GOOD, f"{effect}: too {too}", reason)
    return good(effect) if value <= LOSS_GOOD else RuleResult(True, effect, new=LOSS_GOOD, reason=reason)


def _stick_exception(s: Situation, value: Value) -> RuleResult:
    """Judge COM_RCL_EXCEPT, the modes that ignore lost sticks.

    Since PX4 1.14, sticks that are absent at arming do not count as lost: failsafe.cpp.
    """
    exempt = int(value) & EXCEPT_OFFBOARD
    if s.sticks and exempt:
        reason = "a safety pilot must notice that the sticks are lost"
        return _wrong(int(value) & ~EXCEPT_OFFBOARD, "in offboard, lost sticks are ignored", reason)
    if s.sticks:
        return good("in offboard, lost sticks trigger the failsafe too")
    if not exempt and (0, 0) < s.version < (1, 14):
        why, reason = "without sticks the vehicle leaves offboard at once", "this firmware treats absent sticks as lost"
        return _wrong(int(value) | EXCEPT_OFFBOARD, why, reason)
    if exempt:
        return good("no sticks, and none needed; clear bit 2 before you fly with sticks")
    return good("no sticks at arming, and none needed in flight")


def _stick_loss(s: Situation, value: Value) -> RuleResult:
    """Judge NAV_RCL_ACT, the action when the sticks are lost."""
    action = LINK_LOSS.get(int(value), UNKNOWN_ACTION)
    if value in KILLING:
        return bad(f"sticks lost: {action}, so the vehicle falls", RETURN_OR_LAND)
    if s.sticks and value not in (1, 2, 3):
        return bad(f"sticks lost: {action}", RETURN_OR_LAND)
    return good(f"sticks lost: {action}" if s.sticks else f"{action}; there are no sticks")


def _station_loss(s: Situation, value: Value) -> RuleResult:
    """Judge NAV_DLL_ACT, the action when the ground station is lost. The agent does not count as a ground station.

    If the value is above 0, PX4 arms only with a ground station: rcAndDataLinkCheck.cpp.
    """
    action = LINK_LOSS.get(int(value), UNKNOWN_ACTION)
    if value in KILLING:
        return bad(f"ground station lost: {action}, so the vehicle falls", RETURN_OR_LAND)
    if value == 0 and not s.sticks:
        why = "ground station lost: nothing; without sticks no person can take over"
        return unclear(why, "fly with sticks, or with a station and 2 (Return)")
    if value > 0 and not s.station:
        why = "no ground station is on this link; without one the vehicle refuses to arm"
        return unclear(why, "connect a ground station")
    return good(f"ground station lost: {action}")


def _low_battery(s: Situation, value: Value) -> RuleResult:
    """Judge COM_LOW_BAT_ACT, the action at a critical battery level."""
    action = LOW_BATTERY.get(int(value), UNKNOWN_ACTION)
    if value in (1, 2, 3):
        return good(f"battery critical: {action}")
    reason = "at the critical level the vehicle returns, at the emergency level it lands in place"
    return _wrong(3, f"battery critical: only {action}", reason)


def _stick_override(s: Situation, value: Value) -> RuleResult:
    """Judge COM_RC_OVERRIDE, the modes in which moving the sticks takes over."""
    if not s.sticks:
        return good("no sticks, so no takeover by sticks")
    if int(value) & OVERRIDE == OVERRIDE:
        return good("moving the sticks takes over from the agent")
    reason = "the safety pilot takes over by moving the sticks, in offboard and in the Hold after it"
    return _wrong(int(value) | OVERRIDE, "moving the sticks does not take over in every mode", reason)


def _position_lost(s: Situation, value: Value) -> RuleResult:
    """Judge COM_POS_FS_EPH, the position error (m) above which the position counts as lost."""
    if 0.0 < value <= 10.0:
        return good(f"a position with an error above {value:g} m counts as lost")
    return bad("a lost position is not noticed", "5 m is PX4's default")


def _speed(s: Situation, value: Value) -> RuleResult:
    """Judge MPC_XY_VEL_MAX, the autopilot's limit on the horizontal velocity that the agent commands."""
    if value < SPEED_MAX:
        return bad(f"the agent commands up to {SPEED_MAX:g} m/s, which this limit cuts", "raise it")
    return good(f"the agent commands {SPEED_MAX:g} m/s at most; the autopilot allows {value:g} m/s")


def _vertical_speed(verb: str) -> FailsafeRule:
    """Return the rule of MPC_Z_VEL_MAX_UP or MPC_Z_VEL_MAX_DN."""

    def rule(s: Situation, value: Value) -> RuleResult:
        effect = f"the agent {verb} at up to {SPEED_MAX:g} m/s, which this limit"
        return bad(f"{effect} cuts", "raise it") if value < SPEED_MAX else good(f"{effect} allows")

    return rule


def _hitl(s: Situation, value: Value) -> RuleResult:
    """Judge SYS_HITL, whether the board flies a simulated vehicle."""
    if value > 0:
        fix = "for a real flight set it to 0 and reboot; for a simulation remove the propellers"
        return unclear("this board flies a simulated vehicle", fix)
    return good("the autopilot flies a real vehicle, or PX4 itself is simulated (SITL)")


def _fence_action(s: Situation, value: Value) -> RuleResult:
    """Judge GF_ACTION, the action when the vehicle breaches the fence."""
    breached = f"fence breached: {FENCE_ACTIONS.get(int(value), UNKNOWN_ACTION)}"
    if value in (2, 3, 5):
        return good(breached)
    consequence = ", it falls" if value == 4 else " and no more"
    return _wrong(2, f"{breached}{consequence}", "a vehicle that breaches the fence stops there, and a person decides")


def _fence_radius(s: Situation, value: Value) -> RuleResult:
    """Judge GF_MAX_HOR_DIST, the radius of the fence (m)."""
    drawn = _drawn_fence(s)
    if value > 0:
        return good(f"at most {value:g} m from home" + (f", and {drawn}" if drawn else ""))
    if drawn:
        return good(drawn)
    why, reason = "only our program keeps the vehicle near home", "a second limit beyond the 100 m of our envelope"
    return _wrong(FENCE_RADIUS, why, reason)


def _drawn_fence(s: Situation) -> str:
    return f"a geofence of {s.fence_points} points was uploaded" if s.fence_points else ""


def _fence_height(s: Situation, value: Value) -> RuleResult:
    """Judge GF_MAX_VER_DIST, the height of the fence (m)."""
    if value > 0:
        return good(f"at most {value:g} m above home")
    why = "only our program limits the height"
    # a fence below RTL_RETURN_ALT would stop a returning vehicle
    if (s.values.get("RTL_RETURN_ALT") or 0.0) >= FENCE_HEIGHT:
        return bad(why, f"lower RTL_RETURN_ALT below {FENCE_HEIGHT:g}, then run this again")
    return _wrong(FENCE_HEIGHT, why, "a second limit above our envelope's; it is the legal limit in most countries")


def _return_height(s: Situation, value: Value) -> RuleResult:
    """Judge RTL_RETURN_ALT, the height (m) to which a returning vehicle climbs first."""
    climbs, height = f"Return first climbs to {value:g} m", s.values.get("GF_MAX_VER_DIST")
    if height and value >= height:
        return bad(f"{climbs}, above the fence at {height:g} m", "lower it below the fence")
    return good(f"{climbs}; no obstacle may be higher")


def _signing(s: Situation, value: Value) -> RuleResult:
    """Judge MAV_SIGN_CFG, whether unsigned messages are ignored.

    Our autopilot does not have this parameter, and ignores unsigned messages once it has a key. By default, PX4 1.17
    with a key signs its messages and still obeys unsigned ones.
    """
    if int(value) in OBEYED:
        return good(OBEYED[int(value)])
    why = "the vehicle has the key, but it also obeys unsigned messages"
    return _wrong(1, why, "only signed messages are obeyed, except over USB")


FAILSAFE_RULES: dict[str, FailsafeRule] = {
    "COM_OBL_RC_ACT": _offboard_loss,
    "COM_OF_LOSS_T": _offboard_timeout,
    "COM_RCL_EXCEPT": _stick_exception,
    "NAV_RCL_ACT": _stick_loss,
    "NAV_DLL_ACT": _station_loss,
    "COM_LOW_BAT_ACT": _low_battery,
    "COM_RC_OVERRIDE": _stick_override,
    "COM_POS_FS_EPH": _position_lost,
    "MPC_XY_VEL_MAX": _speed,
    "MPC_Z_VEL_MAX_UP": _vertical_speed("climbs"),
    "MPC_Z_VEL_MAX_DN": _vertical_speed("sinks"),
    "SYS_HITL": _hitl,
}
FENCE_RULES: dict[str, FailsafeRule] = {
    "GF_ACTION": _fence_action,
    "GF_MAX_HOR_DIST": _fence_radius,
    "GF_MAX_VER_DIST": _fence_height,
    "RTL_RETURN_ALT": _return_height,
}
SIGNING_RULES: dict[str, FailsafeRule] = {"MAV_SIGN_CFG": _signing}  # of PX4 from 1.17 on
PARAMETERS = (*FAILSAFE_RULES, "COM_RC_IN_MODE", "RC_MAP_FLTMODE", "RC_MAP_KILL_SW", *SLOTS, *FENCE_RULES)
VITAL = ("COM_OBL_RC_ACT", "COM_OF_LOSS_T")  # they act when setpoints stop, so the check fails without their values


def read_failsafe(link: Link) -> str:
    """Read the action that the vehicle takes when setpoints stop, in words for a user. Raises LinkError."""
    values = Parameters(link).read_many(VITAL)
    action, after_s = (values[name] for name in VITAL)
    if action is None:
        return "COM_OBL_RC_ACT, whose value is unknown"
    after = "" if after_s is None else f", after COM_OF_LOSS_T = {after_s:g} s"
    return f"COM_OBL_RC_ACT = {action:g} ({OFFBOARD_LOSS.get(int(action), UNKNOWN_ACTION)}){after}"


def findings(situation: Situation) -> list[Finding]:
    """Return one finding on the sticks, one for each rule, and two on the pilot's switches if there are sticks.

    A signing rule gives no finding if the autopilot did not send its parameter.
    """
    switches = [_mode_switch(situation).named("mode switch"), _kill_switch(situation).named("kill switch")]
    signing = {name: rule for name, rule in SIGNING_RULES.items() if situation.values.get(name) is not None}
    return [
        Finding(_sticks(situation).named("sticks")),
        *_judged(FAILSAFE_RULES, situation),
        *(map(Finding, switches) if situation.sticks else ()),
        *_judged(FENCE_RULES | signing, situation),
    ]


def _judged(rules: Mapping[str, FailsafeRule], situation: Situation) -> Iterator[Finding]:
    for name, rule in rules.items():
        value = situation.values.get(name)
        if value is None:
            drawn = _drawn_fence(situation) if name == "GF_MAX_HOR_DIST" else ""
            yield Finding(Row(name, False if name in VITAL else None, drawn or "the autopilot does not send it"))
            continue
        judged = rule(situation, value)
        change = None if judged.new is None else Change(name, value, judged.new, judged.reason)
        yield Finding(judged.named(f"{name} = {value:g}"), change)


def _sticks(s: Situation) -> RuleResult:
    mode = s.values.get("COM_RC_IN_MODE")
    if s.sticks:
        return good("stick input arrives; the advice below is for a flight with a safety pilot")
    if mode == 4:
        return unclear(
            "COM_RC_IN_MODE = 4: all sticks are ignored, so no person can take over by hand", "0 for a transmitter"
        )
    return unclear("none: no person can take over by hand", "switch the transmitter on, and run this again")


def _mode_switch(s: Situation) -> RuleResult:
    if s.values.get("COM_RC_IN_MODE") == 1:
        return unclear(
            "COM_RC_IN_MODE = 1: the sticks are a ground station's joystick, and"
            " the ground station assigns the joystick's buttons",
            "try the button that changes the mode, because the safety pilot takes over with it",
        )
    channel, slots = s.values.get("RC_MAP_FLTMODE"), [s.values.get(name) for name in SLOTS]
    if channel is None:
        return unclear("the autopilot does not send RC_MAP_FLTMODE")
    if not channel:
        return bad(
            "RC_MAP_FLTMODE = 0: no switch of the transmitter changes the mode",
            "map a switch, because the safety pilot takes over with it",
        )
    if not any(slot in MANUAL_SLOTS for slot in slots):
        return bad(
            f"channel {channel:g}, but no position of the switch is a manual mode",
            "put Position (2) on one of COM_FLTMODE1 … 6",
        )
    return good(f"channel {channel:g}, with a manual mode")


def _kill_switch(s: Situation) -> RuleResult:
    channel = s.values.get("RC_MAP_KILL_SW")
    if channel:
        return good(f"channel {channel:g}")
    return unclear("none is mapped", "map one for the first flights; it stops the motors at once")


REPLY_TIMEOUT_US = 700_000  # µs of vehicle time
FENCE_TRIES = 3


def count_fence_points(link: Link) -> int | None:
    """Return the number of points of the uploaded fence, None if the autopilot does not reply."""
    counts: list[int] = []

    def on_message(message: dialect.MAVLink_message) -> None:
        if message.get_msgId() != dialect.MAVLINK_MSG_ID_MISSION_COUNT or message.get_srcSystem() != link.system:
            return
        if message.mission_type == dialect.MAV_MISSION_TYPE_FENCE:
            counts.append(int(message.count))

    fence, vehicle = dialect.MAV_MISSION_TYPE_FENCE, (link.system, link.component)
    with link.listening(on_message):
        for _ in range(FENCE_TRIES):
            link.send(dialect.MAVLink_mission_request_list_message(*vehicle, fence))
            end_us = link.time_us + REPLY_TIMEOUT_US
            while not counts and link.time_us < end_us:
                link.tick()
            if counts:  # cancel the transfer of the points that the request has started
                cancelled = dialect.MAV_MISSION_OPERATION_CANCELLED
                link.send(dialect.MAVLink_mission_ack_message(*vehicle, cancelled, fence))
                return counts[0]
    return None
