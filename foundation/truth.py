"""The truth as it travels: HIL_STATE_QUATERNION from the simulator, CAMERA_IMAGE_CAPTURED from its camera.

The agent and the autopilot may not import this.
"""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass

from foundation.frames import Quat, Vec3, geodetic_to_ned, ned_to_geodetic, quat_normalized
from foundation.mavlink import Parser, dialect

TRUTH_COMPONENT = 51  # MAV_COMP_ID_USER27: a simulator has no id of its own, and 1 would pass for the autopilot
Origin = tuple[float, float, float]  # lat °, lon °, alt m of the map's NED frame
KEPT = 25  # samples of each drone: half a second at 50 Hz
SILENT_US = 100_000  # µs; a drone that is not heard for longer is not waited for


@dataclass(frozen=True, slots=True)
class TruthSample:
    """Where a vehicle really is."""

    drone: int
    time_us: int  # µs, vehicle clock
    position_ned: Vec3  # m, map frame
    velocity_ned: Vec3  # m/s
    attitude: Quat  # FRD → NED


@dataclass(frozen=True, slots=True)
class FrameTaken:
    """A frame was rendered from the truth sample of `time_us`."""

    drone: int
    frame_id: int
    time_us: int  # µs, whole milliseconds


def truth_message(
    time_us: int, position: Vec3, velocity: Vec3, attitude: Quat, rates: Vec3, accel: Vec3, origin: Origin
) -> dialect.MAVLink_message:
    """Return HIL_STATE_QUATERNION. Places are carried in 1e-7 degrees: 1.1 cm."""
    lat, lon, alt = ned_to_geodetic(*origin, *position)
    return dialect.MAVLink_hil_state_quaternion_message(
        time_us,
        list(attitude),
        *rates,
        round(lat * 1e7),
        round(lon * 1e7),
        round(alt * 1e3),
        *(_int16(v * 100) for v in velocity),
        0,
        0,
        *(_int16(a / 9.80665 * 1000) for a in accel),
    )


def truth_sample(message: dialect.MAVLink_message, origin: Origin) -> TruthSample:
    """Return what a HIL_STATE_QUATERNION says; the drone's number is its system id less one."""
    return TruthSample(
        drone=message.get_srcSystem() - 1,
        time_us=message.time_usec,
        position_ned=geodetic_to_ned(*origin, message.lat / 1e7, message.lon / 1e7, message.alt / 1e3),
        velocity_ned=(message.vx / 100, message.vy / 100, message.vz / 100),
        attitude=quat_normalized(tuple(message.attitude_quaternion)),
    )


def nearest(samples: Iterable[TruthSample], time_us: int) -> TruthSample:
    """Return the sample of the time nearest to `time_us`. Raises ValueError when there is none."""
    return min(samples, key=lambda sample: abs(sample.time_us - time_us))


class NewestTruth:
    """Follows the truth bus and knows where each drone was last."""

    def __init__(self, origin: Origin) -> None:
        self._origin = origin
        self._parser = Parser()
        self._heard: dict[int, deque[TruthSample]] = {}

    def feed(self, data: bytes) -> None:
        """Take bytes of the bus."""
        for message in self._parser.feed(data):
            if message.get_msgId() == dialect.MAVLINK_MSG_ID_HIL_STATE_QUATERNION:
                sample = truth_sample(message, self._origin)
                self._heard.setdefault(sample.drone, deque(maxlen=KEPT)).append(sample)

    def of(self, drone: int) -> TruthSample | None:
        """Return the newest sample of a drone, None while it has not been heard."""
        heard = self._heard.get(drone)
        return heard[-1] if heard else None

    def together(self, drone: int) -> tuple[TruthSample, dict[int, TruthSample]] | None:
        """Return the newest sample of a drone at a time that all have reached, and the others' of that time, by number.

        Whoever is silent for SILENT_US is not waited for and stays where it was heard last. None while the drone itself
        has not been heard.
        """
        own = self._heard.get(drone)
        if not own:
            return None
        reached = min(heard[-1].time_us for heard in self._heard.values())
        sample = next((s for s in reversed(own) if s.time_us <= reached), own[-1])
        if own[-1].time_us - sample.time_us > SILENT_US:
            sample = own[-1]
        others = {k: nearest(heard, sample.time_us) for k, heard in self._heard.items() if k != drone}
        return sample, others


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
    """Return what a CAMERA_IMAGE_CAPTURED says."""
    return FrameTaken(message.camera_id, message.image_index, message.time_boot_ms * 1000)


def _int16(value: float) -> int:
    return max(-32768, min(32767, round(value)))
