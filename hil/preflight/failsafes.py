"""One rule for each failsafe parameter of the autopilot. These parameters set what the vehicle does by itself.

A wrong proposal is dangerous, so a rule proposes only a value that is right for every vehicle. If the right value is
the owner's choice, the rule only shows the present one. Sources: PX4's parameter reference; failsafe.cpp, if a rule
names it; our own measurements where the reference gives no answer.

The parameters of the autopilot's geofence have rules too: the geofence is the last limit if our safety envelope fails.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from foundation.mavlink import dialect
from foundation.protocol import SPEED_MAX
from hil.link.link import Link
from hil.link.parameters import Parameters, Value
from hil.preflight.observation import Change, Finding, Row

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


@dataclass(frozen=True, slots=True)
class Situation:
    """The facts that the rules use."""

    values: Mapping[str, Value | None]  # by parameter name; None: the autopilot did not send the value
    sticks: bool = False  # stick input of a transmitter (the pilot's radio) reaches the autopilot
    version: tuple[int, int] = (0, 0)  # of the firmware; (0, 0) when unknown
    station: bool = False  # heartbeats of a ground station arrive on this link


FailsafeRule = Callable[[Situation, Value], Finding]


def _offboard_loss(s: Situation, value: Value) -> Finding:
    """Judge COM_OBL_RC_ACT, the action when setpoints stop.

    Measured without sticks: with the value 0 the mode becomes POSCTL, and the vehicle sinks at 0.7 m/s. With 5 the
    vehicle stops and holds its position.
    """
    shown = OFFBOARD_LOSS.get(int(value), "an unknown action")
    lost = f"when our setpoints stop: {shown}"
    if value == 5:
        return _good("COM_OBL_RC_ACT", value, f"{lost}, it stays in place")
    if value in (3, 4):
        return _good("COM_OBL_RC_ACT", value, f"{lost}, as configured; with 5 it stays in place")
    if value in (6, 7):
        reason = "the vehicle would fall when our setpoints stop; with Hold it stays in place"
    elif s.sticks:
        reason = "the vehicle would follow the sticks, even a throttle that is down; with Hold it stays in place"
    else:
        reason = "without stick input the vehicle sinks to the ground in that mode; with Hold it stays in place"
    effect = reason.partition(";")[0]
    return _failed_with_change("COM_OBL_RC_ACT", value, 5, f"{lost}. {effect[0].upper()}{effect[1:]}", reason)


def _offboard_timeout(s: Situation, value: Value) -> Finding:
    """Judge COM_OF_LOSS_T, the time (s) for which the vehicle still flies the last velocity when setpoints stop."""
    effect = f"the last setpoint goes on for {value:g} s, {value * SPEED_MAX:.1f} m at {SPEED_MAX:g} m/s"
    reason = f"the failsafe then acts {LOSS_GOOD:g} s after the last setpoint; the agent sends 20 setpoints a second"
    if not LOSS_LEAST <= value <= LOSS_MOST:
        too = "long" if value > LOSS_MOST else "short for a radio with gaps"
        return _failed_with_change("COM_OF_LOSS_T", value, LOSS_GOOD, f"{effect}: too {too}", reason)
    change = None if value <= LOSS_GOOD else Change("COM_OF_LOSS_T", value, LOSS_GOOD, reason)
    return Finding(Row(_named("COM_OF_LOSS_T", value), True, effect), change)


def _stick_exception(s: Situation, value: Value) -> Finding:
    """Judge COM_RCL_EXCEPT, the modes that ignore lost sticks.

    Since PX4 1.14, sticks that are absent at arming do not count as lost: failsafe.cpp.
    """
    exempt = int(value) & EXCEPT_OFFBOARD
    if s.sticks and exempt:
        return _failed_with_change(
            "COM_RCL_EXCEPT",
            value,
            int(value) & ~EXCEPT_OFFBOARD,
            "in offboard, lost sticks are ignored",
            "a safety pilot must notice that the sticks are lost",
        )
    if s.sticks:
        return _good("COM_RCL_EXCEPT", value, "in offboard, lost sticks trigger the failsafe too")
    if not exempt and (0, 0) < s.version < (1, 14):
        return _failed_with_change("COM_RCL_EXCEPT", value, int(value) | EXCEPT_OFFBOARD, "without sticks the vehicle"
            " leaves offboard at once",
                     "this firmware treats absent sticks as lost")  # fmt: skip
    if exempt:
        return _good("COM_RCL_EXCEPT", value, "no sticks, and none needed; clear bit 2 before you fly with sticks")
    return _good("COM_RCL_EXCEPT", value, "no sticks at arming, and none needed in flight")


def _stick_loss(s: Situation, value: Value) -> Finding:
    """Judge NAV_RCL_ACT, the action when the sticks are lost."""
    action = LINK_LOSS.get(int(value), "an unknown action")
    if value in KILLING:
        return _bad(
            "NAV_RCL_ACT", value, f"sticks lost: {action}, so the vehicle falls", "choose 2 (Return) or 3 (Land)"
        )
    if s.sticks and value not in (1, 2, 3):
        return _bad("NAV_RCL_ACT", value, f"sticks lost: {action}", "choose 2 (Return) or 3 (Land)")
    return _good("NAV_RCL_ACT", value, f"sticks lost: {action}" if s.sticks else f"{action}; there are no sticks")


def _station_loss(s: Situation, value: Value) -> Finding:
    """Judge NAV_DLL_ACT, the action when the ground station is lost. The agent does not count as a ground station.

    If the value is above 0, PX4 arms only with a ground station: rcAndDataLinkCheck.cpp.
    """
    action = LINK_LOSS.get(int(value), "an unknown action")
    if value in KILLING:
        return _bad(
            "NAV_DLL_ACT",
            value,
            f"ground station lost: {action}, so the vehicle falls",
            "choose 2 (Return) or 3 (Land)",
        )
    if value == 0 and not s.sticks:
        return _judge("NAV_DLL_ACT", value, "ground station lost: nothing; without sticks no person can take over",
                      "fly with sticks, or with a station and 2 (Return)")  # fmt: skip
    if value > 0 and not s.station:
        return _judge("NAV_DLL_ACT", value, "no ground station is on this link; without one the vehicle refuses to arm",
                      "connect one")  # fmt: skip
    return _good("NAV_DLL_ACT", value, f"ground station lost: {action}")


def _low_battery(s: Situation, value: Value) -> Finding:
    """Judge COM_LOW_BAT_ACT, the action at a critical battery level."""
    action = LOW_BATTERY.get(int(value), "an unknown action")
    if value in (1, 2, 3):
        return _good("COM_LOW_BAT_ACT", value, f"battery critical: {action}")
    return _failed_with_change("COM_LOW_BAT_ACT", value, 3, f"battery critical: only {action}",
                 "at the critical level the vehicle returns, at the emergency level it lands in place")  # fmt: skip


def _stick_override(s: Situation, value: Value) -> Finding:
    """Judge COM_RC_OVERRIDE, the modes in which moving the sticks takes over."""
    if not s.sticks:
        return _good("COM_RC_OVERRIDE", value, "no sticks, so no takeover by sticks")
    if int(value) & OVERRIDE == OVERRIDE:
        return _good("COM_RC_OVERRIDE", value, "moving the sticks takes over from the agent")
    return _failed_with_change(
        "COM_RC_OVERRIDE",
        value,
        int(value) | OVERRIDE,
        "moving the sticks does not take over in every mode",
        "the safety pilot takes over by moving the sticks, in offboard and in the Hold after it",
    )


def _position_lost(s: Situation, value: Value) -> Finding:
    """Judge COM_POS_FS_EPH, the position error (m) above which the position counts as lost."""
    if 0.0 < value <= 10.0:
        return _good("COM_POS_FS_EPH", value, f"a position with an error above {value:g} m counts as lost")
    return _bad("COM_POS_FS_EPH", value, "a lost position is not noticed", "5 m is PX4's default")


def _speed(s: Situation, value: Value) -> Finding:
    """Judge MPC_XY_VEL_MAX, the autopilot's limit on the horizontal velocity that the agent commands."""
    if value < SPEED_MAX:
        return _bad(
            "MPC_XY_VEL_MAX", value, f"the agent commands up to {SPEED_MAX:g} m/s, which this limit cuts", "raise it"
        )
    return _good("MPC_XY_VEL_MAX", value, f"the agent commands {SPEED_MAX:g} m/s at most; the autopilot"
        f" allows {value:g} m/s")  # fmt: skip


def _vertical_speed(name: str, verb: str) -> FailsafeRule:
    """Return the rule of MPC_Z_VEL_MAX_UP or MPC_Z_VEL_MAX_DN."""

    def rule(s: Situation, value: Value) -> Finding:
        if value < SPEED_MAX:
            return _bad(name, value, f"the agent {verb} at up to {SPEED_MAX:g} m/s, which this limit cuts", "raise it")
        return _good(name, value, f"the agent {verb} at up to {SPEED_MAX:g} m/s, which this limit allows")

    return rule


def _hitl(s: Situation, value: Value) -> Finding:
    """Judge SYS_HITL, whether the board flies a simulated vehicle."""
    if value > 0:
        return _judge("SYS_HITL", value, "this board flies a simulated vehicle",
                      "for a real flight set it to 0 and reboot; for a simulation remove the propellers")  # fmt: skip
    return _good("SYS_HITL", value, "the autopilot flies a real vehicle, or PX4 itself is simulated (SITL)")


RULES: dict[str, FailsafeRule] = {
    "COM_OBL_RC_ACT": _offboard_loss,
    "COM_OF_LOSS_T": _offboard_timeout,
    "COM_RCL_EXCEPT": _stick_exception,
    "NAV_RCL_ACT": _stick_loss,
    "NAV_DLL_ACT": _station_loss,
    "COM_LOW_BAT_ACT": _low_battery,
    "COM_RC_OVERRIDE": _stick_override,
    "COM_POS_FS_EPH": _position_lost,
    "MPC_XY_VEL_MAX": _speed,
    "MPC_Z_VEL_MAX_UP": _vertical_speed("MPC_Z_VEL_MAX_UP", "climbs"),
    "MPC_Z_VEL_MAX_DN": _vertical_speed("MPC_Z_VEL_MAX_DN", "sinks"),
    "SYS_HITL": _hitl,
}
FAILSAFE_PARAMETERS = (*RULES, "COM_RC_IN_MODE", "RC_MAP_FLTMODE", "RC_MAP_KILL_SW", *SLOTS)
VITAL = ("COM_OBL_RC_ACT", "COM_OF_LOSS_T")  # they act when setpoints stop, so the check fails without their values


def read_failsafe(link: Link) -> str:
    """Read the action that the vehicle takes when setpoints stop, in words for a user. Raises LinkError."""
    values = Parameters(link).read_many(VITAL)
    action, after_s = (values[name] for name in VITAL)
    if action is None:
        return "COM_OBL_RC_ACT, whose value is unknown"
    after = "" if after_s is None else f", after COM_OF_LOSS_T = {after_s:g} s"
    return f"COM_OBL_RC_ACT = {action:g} ({OFFBOARD_LOSS.get(int(action), 'an unknown action')}){after}"


def failsafe_findings(situation: Situation) -> list[Finding]:
    """Return one finding on the sticks, one for each rule, and two on the pilot's switches if there are sticks."""
    findings = [Finding(_sticks(situation))]
    for name, rule in RULES.items():
        value = situation.values.get(name)
        if value is None:
            findings.append(_unknown(name, passed=False if name in VITAL else None))
        else:
            findings.append(rule(situation, value))
    if situation.sticks:
        findings += [Finding(_mode_switch(situation)), Finding(_kill_switch(situation))]
    return findings


def _sticks(s: Situation) -> Row:
    mode = s.values.get("COM_RC_IN_MODE")
    if s.sticks:
        return Row("sticks", True, "stick input arrives; the advice below is for a flight with a safety pilot")
    if mode == 4:
        return Row("sticks", None, "COM_RC_IN_MODE = 4: all sticks are ignored, so no person can take over by hand",
                   "0 for a transmitter")  # fmt: skip
    return Row("sticks", None, "none: no person can take over by hand", "switch the transmitter on, and run this again")


def _mode_switch(s: Situation) -> Row:
    if s.values.get("COM_RC_IN_MODE") == 1:
        return Row("mode switch", None, "COM_RC_IN_MODE = 1: the sticks are a ground station's joystick, and"
            " the ground station assigns the joystick's buttons",
                   "try the button that changes the mode, because the safety pilot takes over with it")  # fmt: skip
    channel, slots = s.values.get("RC_MAP_FLTMODE"), [s.values.get(name) for name in SLOTS]
    if channel is None:
        return Row("mode switch", None, "the autopilot does not send RC_MAP_FLTMODE")
    if not channel:
        return Row("mode switch", False, "RC_MAP_FLTMODE = 0: no switch of the transmitter changes the mode",
                   "map a switch, because the safety pilot takes over with it")  # fmt: skip
    if not any(slot in MANUAL_SLOTS for slot in slots):
        return Row("mode switch", False, f"channel {channel:g}, but no position of the switch is a manual mode",
                   "put Position (2) on one of COM_FLTMODE1 … 6")  # fmt: skip
    return Row("mode switch", True, f"channel {channel:g}, with a manual mode")


def _kill_switch(s: Situation) -> Row:
    channel = s.values.get("RC_MAP_KILL_SW")
    if channel:
        return Row("kill switch", True, f"channel {channel:g}")
    return Row("kill switch", None, "none is mapped", "map one for the first flights; it stops the motors at once")


def _named(name: str, value: float) -> str:
    return f"{name} = {value:g}"


def _good(name: str, value: float, why: str) -> Finding:
    return Finding(Row(_named(name, value), True, why))


def _bad(name: str, value: float, why: str, fix: str) -> Finding:
    return Finding(Row(_named(name, value), False, why, fix))


def _judge(name: str, value: float, why: str, fix: str) -> Finding:
    """Return a finding that only a person can judge."""
    return Finding(Row(_named(name, value), None, why, fix))


def _failed_with_change(name: str, value: float, new: float, why: str, reason: str) -> Finding:
    """Return a failed finding with the change that mends it."""
    row = Row(_named(name, value), False, why, f"set it to {new:g}, which --fix proposes")
    return Finding(row, Change(name, value, new, reason))


def _unknown(name: str, passed: bool | None = None) -> Finding:
    return Finding(Row(name, passed, "the autopilot does not tell it"))


FENCE_PARAMETERS = ("GF_ACTION", "GF_MAX_HOR_DIST", "GF_MAX_VER_DIST", "RTL_RETURN_ALT")
FENCE_ACTIONS = {0: "nothing", 1: "a warning", 2: "Hold", 3: "Return", 4: "Terminate", 5: "Land"}
FENCE_RADIUS = 150.0  # m from home: more than the envelope's 100 m, so the fence acts only if the envelope fails
FENCE_HEIGHT = 120.0  # m: the legal ceiling in the EU and the USA, and more than RTL_RETURN_ALT's default of 60 m
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


def fence_findings(values: Mapping[str, Value | None], points: int | None) -> list[Finding]:
    """Return the findings on the action at a breach, the radius and height of the fence, and the height of a return."""
    action, radius, height = values.get("GF_ACTION"), values.get("GF_MAX_HOR_DIST"), values.get("GF_MAX_VER_DIST")
    climb = values.get("RTL_RETURN_ALT")
    return [_action(action), _walls(radius, points), _height(height, climb), _return(climb, height)]


def _action(value: Value | None) -> Finding:
    if value is None:
        return _unknown("GF_ACTION")
    action = FENCE_ACTIONS.get(int(value), "an unknown action")
    if value in (2, 3, 5):
        return _good("GF_ACTION", value, f"fence breached: {action}")
    consequence = ", it falls" if value == 4 else " and no more"
    reason = "a vehicle that breaches the fence stops there, and a person decides"
    return _failed_with_change("GF_ACTION", value, 2, f"fence breached: {action}{consequence}", reason)


def _walls(radius: Value | None, points: int | None) -> Finding:
    drawn = {None: "", 0: ""}.get(points, f"a fence drawn with {points} points")
    if radius is None:
        return Finding(Row("GF_MAX_HOR_DIST", None, drawn or "the autopilot does not tell it"))
    if radius > 0:
        return _good("GF_MAX_HOR_DIST", radius, f"at most {radius:g} m from home" + (f", and {drawn}" if drawn else ""))
    if drawn:
        return _good("GF_MAX_HOR_DIST", radius, drawn)
    why, reason = "only our program keeps the vehicle near home", "a second limit beyond the 100 m of our envelope"
    return _failed_with_change("GF_MAX_HOR_DIST", radius, FENCE_RADIUS, why, reason)


def _height(height: Value | None, climb: Value | None) -> Finding:
    if height is None:
        return _unknown("GF_MAX_VER_DIST")
    if height > 0:
        return _good("GF_MAX_VER_DIST", height, f"at most {height:g} m above home")
    why = "only our program limits the height"
    if climb is not None and climb >= FENCE_HEIGHT:  # a fence below RTL_RETURN_ALT would stop a returning vehicle
        fix = f"lower RTL_RETURN_ALT below {FENCE_HEIGHT:g}, then run this again"
        return _bad("GF_MAX_VER_DIST", height, why, fix)
    reason = "a second limit above our envelope's; it is the legal limit in most countries"
    return _failed_with_change("GF_MAX_VER_DIST", height, FENCE_HEIGHT, why, reason)


def _return(altitude: Value | None, height: Value | None) -> Finding:
    if altitude is None:
        return _unknown("RTL_RETURN_ALT")
    climbs = f"Return first climbs to {altitude:g} m"
    if height and altitude >= height:
        why = f"{climbs}, above the fence at {height:g} m"
        return _bad("RTL_RETURN_ALT", altitude, why, "lower it below the fence")
    return _good("RTL_RETURN_ALT", altitude, f"{climbs}; no obstacle may be higher")


SIGNING_PARAMETERS = ("MAV_SIGN_CFG",)  # of PX4 from 1.17 on
OBEYED = {1: "unsigned messages are obeyed over USB only", 2: "unsigned messages are ignored"}


def signing_findings(values: Mapping[str, Value | None]) -> list[Finding]:
    """Return the finding on MAV_SIGN_CFG: whether unsigned messages are ignored. Empty without this parameter.

    Our autopilot does not have it, and ignores unsigned messages once it has a key. By default, PX4 1.17 with a key
    signs its messages and still obeys unsigned ones.
    """
    value = values.get("MAV_SIGN_CFG")
    if value is None:
        return []
    if int(value) in OBEYED:
        return [_good("MAV_SIGN_CFG", value, OBEYED[int(value)])]
    why, reason = (
        "the vehicle has the key, but it also obeys unsigned messages",
        "only signed messages are obeyed, except over USB",
    )
    return [_failed_with_change("MAV_SIGN_CFG", value, 1, why, reason)]
