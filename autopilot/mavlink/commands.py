"""COMMAND_LONG and COMMAND_INT: a table from command to handler, and the acknowledgement.

Every handler is idempotent, because clients repeat a command until its acknowledgement arrives. A handler returns
a MAV_RESULT, or None for no acknowledgement. The results are as measured on PX4 1.15.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from autopilot.commander.commander import ACCEPTED, DENIED, REJECTED
from autopilot.commander.health import EXTERNAL_MODES
from autopilot.commander.plans import ABOVE_HOME, local_position
from autopilot.mavlink import mission
from autopilot.mavlink.gimbal import DEVICE
from autopilot.mavlink.node import BY_ID, BY_NAME, COMPONENT_ID, Node, Port, sender
from autopilot.mavlink.status_makers import Message, standard_mode
from foundation.frames import Vec3
from foundation.mavlink import MODES, dialect

FAILED, UNSUPPORTED = int(dialect.MAV_RESULT_FAILED), int(dialect.MAV_RESULT_UNSUPPORTED)
FORCE_MAGIC = 21196  # param2 of a forced arming or disarming
INT32_UNKNOWN = (1 << 31) - 1
NAN = math.nan
LOCAL_FRAMES = frozenset({dialect.MAV_FRAME_LOCAL_NED, dialect.MAV_FRAME_LOCAL_OFFSET_NED})
BROADCAST = frozenset({dialect.MAV_CMD_REQUEST_MESSAGE, dialect.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES})
GIMBAL_MESSAGES = frozenset(stream.message_id for stream in BY_ID.values() if stream.name.startswith("GIMBAL_"))
LISTED_MODES = tuple(mode for name, mode in MODES.items() if name not in {"READY", "TERMINATION", *EXTERNAL_MODES})


def _message_id(parameters: Sequence[float]) -> int:
    return round(parameters[0]) if abs(parameters[0]) < 1e8 else -1


def set_message_interval(port: Port, p: Sequence[float]) -> int:
    """Stream the message with id param1 every param2 µs (0: default, -1: off). Returns FAILED for an unknown id."""
    message_id = _message_id(p)
    if message_id not in BY_ID:
        return FAILED
    interval = round(p[1]) if abs(p[1]) < 1e10 else 0
    if interval == 0:
        port.set_default_interval(message_id)
    else:
        port.set_interval(message_id, interval)
    return ACCEPTED


def get_message_interval(port: Port, p: Sequence[float]) -> int:
    """Send MESSAGE_INTERVAL for the id param1 (µs; -1: not streamed, 0: unknown id)."""
    message_id = _message_id(p)
    interval = port.interval_us(message_id) if message_id in BY_ID else 0
    port.send(dialect.MAVLink_message_interval_message(message_id & 0xFFFF, min(interval, 0x7FFFFFFF)))
    return ACCEPTED


def request_message(port: Port, p: Sequence[float]) -> int:
    """Send the message with id param1 now. Returns DENIED for an unknown id, or a gimbal message without a gimbal."""
    message_id = _message_id(p)
    if message_id == dialect.MAVLINK_MSG_ID_AVAILABLE_MODES:
        _send_modes(port, p[1])
    elif message_id in BY_ID and not (message_id in GIMBAL_MESSAGES and port.telemetry(message_id) is None):
        port.send_telemetry(message_id)
    else:
        return DENIED
    return ACCEPTED


def send_one(port: Port, name: str) -> int:
    """Send one message of the stream table now."""
    port.send_telemetry(BY_NAME[name].message_id)
    return ACCEPTED


def _send_modes(port: Port, index: float) -> None:
    """Send AVAILABLE_MODES: all modes for index 0, else the mode with this index (from 1)."""
    wanted = round(index) if math.isfinite(index) and abs(index) < 1e6 else 0
    for i, mode in enumerate(LISTED_MODES, start=1):
        if wanted in (0, i):
            properties = 2 if mode.name in ("ORBIT", "PRECLAND") else 0  # MAV_MODE_PROPERTY_NOT_USER_SELECTABLE
            port.send(
                dialect.MAVLink_available_modes_message(
                    len(LISTED_MODES), i, standard_mode(mode.name), mode.custom_mode, properties, mode.name.encode()
                )
            )


_AUTO = MODES["HOLD"].main
_AUTO_MODES = {mode.sub: mode.name for mode in MODES.values() if mode.main == _AUTO and mode.name != "READY"}
_AUTO_MODES[0] = "MISSION"
# Sub modes are ignored here: ORBIT, a sub mode of POSCTL, has its own command, and Position Slow is not implemented.
_MANUAL_MODES = {
    mode.main: mode.name
    for mode in MODES.values()
    if mode.main != _AUTO and not mode.sub and mode.name != "TERMINATION"
}


@dataclass(frozen=True, slots=True)
class Command:
    """A command of COMMAND_LONG or COMMAND_INT. `p[0]` is param1; latitude, longitude in degrees; nan = not given."""

    id: int
    p: tuple[float, float, float, float, float, float, float]
    frame: int
    source: tuple[int, int]  # system and component that sent it

    def number(self, i: int) -> int | None:
        """Return param i (1 … 7) as an integer; None if it is nan or too large."""
        value = self.p[i - 1]
        return round(value) if abs(value) < 1e9 else None


CommandHandler = Callable[[Node, Port, Command], int | None]


def command_long(node: Node, port: Port, message: Message) -> None:
    m = message
    p = (m.param1, m.param2, m.param3, m.param4, m.param5, m.param6, m.param7)
    _run(node, port, m, Command(m.command, p, dialect.MAV_FRAME_GLOBAL, sender(m)))


def command_int(node: Node, port: Port, message: Message) -> None:
    """Act on COMMAND_INT: x and y are in 1e-7 degrees (1e-4 m in local frames), INT32_MAX = not given."""
    m = message
    scale = 1e-4 if m.frame in LOCAL_FRAMES else 1e-7
    x, y = (NAN if value == INT32_UNKNOWN else value * scale for value in (m.x, m.y))
    _run(node, port, m, Command(m.command, (m.param1, m.param2, m.param3, m.param4, x, y, m.z), m.frame, sender(m)))


def _run(node: Node, port: Port, message: Message, command: Command) -> None:
    broadcast = message.target_system == 0
    if broadcast and command.id not in BROADCAST:
        return  # ignored without an answer, as on PX4: a fleet must not arm by accident
    if (not broadcast and message.target_system != node.system_id) or message.target_component not in (0, COMPONENT_ID):
        result: int | None = FAILED
    else:
        handler = HANDLERS.get(command.id)
        result = handler(node, port, command) if handler is not None else UNSUPPORTED
    if result is not None:
        _acknowledge(port, command, result)


def _acknowledge(port: Port, command: Command, result: int) -> None:
    port.send(dialect.MAVLink_command_ack_message(command.id, result, 0, 0, *command.source))


def set_mode_message(node: Node, port: Port, message: Message) -> None:
    """Act on the old message SET_MODE. As in PX4, it is executed and acknowledged as the command DO_SET_MODE."""
    main, sub = message.custom_mode >> 16 & 0xFF, message.custom_mode >> 24 & 0xFF
    parameters = (float(message.base_mode), float(main), float(sub), 0.0, 0.0, 0.0, 0.0)
    command = Command(dialect.MAV_CMD_DO_SET_MODE, parameters, dialect.MAV_FRAME_GLOBAL, sender(message))
    _acknowledge(port, command, _do_set_mode(node, port, command))


def _do_set_mode(node: Node, port: Port, c: Command) -> int:
    base, main, sub = ((c.number(i) or 0) & 0xFF for i in (1, 2, 3))
    if not base & dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
        name = _base_mode(base)
    elif main == _AUTO:
        name = _AUTO_MODES.get(sub)
        if name is None:
            node.send_text(dialect.MAV_SEVERITY_CRITICAL, "Unsupported auto mode")
            return REJECTED
    else:
        name = _MANUAL_MODES.get(main)
    if name is None:
        return ACCEPTED  # as measured, PX4 accepts the command and changes nothing
    return node.vehicle.commander.set_mode(name)


def _base_mode(base: int) -> str | None:
    """Return the mode that MAV_MODE_FLAGs select without a custom mode (PX4, Commander::handle_command), or None."""
    if base & dialect.MAV_MODE_FLAG_AUTO_ENABLED:
        return "MISSION"
    if not base & dialect.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED:
        return None
    if base & dialect.MAV_MODE_FLAG_GUIDED_ENABLED:
        return "POSCTL"
    return "STABILIZED" if base & dialect.MAV_MODE_FLAG_STABILIZE_ENABLED else "MANUAL"


def _arm_disarm(node: Node, port: Port, c: Command) -> int | None:
    wish = c.number(1)
    if wish not in (0, 1):
        return None
    force = c.number(2) == FORCE_MAGIC
    commander = node.vehicle.commander
    if wish and node.vehicle.calibration.running and not commander.armed:
        node.send_text(dialect.MAV_SEVERITY_CRITICAL, "Arming denied: calibrating")
        return REJECTED
    return commander.arm(force) if wish else commander.disarm(force)


def _takeoff(node: Node, port: Port, c: Command) -> int:
    state = node.vehicle.state
    z = state.origin_alt_m - c.p[6] if state.origin_set and abs(c.p[6]) < 1e5 else NAN
    return node.vehicle.commander.take_off(z)


def _place(node: Node, c: Command, relative: bool) -> Vec3:
    """Return params 5 to 7 as a local position (m, NED); nan if not given.

    With `relative`, an altitude in a frame of ABOVE_HOME is above home. All other altitudes are above sea level.
    """
    vehicle, (lat, lon, alt) = node.vehicle, c.p[4:]
    if not (abs(lat) <= 90.0 and abs(lon) <= 180.0):
        lat = lon = NAN
    above_home = relative and c.frame in ABOVE_HOME
    return local_position(vehicle.state, vehicle.commander.flight.home, lat, lon, alt, above_home=above_home)


def _reposition(node: Node, port: Port, c: Command) -> int:
    if c.number(2) != 1:  # only MAV_DO_REPOSITION_FLAGS_CHANGE_MODE is supported
        return UNSUPPORTED
    return node.vehicle.commander.reposition(_place(node, c, relative=True), c.p[3], c.p[0])


def _orbit(node: Node, port: Port, c: Command) -> int:
    radius = c.p[0] if abs(c.p[0]) < 1e5 and c.p[0] != 0.0 else 10.0
    speed = c.p[1] if abs(c.p[1]) < 1e3 else 2.0
    # MAVSDK sends the altitude above sea level with the default frame, so the frame is ignored
    look = c.number(3)
    if look is None or not 0 <= look <= 4:  # ORBIT_YAW_BEHAVIOUR; 5 (unchanged) and nan mean the default
        look = 0
    return node.vehicle.commander.circle(_place(node, c, relative=False), radius, speed, look)


def _change_speed(node: Node, port: Port, c: Command) -> int:
    node.vehicle.commander.flight.change_speed(c.p[1])
    return ACCEPTED


def _set_home(node: Node, port: Port, c: Command) -> int:
    commander = node.vehicle.commander
    if not node.vehicle.parameters["COM_HOME_EN"]:
        return DENIED
    at_vehicle = c.number(1) == 1
    place = _place(node, c, relative=False)
    if not at_vehicle and not all(map(math.isfinite, place)):
        return DENIED
    if commander.flight.set_home(None if at_vehicle else place):
        node.forget_telemetry()
        for other_port in node.ports:
            other_port.send_telemetry(BY_NAME["HOME_POSITION"].message_id)
    return ACCEPTED


def _run_prearm_checks(node: Node, port: Port, c: Command) -> int:
    for reason in node.vehicle.commander.arming_failures():
        node.send_text(dialect.MAV_SEVERITY_CRITICAL, f"Preflight Fail: {reason}")
    return ACCEPTED


def _calibrate(node: Node, port: Port, c: Command) -> int:
    """Calibrate the sensors whose params are set: 1 gyro, 2 compass, 5 accelerometer or level. All 0: cancel."""
    calibration = node.vehicle.calibration
    if node.vehicle.commander.armed:
        return REJECTED
    requested = {
        "gyro": c.number(1) == 1,
        "mag": c.number(2) == 1,
        "accel": c.number(5) in (1, 4),
        "level": c.number(5) == 2,
    }
    sensors = [name for name, wanted in requested.items() if wanted]
    if sensors:
        return ACCEPTED if calibration.start(sensors) else REJECTED
    if any(c.number(i) for i in range(1, 8)):
        return UNSUPPORTED
    calibration.cancel()
    return ACCEPTED


def _terminate(node: Node, port: Port, c: Command) -> int:
    return node.vehicle.commander.terminate() if c.number(1) == 1 else DENIED


def _mission_start(node: Node, port: Port, c: Command) -> int:
    commander = node.vehicle.commander
    if not commander.flight.plans.mission:
        return DENIED
    first = c.number(1)  # without a number the mission continues at its present item
    if first is not None and first >= 0 and not commander.fly_item(first):
        return DENIED
    result = commander.set_mode("MISSION")
    return result if result != ACCEPTED else commander.arm()


def _set_current_item(node: Node, port: Port, c: Command) -> int:
    number, commander = c.number(1), node.vehicle.commander
    if number == -1:
        number = commander.mission.current
    if number is None or not commander.fly_item(number):  # `fly_item` resets the jump counters
        return DENIED
    mission.say_current(node)
    return ACCEPTED


def _reboot(node: Node, port: Port, c: Command) -> int:
    if node.vehicle.commander.armed:
        return DENIED
    if c.number(1) in (1, 2, 3):
        node.reboot_requested = True  # the owner of the autopilot restarts it
    return ACCEPTED


def _inject_failure(node: Node, port: Port, c: Command) -> int:
    if not node.vehicle.parameters["SYS_FAILURE_EN"]:
        return DENIED
    unit, kind, instance = c.number(1), c.number(2), c.number(3) or 0
    if node.inject is None or unit is None or kind is None or not node.inject(unit, kind, instance):
        return UNSUPPORTED
    node.send_text(dialect.MAV_SEVERITY_WARNING, f"Failure injected: unit {unit}, type {kind}, instance {instance}")
    return ACCEPTED


def _configure_gimbal(node: Node, port: Port, c: Command) -> int:
    gimbal = node.vehicle.gimbal
    if gimbal is None or c.number(7) not in (0, DEVICE):
        return UNSUPPORTED
    return gimbal.configure(c.source, tuple(c.number(i) for i in range(1, 5)))


def _point_gimbal(node: Node, port: Port, c: Command) -> int:
    gimbal = node.vehicle.gimbal
    if gimbal is None or c.number(7) not in (None, 0, DEVICE):
        return UNSUPPORTED
    return gimbal.point(c.source, c.p[0], c.p[2], c.number(5) or 0)


HANDLERS: dict[int, CommandHandler] = {
    dialect.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE: _configure_gimbal,
    dialect.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW: _point_gimbal,
    dialect.MAV_CMD_NAV_RETURN_TO_LAUNCH: lambda node, port, c: node.vehicle.commander.set_mode("RETURN"),
    dialect.MAV_CMD_NAV_LAND: lambda node, port, c: node.vehicle.commander.set_mode("LAND"),
    dialect.MAV_CMD_NAV_TAKEOFF: _takeoff,
    dialect.MAV_CMD_DO_ORBIT: _orbit,
    dialect.MAV_CMD_DO_SET_MODE: _do_set_mode,
    dialect.MAV_CMD_DO_CHANGE_SPEED: _change_speed,
    dialect.MAV_CMD_DO_SET_HOME: _set_home,
    dialect.MAV_CMD_DO_FLIGHTTERMINATION: _terminate,
    dialect.MAV_CMD_DO_REPOSITION: _reposition,
    dialect.MAV_CMD_PREFLIGHT_CALIBRATION: _calibrate,
    dialect.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN: _reboot,
    dialect.MAV_CMD_MISSION_START: _mission_start,
    dialect.MAV_CMD_DO_SET_MISSION_CURRENT: _set_current_item,
    dialect.MAV_CMD_COMPONENT_ARM_DISARM: _arm_disarm,
    dialect.MAV_CMD_RUN_PREARM_CHECKS: _run_prearm_checks,
    dialect.MAV_CMD_GET_HOME_POSITION: lambda node, port, c: send_one(port, "HOME_POSITION"),
    dialect.MAV_CMD_INJECT_FAILURE: _inject_failure,
    dialect.MAV_CMD_SET_MESSAGE_INTERVAL: lambda node, port, c: set_message_interval(port, c.p),
    dialect.MAV_CMD_GET_MESSAGE_INTERVAL: lambda node, port, c: get_message_interval(port, c.p),
    dialect.MAV_CMD_REQUEST_MESSAGE: lambda node, port, c: request_message(port, c.p),
    dialect.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: lambda node, port, c: send_one(port, "AUTOPILOT_VERSION"),
    dialect.MAV_CMD_REQUEST_FLIGHT_INFORMATION: lambda node, port, c: send_one(port, "FLIGHT_INFORMATION"),
}
