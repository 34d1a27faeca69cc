"""A minimal vehicle behind an in-memory transport. It obeys commands and sends the messages that a test adds."""

from foundation.mavlink import MODES, Packer, Parser, dialect
from foundation.setpoints import Velocity
from hil.link.link import Link
from hil.link.transport import MemoryTransport

STEP_MS = 20


class ScriptedVehicle:
    """Follows setpoints without lag. Sends 50 Hz telemetry and 1 Hz heartbeats; each wait advances its clock."""

    def __init__(self, *, autopilot=12):
        self.packer, self.parser = Packer(1, 1), Parser()
        self.autopilot = autopilot
        self.time_ms = 1000
        self.position, self.velocity, self.yaw = [0.0, 0.0, -2.5], (0.0, 0.0, 0.0), 0.0
        self.lean = (0.0, 0.0)  # rad, roll and pitch
        self.mode, self.armed, self.landed = "HOLD", True, False
        self.battery, self.system_status = 90, 4
        self.obeys = True
        self.silent = set()  # message ids that are not sent
        self.refuses = {}  # command -> (result, text)
        self.setpoints, self.commands = [], []
        self.out = b""

    def transport(self):
        return MemoryTransport("memory://", self.take, self.give, self.step, lambda: self.time_ms / 1000)

    def take(self):
        data, self.out = self.out, b""
        return data

    def say(self, message):
        if message.get_msgId() not in self.silent:
            self.out += self.packer.pack(message)

    def give(self, data):
        for message in self.parser.feed(data):
            kind = message.get_type()
            if kind == "COMMAND_LONG":
                self.command(message)
            elif kind == "SET_POSITION_TARGET_LOCAL_NED":
                self.setpoints.append((self.time_ms, message))

    def command(self, message):
        self.commands.append((message.command, message.param1, message.param2, message.param3))
        result, text = self.refuses.get(message.command, (0, ""))
        if message.command == 176 and not result:
            self.mode = next(m.name for m in MODES.values() if (m.main, m.sub) == (message.param2, message.param3))
            self.say(self.heartbeat())
        self.say(dialect.MAVLink_command_ack_message(message.command, result, 0, 0, 245, 191))
        if text:
            self.say(dialect.MAVLink_statustext_message(2, text.encode()))

    def heartbeat(self):
        base = 1 | (128 if self.armed else 0)
        mode = MODES[self.mode].custom_mode
        return dialect.MAVLink_heartbeat_message(2, self.autopilot, base, mode, self.system_status, 3)

    def step(self):
        self.time_ms += STEP_MS
        if self.obeys and self.setpoints and self.mode == "OFFBOARD":
            self.follow(self.setpoints[-1][1])
        self.say(dialect.MAVLink_local_position_ned_message(self.time_ms, *self.position, *self.velocity))
        self.say(dialect.MAVLink_attitude_message(self.time_ms, *self.lean, self.yaw, 0, 0, 0))
        if self.time_ms % 1000 == 0:
            self.say(self.heartbeat())
            self.say(dialect.MAVLink_extended_sys_state_message(0, 1 if self.landed else 2))
            self.say(dialect.MAVLink_sys_status_message(*(0x1000002F,) * 3, 100, 16000, 100, self.battery, *(0,) * 6))
            self.say(dialect.MAVLink_home_position_message(0, 0, 0, 0.0, 0.0, 0.0, [1, 0, 0, 0], 0, 0, 0))

    def follow(self, setpoint):
        dt = STEP_MS / 1000
        if setpoint.coordinate_frame == 8:  # heading 0: body axes are north, east, down
            self.velocity = (setpoint.vx, setpoint.vy, setpoint.vz)
        else:
            wanted = (setpoint.x, setpoint.y, setpoint.z)
            self.velocity = tuple(max(-2.0, min(2.0, w - p)) for w, p in zip(wanted, self.position, strict=True))
        self.position = [p + v * dt for p, v in zip(self.position, self.velocity, strict=True)]


def flying(vehicle, **options):
    """Return a link that has flown the vehicle forward for 1 s."""
    link = Link(vehicle.transport(), **options)
    link.connect(10.0)
    link.fly(Velocity(1.2, None), 60.0)
    link.start_offboard()
    link.wait(1.0)
    return link
