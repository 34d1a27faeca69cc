"""Messages of the truth bus, and a reader that keeps each vehicle's newest samples.

The truth bus carries the true states of the simulated vehicles as MAVLink messages. The simulator sends
HIL_STATE_QUATERNION, GIMBAL_DEVICE_ATTITUDE_STATUS and STATUSTEXT (about contacts). The camera sends
CAMERA_IMAGE_CAPTURED. The agent and the autopilot must not know the truth, so they must not import this module.
"""

import re
import threading
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar

from foundation import wire
from foundation.frames import GRAVITY, Quat, Vec3, geodetic_to_ned, ned_to_geodetic, quat_normalized, quat_to_euler
from foundation.mavlink import Parser, dialect

TRUTH_COMPONENT = 51  # MAV_COMP_ID_USER27: MAVLink has no id for a simulator, and 1 is the autopilot's
Origin = tuple[float, float, float]  # lat °, lon °, alt m of the map's NED frame
KEPT = 25  # samples that are kept for each drone: half a second at 50 Hz
UNREAD = 1000  # number of stored packets above which `feed` decodes them without a query: 20 s at 50 Hz
SILENT_US = 100_000  # µs; `together` does not wait for a drone that is silent for longer


@dataclass(frozen=True, slots=True)
class TruthSample:
    """The true state of a vehicle."""

    drone: int
    time_us: int  # µs, vehicle clock
    position_ned: Vec3  # m, map frame
    velocity_ned: Vec3  # m/s
    attitude: Quat  # FRD → NED
    gimbal_pitch: float | None = None  # rad, pitch of the camera's gimbal up from the horizon; None: no gimbal


@dataclass(frozen=True, slots=True)
class FrameTaken:
    """A frame was rendered from the truth sample of `time_us`."""

    drone: int
    frame_id: int
    time_us: int  # µs, vehicle clock, in whole milliseconds


def truth_message(
    time_us: int, position: Vec3, velocity: Vec3, attitude: Quat, rates: Vec3, accel: Vec3, origin: Origin
) -> dialect.MAVLink_message:
    """Return HIL_STATE_QUATERNION. Positions have a resolution of 1e-7 degrees (1.1 cm)."""
    lat, lon, alt = ned_to_geodetic(*origin, *position)
    return dialect.MAVLink_hil_state_quaternion_message(
        time_us,
        list(attitude),
        *rates,
        round(lat * 1e7),
        round(lon * 1e7),
        round(alt * 1e3),
        *(wire.int16(v * 100) for v in velocity),
        0,
        0,
        *(wire.int16(a / GRAVITY * 1000) for a in accel),
    )


def gimbal_message(time_us: int, camera: Quat) -> dialect.MAVLink_message:
    """Return GIMBAL_DEVICE_ATTITUDE_STATUS: the attitude of a camera on a gimbal (camera axes → NED)."""
    flags = dialect.GIMBAL_DEVICE_FLAGS_YAW_IN_EARTH_FRAME
    return dialect.MAVLink_gimbal_device_attitude_status_message(
        0, 0, time_us // 1000 % (1 << 32), flags, list(camera), 0.0, 0.0, 0.0, 0
    )


def gimbal_pitch(message: dialect.MAVLink_message) -> float:
    """Return the pitch (rad, up from the horizon) in a GIMBAL_DEVICE_ATTITUDE_STATUS."""
    return quat_to_euler(quat_normalized(tuple(message.q)))[1]


def truth_sample(message: dialect.MAVLink_message, origin: Origin, gimbal_pitch: float | None = None) -> TruthSample:
    """Return the sample in a HIL_STATE_QUATERNION; the drone's number is the system id minus one.

    `gimbal_pitch` (rad): from the GIMBAL_DEVICE_ATTITUDE_STATUS of the same time, which is sent before the sample.
    """
    return TruthSample(
        drone=message.get_srcSystem() - 1,
        time_us=message.time_usec,
        position_ned=geodetic_to_ned(*origin, message.lat / 1e7, message.lon / 1e7, message.alt / 1e3),
        velocity_ned=(message.vx / 100, message.vy / 100, message.vz / 100),
        attitude=quat_normalized(tuple(message.attitude_quaternion)),
        gimbal_pitch=gimbal_pitch,
    )


class Timed(Protocol):
    """A value with a time of the vehicle clock."""

    @property
    def time_us(self) -> int: ...


T = TypeVar("T", bound=Timed)


def nearest(samples: Sequence[T] | deque[T], time_us: int) -> T:
    """Return the sample nearest to `time_us`; the earlier one if two are equally near.

    The samples must be sorted by time. Raises ValueError if there are none.
    """
    best: T | None = None
    for sample in reversed(samples):
        if best is not None and abs(sample.time_us - time_us) > abs(best.time_us - time_us):
            break
        best = sample
    if best is None:
        raise ValueError("there is no sample")
    return best


class NewestTruth:
    """Follows the truth bus and keeps the newest samples of each drone.

    Bytes arrive fifty times a second and queries are rare. So bytes are stored until a query, which decodes only the
    newest samples of each drone.
    """

    def __init__(self, origin: Origin, kept: int = KEPT) -> None:
        """`kept`: number of samples to keep of each drone."""
        self._origin, self._kept = origin, kept
        self._parser = Parser()
        self._unread: deque[bytes] = deque()
        self._lock = threading.RLock()  # `feed` and the queries may be on different threads
        self._samples: dict[int, deque[TruthSample]] = {}

    def feed(self, data: bytes) -> None:
        """Store bytes from the bus."""
        self._unread.append(data)  # without the lock, so that the feeder does not wait
        if len(self._unread) > UNREAD:
            self._read()

    def _read(self) -> None:
        """Decode the newest samples of each drone in the unread bytes."""
        with self._lock:
            fed = b"".join(self._unread.popleft() for _ in range(len(self._unread)))
            newest = wire.newest(fed, dialect.MAVLINK_MSG_ID_HIL_STATE_QUATERNION, self._kept)
            pitches = self._pitches(fed)
            for message in self._parser.feed(newest):
                if message.get_msgId() == dialect.MAVLINK_MSG_ID_HIL_STATE_QUATERNION:
                    key = message.get_srcSystem(), message.time_usec // 1000 % (1 << 32)
                    sample = truth_sample(message, self._origin, pitches.get(key))
                    self._samples.setdefault(sample.drone, deque(maxlen=self._kept)).append(sample)

    def _pitches(self, fed: bytes) -> dict[tuple[int, int], float]:
        """Return the pitch (rad) of each gimbal by its vehicle's system id and time (ms)."""
        newest = wire.newest(fed, dialect.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS, self._kept)
        return {
            (message.get_srcSystem(), message.time_boot_ms): gimbal_pitch(message)
            for message in self._parser.feed(newest)
        }

    def of(self, drone: int) -> TruthSample | None:
        """Return the newest sample of a drone; None without one."""
        with self._lock:
            self._read()
            samples = self._samples.get(drone)
            return samples[-1] if samples else None

    def together(self, drone: int) -> tuple[TruthSample, dict[int, TruthSample]] | None:
        """Return samples of all drones at nearly the same time: the sample of `drone`, and the others' by drone number.

        The time is the latest that all drones have reached. If a drone has been silent for longer than SILENT_US, the
        newest sample of `drone` sets the time. Returns None without a sample of `drone`.
        """
        with self._lock:
            self._read()
            own = self._samples.get(drone)
            if not own:
                return None
            reached = min(samples[-1].time_us for samples in self._samples.values())
            sample = next((s for s in reversed(own) if s.time_us <= reached), own[-1])
            return self._with_others(sample if own[-1].time_us - sample.time_us <= SILENT_US else own[-1])

    def at(self, drone: int, time_us: int) -> tuple[TruthSample, dict[int, TruthSample]] | None:
        """Return a drone's first sample at or after a time (µs), and the nearest samples of the others by drone number.

        If all samples of the drone are earlier, its newest sample is used. Returns None without a sample of `drone`.
        """
        with self._lock:
            self._read()
            own = self._samples.get(drone)
            if not own:
                return None
            return self._with_others(next((s for s in own if s.time_us >= time_us), own[-1]))

    def _with_others(self, sample: TruthSample) -> tuple[TruthSample, dict[int, TruthSample]]:
        tracks = {k: samples for k, samples in self._samples.items() if k != sample.drone}
        return sample, {k: nearest(samples, sample.time_us) for k, samples in tracks.items()}

    def before(self, sample: TruthSample) -> TruthSample:
        """Return the previous sample of the drone of `sample`; `sample` itself if the previous one is not kept."""
        with self._lock:
            self._read()
            own = self._samples.get(sample.drone, ())
            return next((s for s in reversed(own) if s.time_us < sample.time_us), sample)


def frame_message(taken: FrameTaken, sample: TruthSample, origin: Origin) -> dialect.MAVLink_message:
    """Return CAMERA_IMAGE_CAPTURED for a frame taken at a truth sample."""
    lat, lon, alt = ned_to_geodetic(*origin, *sample.position_ned)
    return dialect.MAVLink_camera_image_captured_message(
        taken.time_us // 1000 % (1 << 32),
        0,
        taken.drone,
        round(lat * 1e7),
        round(lon * 1e7),
        round(alt * 1e3),
        round(-sample.position_ned[2] * 1e3),
        list(sample.attitude),
        taken.frame_id,
        1,
        b"",
    )


def frame_taken(message: dialect.MAVLink_message) -> FrameTaken:
    """Return the content of a CAMERA_IMAGE_CAPTURED."""
    return FrameTaken(message.camera_id, message.image_index, message.time_boot_ms * 1000)


@dataclass(frozen=True, slots=True)
class HitReport:
    """The beginning of a contact, as a STATUSTEXT reports it."""

    what: str  # name of the obstacle
    closing_speed: float | None  # m/s; None: contact with the ground
    crash: bool  # hard enough to break something


HIT = re.compile(r"(Collision|Crash): hit (.+?)(?: at ([\d.]+) m/s)?")
CLEAR = re.compile(r"Collision: clear after ([\d.]+) s")


def hit_text(hit: HitReport) -> str:
    """Return the text of a hit, at most 50 bytes of UTF-8, the limit of a STATUSTEXT."""
    speed = "" if hit.closing_speed is None else f" at {hit.closing_speed:.1f} m/s"
    begin = f"{'Crash' if hit.crash else 'Collision'}: hit "
    name = hit.what.encode()[: 50 - len(begin) - len(speed)].decode(errors="ignore")
    return begin + name + speed


def clear_text(seconds: float) -> str:
    """Return the text about the end of a contact that lasted `seconds`."""
    return f"Collision: clear after {seconds:.2f} s"


def hit_of(text: str) -> HitReport | None:
    """Return the hit in a text; None for another text."""
    match = HIT.fullmatch(text)
    return match and HitReport(match[2], float(match[3]) if match[3] else None, match[1] == "Crash")


def seconds_of(text: str) -> float | None:
    """Return the duration (s) of a contact from the text about its end; None for another text."""
    match = CLEAR.fullmatch(text)
    return float(match[1]) if match else None
