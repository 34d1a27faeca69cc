"""truth.jsonl and flight.tlog, from the truth bus and a telemetry port. Contract: docs/run-folder.md."""

import math
from collections import deque
from pathlib import Path
from typing import overload

from dronecats.logger.measure import Measure, TruthMeasurement
from dronecats.rundir import layout
from dronecats.rundir.rows import Begin, End, FrameTruth, Pose
from dronecats.rundir.writing import LineLog, TelemetryLog
from foundation.camera import CameraModel
from foundation.frames import Vec3, quat_yaw
from foundation.mavlink import Parser, dialect
from foundation.protocol import POSE_PERIOD_S
from foundation.truth import SILENT_US, Origin, TruthSample, frame_taken, nearest, truth_sample

KEPT = 1000  # truth samples per drone that a frame may still refer to: 20 s at 50 Hz


class Recorder:
    """Writes what happened. Before `begin` and after `end` only the tlog grows."""

    def __init__(self, folder: Path, origin: Origin, measure: Measure, camera: CameraModel) -> None:
        self._origin, self._measure, self._camera = origin, measure, camera
        self._rows, self._tlog = LineLog(folder / layout.TRUTH), TelemetryLog(folder / layout.TLOG)
        self._truth_parser, self._telemetry_parser = Parser(), Parser()
        self._samples: dict[int, deque[TruthSample]] = {}
        self._next_pose: dict[int, int] = {}
        self._due: deque[TruthSample] = deque()  # poses to be written once it is known where the others are
        self._t0_us: int | None = None
        self._time_us = 0

    @property
    def drones(self) -> int:
        """How many drones have been heard."""
        return len(self._samples)

    def begin(self, t0_us: int, cap_s: float | None = None) -> None:
        """The episode's clock is zero at this vehicle time; it is flown for `cap_s` seconds at most."""
        self._t0_us = t0_us
        self._rows.write(Begin(t0_us=t0_us, cap_s=cap_s))

    def end(self, reason: str, error: str | None = None) -> None:
        """The episode is over: `reason` is cap, decided, interrupted or error. Written once."""
        if self._t0_us is not None:
            self._write_poses(waiting=False)
            self._rows.write(End(t=self._t(self._time_us), reason=reason, error=error))
            self._t0_us = None

    def close(self) -> None:
        self._rows.close()
        self._tlog.close()

    def truth(self, data: bytes) -> None:
        """Take bytes of the truth bus."""
        for message in self._truth_parser.feed(data):
            if message.get_msgId() == dialect.MAVLINK_MSG_ID_HIL_STATE_QUATERNION:
                self._pose(truth_sample(message, self._origin))
            elif message.get_msgId() == dialect.MAVLINK_MSG_ID_CAMERA_IMAGE_CAPTURED:
                self._frame(message)
            self._raw(message)

    def telemetry(self, data: bytes) -> None:
        """Take bytes of an autopilot's telemetry; kept raw for the ground-station tools."""
        for message in self._telemetry_parser.feed(data):
            self._raw(message)

    def _pose(self, sample: TruthSample) -> None:
        self._time_us = max(self._time_us, sample.time_us)
        self._samples.setdefault(sample.drone, deque(maxlen=KEPT)).append(sample)
        if self._t0_us is not None:
            self._keep(sample, self._t0_us)
            self._write_poses(waiting=True)

    def _keep(self, sample: TruthSample, t0_us: int) -> None:
        """Have a pose written every POSE_PERIOD_S."""
        due = self._next_pose.setdefault(sample.drone, 0)
        t = (sample.time_us - t0_us) / 1e6
        if t >= due * POSE_PERIOD_S:
            self._next_pose[sample.drone] = math.floor(t / POSE_PERIOD_S) + 1
            self._due.append(sample)

    def _write_poses(self, waiting: bool) -> None:
        """Write the poses that are due; `waiting` for every drone's sample of that time, unless one has gone silent."""
        while self._due:
            time_us = self._due[0].time_us
            reached = min(samples[-1].time_us for samples in self._samples.values())
            if waiting and reached < time_us and self._time_us - time_us <= SILENT_US:
                return
            self._write_pose(self._due.popleft())

    def _write_pose(self, sample: TruthSample) -> None:
        m = self._measured(sample)
        self._rows.write(
            Pose(
                t=self._t(sample.time_us),
                drone=sample.drone,
                position_ned=_place(sample.position_ned),
                yaw_deg=_rounded(math.degrees(quat_yaw(sample.attitude))),
                target_ned=_place(m.target_ned),
                distance_m=_rounded(m.distance_m),
                visible=m.visible,
            )
        )

    def _frame(self, message: dialect.MAVLink_message) -> None:
        taken = frame_taken(message)
        if self._t0_us is None:
            return
        sample = next((s for s in reversed(self._samples.get(taken.drone, ())) if s.time_us == taken.time_us), None)
        if sample is None:
            return  # a pose that never reached us: the verdict will find the frame's record missing and say so
        m = self._measured(sample)
        self._rows.write(
            FrameTruth(
                frame_id=taken.frame_id,
                t=self._t(sample.time_us),
                drone=sample.drone,
                position_ned=_place(sample.position_ned),
                yaw_deg=_rounded(math.degrees(quat_yaw(sample.attitude))),
                target_ned=_place(m.target_ned),
                distance_m=_rounded(m.distance_m),
                distance_box_m=_rounded(m.distance_box_m),
                visible=m.visible,
                visible_fraction=_rounded(m.visible_fraction),
                bearing_deg=_rounded(m.bearing_deg),
                oracle_depth_m=_rounded(m.oracle_depth_m),
            )
        )

    def _measured(self, sample: TruthSample) -> TruthMeasurement:
        others = [nearest(heard, sample.time_us) for k, heard in self._samples.items() if k != sample.drone]
        return self._measure(self._t(sample.time_us), sample, self._camera, others)

    def _t(self, time_us: int) -> float:
        return round((time_us - (self._t0_us or 0)) / 1e6, 6)

    def _raw(self, message: dialect.MAVLink_message) -> None:
        self._tlog.write(self._time_us, bytes(message.get_msgbuf()))


# Truth travels with a centimetre's resolution; four digits keep all of it without printing noise.


@overload
def _rounded(value: float) -> float: ...
@overload
def _rounded(value: float | None) -> float | None: ...
def _rounded(value: float | None) -> float | None:
    return None if value is None else round(float(value), 4)


@overload
def _place(place: Vec3) -> Vec3: ...
@overload
def _place(place: Vec3 | None) -> Vec3 | None: ...
def _place(place: Vec3 | None) -> Vec3 | None:
    return None if place is None else (_rounded(place[0]), _rounded(place[1]), _rounded(place[2]))
