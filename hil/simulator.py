"""PX4's simulator interface: HIL messages from our sensors, rotor commands from PX4's replies, and two kinds of link.

PX4 uses a group of HIL_SENSOR's fields only if all bits of the group are set in `fields_updated`. Specific forces are
in m/s², rates in rad/s, magnetic fields in gauss, pressures in hPa, vectors in FRD. HIL_GPS has 1e-7 degrees, altitude
in mm, speeds in cm/s and course in 0.01°. Source: PX4 SimulatorMavlink.cpp.

A PX4 in software connects over TCP (`SimulatorServer`). A board in hardware-in-the-loop mode uses one link for HIL and
other MAVLink messages (`BoardLine`). A board stamps messages with its own clock, so it cannot fly in lockstep.
It decodes HIL messages only in HIL mode (SYS_HITL), which its heartbeat shows. This module never sends
HIL_STATE_QUATERNION, because a board would use it as its estimate. Source: PX4 mavlink_receiver.cpp.
"""

import math
import select
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from foundation.atmosphere import pressure_altitude
from foundation.errors import UsageError
from foundation.mavlink import Packer, Parser, dialect
from foundation.sensors import MAX_ROTORS
from foundation.wire import Frames, clamped, int16, is_frame, message_id
from hil.link.transport import BAUD, BITS_PER_BYTE, Reopening, TcpListener, Transport

ACCEL, GYRO, MAG, BARO = 0x7, 0x38, 0x1C0, 0x1A00  # bits in HIL_SENSOR.fields_updated
ARMED = dialect.MAV_MODE_FLAG_SAFETY_ARMED
HIL_ENABLED = dialect.MAV_MODE_FLAG_HIL_ENABLED
SENSOR_BYTES = 74  # largest HIL_SENSOR frame; its last field, the sensor's id, is 0 and MAVLink 2 omits trailing zeros
COURSE_UNKNOWN = 65535
COURSE_FROM = 0.3  # m/s; below this speed a receiver reports no course over ground


@dataclass(frozen=True, slots=True)
class SampleTimes:
    """Times (µs, vehicle clock) of the newest samples that were sent to the autopilot; 0: none yet."""

    imu_us: int = 0
    mag_us: int = 0
    baro_us: int = 0
    gps_us: int = 0


def sensor_message(sensors: Any, time_us: int, sent: SampleTimes) -> dialect.MAVLink_hil_sensor_message:
    """Return HIL_SENSOR at `time_us` (µs, vehicle clock). `fields_updated` marks the groups newer than `sent`.

    `sensors` is a record of `foundation.sensors.SENSORS`. Without new samples the message still advances PX4's clock.
    """
    updated = 0
    if sensors["imu_time_us"] > sent.imu_us:
        updated |= ACCEL | GYRO
    if sensors["mag_time_us"] > sent.mag_us:
        updated |= MAG
    if sensors["baro_time_us"] > sent.baro_us:
        updated |= BARO
    pressure_hpa = float(sensors["pressure_hpa"])
    return dialect.MAVLink_hil_sensor_message(
        time_us,
        *sensors["accel_frd"].tolist(),
        *sensors["gyro_frd"].tolist(),
        *sensors["mag_frd"].tolist(),
        pressure_hpa,
        0.0,
        pressure_altitude(max(pressure_hpa, 0.0)),
        float(sensors["temperature_c"]),
        updated,
        0,
    )


def gps_message(sensors: Any) -> dialect.MAVLink_hil_gps_message:
    """Return HIL_GPS of the newest fix, with the time stamp (µs, vehicle clock) of the fix."""
    north, east, down = sensors["gps_velocity_ned"].tolist()
    speed = math.hypot(north, east)
    course = math.degrees(math.atan2(east, north)) % 360.0
    return dialect.MAVLink_hil_gps_message(
        int(sensors["gps_time_us"]),
        int(sensors["gps_fix_type"]),
        round(float(sensors["gps_lat_deg"]) * 1e7),
        round(float(sensors["gps_lon_deg"]) * 1e7),
        round(float(sensors["gps_alt_m"]) * 1e3),
        clamped(float(sensors["gps_eph_m"]) * 100, 0, 65534),
        clamped(float(sensors["gps_epv_m"]) * 100, 0, 65534),
        clamped(speed * 100, 0, 65534),
        *(int16(v * 100) for v in (north, east, down)),
        round(course * 100) % 36000 if speed >= COURSE_FROM else COURSE_UNKNOWN,
        int(sensors["gps_satellites"]),
        0,
        0,
    )


def sample_times(sensors: Any) -> SampleTimes:
    """Return the times of the newest samples of `sensors`."""
    return SampleTimes(
        int(sensors["imu_time_us"]),
        int(sensors["mag_time_us"]),
        int(sensors["baro_time_us"]),
        int(sensors["gps_time_us"]),
    )


def rotor_commands(controls: Sequence[float], rotors: int, idle: float) -> list[float]:
    """Return fractions of full rotor speed (MAX_ROTORS of them) for PX4's motor outputs 0 … 1.

    Output 0 gives the idle speed and 1 the full speed, linear in between, as in PX4's own Gazebo bridge (SIM_GZ_EC_MIN,
    SIM_GZ_EC_MAX). As with a real motor controller, thrust is then not linear in the output. THR_MDL_FAC stays 0,
    so PX4 does not correct this. `idle`: the idle speed as a fraction of the full speed. NaN gives the idle speed.
    """
    used = [idle + (1.0 - idle) * min(max(u, 0.0), 1.0) if u == u else idle for u in controls[:rotors]]
    return used + [0.0] * (MAX_ROTORS - len(used))


def is_armed(message: dialect.MAVLink_message) -> bool:
    """Return whether the autopilot that sent this HIL_ACTUATOR_CONTROLS or HEARTBEAT is armed."""
    mode = message.mode if message.get_msgId() == dialect.MAVLINK_MSG_ID_HIL_ACTUATOR_CONTROLS else message.base_mode
    return bool(mode & ARMED)


PORT = 4560  # TCP port for PX4's instance 0; instance n uses PORT + n


class SimulatorServer(TcpListener):
    """Listens for one PX4 at a time. A newer connection replaces the older one."""

    def __init__(self, port: int, host: str = "127.0.0.1", instead: str = "choose another port") -> None:
        """Listen. Port 0: the system chooses a free port.

        Raises UsageError if the port is in use. `instead` is the advice in this error.
        """
        super().__init__(f"tcpin://{host}:{port}", host, port, instead)
        self._parser = Parser()

    def accept(self) -> bool:
        accepted = super().accept()
        if accepted:
            self._parser = Parser()
        return accepted

    def messages(self, timeout_s: float) -> list[dialect.MAVLink_message]:
        """Wait up to `timeout_s` wall seconds for data. Return the messages in it; none if PX4 is silent or gone.

        A new connection waits until the caller calls `accept`, so that the caller notices it.
        """
        if self._client is None or not select.select([self._client], [], [], timeout_s)[0]:
            return []
        return self._parser.feed(self._read())


RATE_MAX_HZ, RATE_LEAST_HZ = 250, 200  # limits of HIL_SENSOR's rate; below 200 Hz, PX4's rate controller is too slow
# parts of the device names of boards on USB, where the baud rate has no effect
USB = ("ttyACM", "usbmodem", "/by-id/usb-")
ADAPTER = "-port"  # part of the /by-id/ name of an adapter from USB to a serial line, where the baud rate counts
SHARE = 0.5  # share of the link for HIL_SENSOR; other MAVLink traffic needs the rest
HEARTBEAT_S = 1.0  # wall seconds between two heartbeats to the board
FORGET_S = 3.0  # wall seconds without a heartbeat after which the board counts as gone, as in MAVSDK
ACTUATORS, HEARTBEAT = dialect.MAVLINK_MSG_ID_HIL_ACTUATOR_CONTROLS, dialect.MAVLINK_MSG_ID_HEARTBEAT
HELLO = dialect.MAVLink_heartbeat_message(
    dialect.MAV_TYPE_GENERIC, dialect.MAV_AUTOPILOT_INVALID, 0, 0, dialect.MAV_STATE_ACTIVE, 3
)


def sensor_period_us(url: str) -> int:
    """Return the period (µs) of HIL_SENSOR on a link: 4 ms, or 5 ms on a slow serial line.

    Raises UsageError for a serial line that is too slow.
    """
    scheme, _, line = url.partition("://")
    given = line.rpartition(":")[2]
    if scheme != "serial" or (any(name in line for name in USB) and ADAPTER not in line):
        return 1_000_000 // RATE_MAX_HZ
    baud = int(given) if given.isdigit() else BAUD
    carried_hz = SHARE * baud / BITS_PER_BYTE / SENSOR_BYTES
    if carried_hz < RATE_LEAST_HZ:
        raise UsageError(
            f"--hitl {url}: {baud} baud carry {carried_hz:.0f} sensor messages a second beside the other traffic,"
            f" but flying needs {RATE_LEAST_HZ}. Use USB, or 460800 baud or more on both ends"
        )
    return -(-1_000 // min(RATE_MAX_HZ, int(carried_hz))) * 1_000


class BoardLine:
    """One board on a cable, which may be unplugged and plugged in again.

    Clients (the agent, a ground station) share the cable: `give` sends their bytes, `take` returns bytes for them.
    """

    def __init__(self, connect: Callable[[], Transport], packer: Packer) -> None:
        """`connect` opens the link, now and after it breaks. Only errors of the first call are raised."""
        self._packer = packer
        self._transport = Reopening(connect)
        self._openings = 0  # reopenings of the link that `exchange` has noticed
        self._parser = Parser()
        self._frames = Frames()
        self._clients = bytearray()  # bytes from the board for the clients, until the next `take`
        self._hello_due_s = 0.0
        self._alive_s = -FORGET_S  # wall time of the autopilot's last heartbeat
        self._hil = False
        self.actuators: dialect.MAVLink_message | None = None  # the newest HIL_ACTUATOR_CONTROLS
        self.actuators_s = 0.0  # wall time at which `actuators` arrived

    @property
    def present(self) -> bool:
        """Whether the autopilot sends heartbeats."""
        return self._transport.connected and time.monotonic() - self._alive_s < FORGET_S

    @property
    def in_hil(self) -> bool:
        """Whether the board accepts simulated sensors: its last heartbeat shows HIL mode."""
        return self.present and self._hil

    def exchange(self) -> None:
        """Read the link, send the heartbeat when it is due, and reopen a broken link."""
        now_s = time.monotonic()  # the board runs on wall time
        data = self._transport.receive(0.0)
        if self._transport.reopened > self._openings:
            self._openings, self._frames, self._hil = self._transport.reopened, Frames(), False
        if now_s >= self._hello_due_s:
            self._hello_due_s = now_s + HEARTBEAT_S
            self.send(HELLO)
        for unit in self._frames.feed(data):
            if is_frame(unit):  # else noise, or output of a boot loader
                self._take(unit, now_s)

    def send(self, *messages: dialect.MAVLink_message) -> None:
        """Send messages from the simulator."""
        self.give(b"".join(self._packer.pack(message) for message in messages))

    def give(self, data: bytes) -> None:
        """Send a client's bytes unchanged."""
        if data:
            self._transport.send(data)

    def take(self) -> bytes:
        """Return the board's bytes for the clients since the last call: all except the motor outputs."""
        data = bytes(self._clients)
        self._clients.clear()
        return data

    def close(self) -> None:
        self._transport.close()

    def _take(self, frame: bytes, now_s: float) -> None:
        kind = message_id(frame)
        if kind != ACTUATORS:
            self._clients += frame
        for message in self._parser.feed(frame) if kind in (ACTUATORS, HEARTBEAT) else ():
            if kind == ACTUATORS:
                self.actuators, self.actuators_s = message, now_s
            elif message.get_srcComponent() == dialect.MAV_COMP_ID_AUTOPILOT1:
                self._alive_s, self._hil = now_s, bool(message.base_mode & HIL_ENABLED)
