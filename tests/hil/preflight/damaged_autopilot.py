"""A fake PX4 with configurable faults. It speaks MAVLink but simulates no flight."""

import struct
import threading
import time

from foundation.mavlink import MODES, Packer, Parser, dialect
from hil.link.transport import connect

HEALTHY = 0x1 | 0x2 | 0x4 | 0x8 | 0x20 | 0x200000 | 0x2000000 | 0x10000000
STICKS, PREARM = 0x10000, 0x10000000
PACE = 4.0  # s of vehicle time per second, to shorten the waits of the link
PARAMETERS = {
    "COM_OBL_RC_ACT": 0, "COM_OF_LOSS_T": 1.0, "COM_RCL_EXCEPT": 0, "NAV_RCL_ACT": 2, "NAV_DLL_ACT": 0,
    "COM_LOW_BAT_ACT": 3, "COM_RC_OVERRIDE": 1, "COM_POS_FS_EPH": 5.0, "MPC_XY_VEL_MAX": 12.0,
    "MPC_Z_VEL_MAX_UP": 3.0, "MPC_Z_VEL_MAX_DN": 1.5, "SYS_HITL": 0, "COM_RC_IN_MODE": 3, "GF_ACTION": 2,
    "GF_MAX_HOR_DIST": 100.0, "GF_MAX_VER_DIST": 100.0, "RTL_RETURN_ALT": 30.0, "BAT1_N_CELLS": 4, "COM_FLTMODE1": -1,
}  # fmt: skip


class Autopilot(threading.Thread):
    """Answers on UDP. Its clock runs `PACE` times as fast as the wall clock. The keywords set its faults."""

    def __init__(
        self, url, *,
        health=HEALTHY, fix=3, home=True, refuses=(), deaf_to=(), armed=False, parameters=None,
        withholds=(), tells_unknown=True, keeps=(), loses=lambda number: False, texts=(),
        version=1 << 24 | 15 << 16 | 255,
    ):  # fmt: skip
        """`refuses`: mode names. `deaf_to`: message types. `keeps`: parameters that ignore changes.

        `withholds`: messages sent only on request. `tells_unknown`: an unknown parameter gets PARAM_ERROR, not silence.
        `loses(n)`: returns whether the n-th datagram from the client is lost.
        """
        super().__init__(daemon=True)
        self.health, self.fix, self.home, self.refuses, self.deaf_to = health, fix, home, refuses, deaf_to
        self.armed, self.tells_unknown, self.keeps, self.loses = armed, tells_unknown, keeps, loses
        self.texts, self.version, self.withholds = texts, version, withholds
        self.parameters = dict(PARAMETERS if parameters is None else parameters)
        self.mode, self.received, self.modes_asked, self.commands = "HOLD", 0, [], []
        self.message_types: list[str] = []  # the type of every received message
        self._transport, self._packer, self._parser = connect(url), Packer(1, 1), Parser()
        self._running, self._ms, self._setpoint_ms = True, 1000, -10_000

    def stop(self):
        self._running = False
        self.join()
        self._transport.close()

    def run(self):
        due_s = time.monotonic()
        while self._running:
            self._stream()
            self._ms += 20
            due_s += 0.02 / PACE
            while (left := due_s - time.monotonic()) > 0:
                data = self._transport.receive(left)
                self.received += bool(data)
                if data and not self.loses(self.received):
                    for message in self._parser.feed(data):
                        self._take(message)

    def _send(self, message):
        self._transport.send(self._packer.pack(message))

    def _stream(self):
        self._send(dialect.MAVLink_local_position_ned_message(self._ms, 0, 0, 0, 0, 0, 0))
        self._send(dialect.MAVLink_attitude_message(self._ms, 0, 0, 0, 0, 0, 0))
        if self._ms % 200 == 0:
            self._send(dialect.MAVLink_heartbeat_message(2, 12, 128 * self.armed, MODES[self.mode].custom_mode, 3, 3))
            if "SYS_STATUS" not in self.withholds:
                self._condition()
            self._send(dialect.MAVLink_estimator_status_message(
                self._ms * 1000, 0x3F if self.fix >= 3 else 0x25, 0.1, 0.1, 0.1, 0.1, 0, 0, 0.5, 0.5
            ))  # fmt: skip
            self._send(dialect.MAVLink_gps_raw_int_message(
                self._ms * 1000, self.fix, 0, 0, 0, 80, 100, 0, 0, 14 if self.fix >= 3 else 3, 0, 900, 1200
            ))  # fmt: skip
            self._send(dialect.MAVLink_global_position_int_message(self._ms, 0, 0, 0, 0, 0, 0, 0, 0))
            self._send(dialect.MAVLink_battery_status_message(0, 0, 1, 32767, [4000] * 4 + [65535] * 6, -1, 0, -1, 90))
            self._send(dialect.MAVLink_system_time_message(0, self._ms))

    def _condition(self):
        present = self.health & ~PREARM
        self._send(
            dialect.MAVLink_sys_status_message(present, present, self._healthy(), 0, 16000, -1, 90, 0, 0, 0, 0, 0, 0)
        )

    def _healthy(self):
        """Return the health bits. Like PX4, it can arm in OFFBOARD only while setpoints arrive."""
        alive = self.mode != "OFFBOARD" or self._ms - self._setpoint_ms < 1000
        return self.health if alive else self.health & ~PREARM

    def _take(self, message):
        kind = message.get_type()
        self.message_types.append(kind)
        if kind in self.deaf_to:
            return
        match kind:
            case "COMMAND_LONG":
                self._command(message)
            case "SET_POSITION_TARGET_LOCAL_NED":
                self._setpoint_ms = self._ms
            case "TIMESYNC" if message.tc1 == 0:
                self._send(dialect.MAVLink_timesync_message(self._ms * 1_000_000, message.ts1))
            case "PARAM_REQUEST_READ":
                self._tell(message.param_id)
            case "PARAM_SET":
                self._set(message)
            case "MISSION_REQUEST_LIST":
                self._send(dialect.MAVLink_mission_count_message(245, 191, 0, message.mission_type))

    def _command(self, message):
        result = 0
        self.commands.append(message.command)
        if message.command == dialect.MAV_CMD_REQUEST_MESSAGE:
            self._once(int(message.param1))
        elif message.command == dialect.MAV_CMD_RUN_PREARM_CHECKS:
            for text in self.texts:
                self._send(dialect.MAVLink_statustext_message(3, text.encode()))
        elif message.command == dialect.MAV_CMD_DO_SET_MODE:
            name = next(m.name for m in MODES.values() if (m.main, m.sub) == (message.param2, message.param3))
            self.modes_asked.append(name)
            if name in self.refuses:
                result = 1
            else:
                self.mode = name
        self._send(dialect.MAVLink_command_ack_message(message.command, result, 0, 0, 245, 191))

    def _once(self, message_id):
        if message_id == dialect.MAVLINK_MSG_ID_HOME_POSITION and self.home:
            self._send(dialect.MAVLink_home_position_message(0, 0, 0, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0))
        if message_id == dialect.MAVLINK_MSG_ID_SYS_STATUS:
            self._condition()
        if message_id == dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION:
            self._send(dialect.MAVLink_autopilot_version_message(
                0, self.version, 0, 0, 0, [0] * 8, [0] * 8, [0] * 8, 0, 0, 0
            ))  # fmt: skip

    def _tell(self, name):
        if name in self.parameters:
            value = self.parameters[name]
            integer = isinstance(value, int)
            field = struct.unpack("<f", struct.pack("<i", value))[0] if integer else value
            self._send(dialect.MAVLink_param_value_message(name.encode(), field, 6 if integer else 9, 900, 1))
        elif self.tells_unknown:
            self._send(dialect.MAVLink_param_error_message(245, 191, name.encode(), -1, 1))

    def _set(self, message):
        name, old = message.param_id, self.parameters.get(message.param_id)
        if old is not None and name not in self.keeps:
            bits = struct.pack("<f", message.param_value)
            self.parameters[name] = struct.unpack("<i" if isinstance(old, int) else "<f", bits)[0]
        self._tell(name)
