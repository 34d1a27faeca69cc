"""Writes truth.jsonl and flight.tlog. Formats: docs/run-folder.md.

The true poses come from the truth bus. For a flight that is not scored, the autopilot's estimate replaces them.
"""

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from msgspec import UNSET, UnsetType

from dronecats.flight.logger.estimator_resets import ResetWatch
from dronecats.flight.processes.child import Part
from foundation.camera import CameraModel
from foundation.frames import quat_yaw
from foundation.mavlink import Parser, dialect, frame_of
from foundation.measurement import TargetMeasurement
from foundation.protocol import POSE_PERIOD_S
from foundation.run_folder import layout
from foundation.run_folder.rows import Begin, Clear, End, FrameTruth, Hit, Pose, Reset
from foundation.run_folder.writing import LineLog, TelemetryLog
from foundation.truth import (
    SILENT_US,
    Origin,
    TruthSample,
    frame_taken,
    gimbal_pitch,
    hit_of,
    nearest,
    seconds_of,
    truth_sample,
)
from hil.link.telemetry import VehicleClock
from hil.link.transport import UdpTransport

# Measures the target: (t in s, truth of a drone, its camera, truth of the other drones at that time) → measurement
Measure = Callable[[float, TruthSample, CameraModel, Sequence[TruthSample]], TargetMeasurement]
COPIED = "udpin://127.0.0.1:0"  # URL of a logger's own port, which the operating system chooses
KEPT = 1000  # truth samples kept per drone, for late frames: 20 s at 50 Hz


@dataclass(frozen=True, slots=True, kw_only=True)
class LoggerConfig:
    episode: str  # id of an episode, or path of its record file
    folder: str  # folder for the episode's logs
    truth: str  # URL of the truth bus
    telemetry: tuple[str, ...]  # URL of each drone's autopilot, or COPIED: the stage copies the drone's messages
    airframe: str | None = None


class LazySample:
    """A truth sample that is decoded on demand, because the recorder writes only one pose per 25 samples."""

    def __init__(self, message: dialect.MAVLink_message, origin: Origin, pitch: float | None) -> None:
        """`pitch`: pitch (rad) of the camera's gimbal at this time; None without a gimbal."""
        self.drone, self.time_us = message.get_srcSystem() - 1, int(message.time_usec)
        self._message, self._origin, self._pitch = message, origin, pitch

    @cached_property
    def sample(self) -> TruthSample:
        return truth_sample(self._message, self._origin, self._pitch)


class EpisodeRecorder:
    """Writes truth.jsonl and flight.tlog of one episode. Before `begin` and after `end`, it writes only the tlog."""

    def __init__(self, folder: Path) -> None:
        self._rows, self._tlog = LineLog(folder / layout.TRUTH), TelemetryLog(folder / layout.TLOG)
        self._t0_us: int | None = None  # None: outside the episode
        self._time_us = 0  # newest vehicle time

    def begin(self, t0_us: int, cap_s: float | None = None) -> None:
        """Start the episode at vehicle time `t0_us` (µs), the episode's time zero. It lasts `cap_s` seconds at most."""
        raise NotImplementedError

    def end(self, reason: str, error: str | None = None) -> None:
        """Write the end of the episode, once. `reason` is a reason of `foundation.run_folder.rows.End`."""
        if self._t0_us is not None:
            self._rows.write(End(t=self._t(self._time_us), reason=reason, error=error))
            self._t0_us = None

    def close(self) -> None:
        self._rows.close()
        self._tlog.close()

    def _write_reset(self, reset: Reset | None, drone: int) -> None:
        if reset is not None and self._t0_us is not None:
            self._rows.write(replace(reset, t=self._t(self._time_us), drone=drone))

    def _t(self, time_us: int) -> float:
        """Return the time (s) of the episode at a vehicle time."""
        return round((time_us - (self._t0_us or 0)) / 1e6, 6)


class LoggerPart(Part):
    """The `Part` that runs a recorder in a child process. Subclasses read the telemetry sockets in `turn`."""

    _recorder: EpisodeRecorder

    def do(self, command: str, arguments: dict[str, Any]) -> Any:
        if command == "begin":
            self._recorder.begin(arguments["t0_us"], arguments["cap_s"])
        elif command == "end":
            self.turn()
            self._recorder.end(arguments["reason"], arguments.get("error"))
        return None

    def close(self) -> None:
        self._recorder.close()


class Recorder(EpisodeRecorder):
    """Writes the logs of a flight whose true poses arrive on the truth bus."""

    def __init__(self, folder: Path, origin: Origin, measure: Measure, camera: CameraModel) -> None:
        super().__init__(folder)
        self._origin, self._measure, self._camera = origin, measure, camera
        self._truth_parser = Parser()
        self._telemetry: dict[int, tuple[Parser, ResetWatch]] = {}  # by drone
        self._samples: dict[int, deque[LazySample]] = {}
        self._pitches: dict[int, float] = {}  # by system id: gimbal pitch (rad), which the bus sends before the pose
        self._next_pose: dict[int, int] = {}
        self._due: deque[LazySample] = deque()  # poses to write; they wait for the positions of the other drones

    def begin(self, t0_us: int, cap_s: float | None = None) -> None:
        self._t0_us = t0_us
        sending = {drone for drone, (_, watch) in self._telemetry.items() if watch.sends_counter}
        resets = True if sending and sending >= set(self._samples) else UNSET
        self._rows.write(Begin(t0_us=t0_us, cap_s=cap_s, contacts=True, resets=resets))

    def end(self, reason: str, error: str | None = None) -> None:
        if self._t0_us is not None:
            self._write_poses(waiting=False)
        super().end(reason, error)

    def truth(self, data: bytes) -> None:
        for message in self._truth_parser.feed(data):
            if message.get_msgId() == dialect.MAVLINK_MSG_ID_HIL_STATE_QUATERNION:
                self._pose(LazySample(message, self._origin, self._pitches.get(message.get_srcSystem())))
            elif message.get_msgId() == dialect.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS:
                self._pitches[message.get_srcSystem()] = gimbal_pitch(message)
            elif message.get_msgId() == dialect.MAVLINK_MSG_ID_CAMERA_IMAGE_CAPTURED:
                self._frame(message)
            elif message.get_msgId() == dialect.MAVLINK_MSG_ID_STATUSTEXT and self._t0_us is not None:
                self._contact(message)
            self._tlog.write(self._time_us, frame_of(message))
        self._tlog.flush()

    def telemetry(self, data: bytes, drone: int = 0) -> None:
        """Process bytes of a drone's autopilot: write them unchanged to the tlog, and detect estimator resets."""
        if not data:
            return
        parser, watch = self._telemetry.setdefault(drone, (Parser(), ResetWatch()))
        for frame in parser.frames(data):
            self._tlog.write(self._time_us, frame)
            self._write_reset(watch.frame(frame), drone)
        self._tlog.flush()

    def _pose(self, sample: LazySample) -> None:
        self._time_us = max(self._time_us, sample.time_us)
        self._samples.setdefault(sample.drone, deque(maxlen=KEPT)).append(sample)
        if self._t0_us is not None:
            self._keep(sample, self._t0_us)
            self._write_poses(waiting=True)

    def _keep(self, sample: LazySample, t0_us: int) -> None:
        """Queue the sample as a pose to write if POSE_PERIOD_S has passed since the drone's last pose."""
        due = self._next_pose.setdefault(sample.drone, 0)
        t = (sample.time_us - t0_us) / 1e6
        if t >= due * POSE_PERIOD_S:
            self._next_pose[sample.drone] = math.floor(t / POSE_PERIOD_S) + 1
            self._due.append(sample)

    def _write_poses(self, waiting: bool) -> None:
        """Write the queued poses. With `waiting`, a pose waits up to SILENT_US for the samples of the other drones."""
        while self._due:
            time_us = self._due[0].time_us
            reached = min(samples[-1].time_us for samples in self._samples.values())
            if waiting and reached < time_us and self._time_us - time_us <= SILENT_US:
                return
            self._write_pose(self._due.popleft().sample)

    def _write_pose(self, sample: TruthSample) -> None:
        measured = self._measured(sample)
        shared = {name: measured[name] for name in ("target_ned", "distance_m", "visible")}
        self._rows.write(Pose(t=self._t(sample.time_us), drone=sample.drone, **_body(sample), **shared))

    def _frame(self, message: dialect.MAVLink_message) -> None:
        taken = frame_taken(message)
        if self._t0_us is None:
            return
        stored = next((s for s in reversed(self._samples.get(taken.drone, ())) if s.time_us == taken.time_us), None)
        if stored is None:
            return  # the true pose never arrived; the verdict reports that the frame has none
        sample = stored.sample
        self._rows.write(
            FrameTruth(
                frame_id=taken.frame_id,
                t=self._t(sample.time_us),
                drone=sample.drone,
                **_body(sample),
                **self._measured(sample),
                camera_pitch_deg=self._camera_pitch_deg(sample),
            )
        )

    def _camera_pitch_deg(self, sample: TruthSample) -> float | UnsetType:
        """Return the pitch (°) of the camera for a frame's row; UNSET if the camera is fixed and level."""
        if sample.gimbal_pitch is not None:
            return round(math.degrees(sample.gimbal_pitch), 3)
        return self._camera.pitch_deg or UNSET

    def _contact(self, message: dialect.MAVLink_message) -> None:
        t, drone = self._t(self._time_us), message.get_srcSystem() - 1
        text = bytes(message._text_raw).decode("utf-8", "replace")  # MAVLink's `message.text` is decoded as ASCII
        if hit := hit_of(text):
            self._rows.write(Hit(t=t, drone=drone, what=hit.what, closing_speed=hit.closing_speed, crash=hit.crash))
        elif (seconds := seconds_of(text)) is not None:
            self._rows.write(Clear(t=t, drone=drone, contact_s=seconds))

    def _measured(self, sample: TruthSample) -> dict[str, Any]:
        """Measure the target from the drone at `sample`, and return the measurement's fields, rounded for the log."""
        fleet = [nearest(kept, sample.time_us).sample for k, kept in self._samples.items() if k != sample.drone]
        measured = self._measure(self._t(sample.time_us), sample, self._camera, fleet)
        return {field.name: _rounded(getattr(measured, field.name), field.name) for field in fields(measured)}


def _body(sample: TruthSample) -> dict[str, Any]:
    """Return the fields of a drone's pose, rounded for the log."""
    return {
        "position_ned": _rounded(sample.position_ned, "position_ned"),
        "yaw_deg": _rounded(math.degrees(quat_yaw(sample.attitude)), "yaw_deg"),
    }


def _rounded(value: Any, name: str) -> Any:
    """Return a number or a tuple of numbers rounded, other values unchanged.

    The bus has a resolution of 1 cm, so four decimals are enough. The unit of `target_box` is a thousandth of the
    picture, about one pixel, so two decimals are enough.
    """
    if isinstance(value, tuple):
        return tuple(_rounded(number, name) for number in value)
    return value if value is None or isinstance(value, bool) else round(float(value), 2 if name == "target_box" else 4)


@dataclass(frozen=True, slots=True, kw_only=True)
class EstimateLoggerConfig:
    folder: str  # folder for the episode's logs


class EstimateRecorder(EpisodeRecorder):
    """Writes poses from LOCAL_POSITION_NED and ATTITUDE into truth.jsonl, and every message into flight.tlog.

    Values that are not finite stay out of truth.jsonl.
    """

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self._parser = Parser()
        self._clock = VehicleClock()
        self._resets = ResetWatch()
        self._yaw_deg: float | None = None
        self._next_pose = 0

    def begin(self, t0_us: int, cap_s: float | None = None) -> None:
        self._t0_us, self._time_us = t0_us, max(t0_us, self._clock.time_us)
        resets = True if self._resets.sends_counter else UNSET
        self._rows.write(Begin(t0_us=t0_us, cap_s=cap_s, source="estimate", resets=resets))

    def telemetry(self, data: bytes) -> None:
        """Process bytes of the vehicle's MAVLink link."""
        for message in self._parser.feed(data):
            self._tlog.write(self._clock.time_us, bytes(message.get_msgbuf()))
            if message.get_srcComponent() != dialect.MAV_COMP_ID_AUTOPILOT1:
                continue
            if message.get_msgId() == dialect.MAVLINK_MSG_ID_ATTITUDE:
                if math.isfinite(message.yaw):
                    self._yaw_deg = math.degrees(message.yaw)
            elif message.get_msgId() == dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED:
                self._clock.see(message.time_boot_ms)
                # when the vehicle reboots, its clock restarts at 0, but the time of the episode must not go back
                self._time_us = max(self._time_us, self._clock.time_us)
                self._pose(message)
            elif message.get_msgId() == dialect.MAVLINK_MSG_ID_ODOMETRY:
                self._write_reset(self._resets.message(message), 0)
        self._tlog.flush()

    def _pose(self, message: dialect.MAVLink_message) -> None:
        t = self._t(self._time_us)
        if self._t0_us is None or t < self._next_pose * POSE_PERIOD_S:
            return
        if not all(map(math.isfinite, (message.x, message.y, message.z))):
            return
        self._next_pose = math.floor(t / POSE_PERIOD_S) + 1
        self._rows.write(
            Pose(
                t=t,
                drone=0,
                position_ned=(round(message.x, 4), round(message.y, 4), round(message.z, 4)),
                yaw_deg=None if self._yaw_deg is None else round(self._yaw_deg, 4),
                distance_m=None,
                visible=None,
            )
        )


class EstimateLogger(LoggerPart):
    """The estimate logger as a child process of a flight on a connected vehicle."""

    _recorder: EstimateRecorder

    def __init__(self, config: EstimateLoggerConfig) -> None:
        self._recorder = EstimateRecorder(Path(config.folder))
        self._socket = UdpTransport("udpin://127.0.0.1:0", "127.0.0.1", 0, listen=True)

    def ready(self) -> dict[str, Any]:
        return {"ports": [self._socket.port]}

    def turn(self) -> None:
        self._recorder.telemetry(self._socket.receive(0.02))

    def close(self) -> None:
        super().close()
        self._socket.close()
