"""Writes many flights as one LeRobot dataset, version 3.0 of its layout. Needs the extra `lerobot`.

A frame is a decision with its picture. `timestamp` is artificial, 1 s per decision, because LeRobot requires a constant
frame rate. `time.frame_s` is the time of the picture. An episode is one drone's part of a flight. `observation.state`
is the autopilot's estimate; only `judge.success` comes from the judge. `action` has the units of the log.
`action.body_velocity` replaces the motion of the paper's controller (`dronecats/agent/controller.py`) by a constant
velocity and a constant yaw rate, with the same duration, end position and final heading. The velocity is forward, right
and down relative to the heading at the picture.
"""

import json
import math
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from dronecats.agent.action import Finished, Go, Rotate, Think
from dronecats.agent.controller import plan
from dronecats.report.export.conventions import about, read_picture
from dronecats.report.recorded.flight import RecordedFlight, action_of
from dronecats.report.recorded.tracks import DroneTracks, FlightTrack
from foundation.camera import CameraModel
from foundation.errors import UsageError
from foundation.frames import quat_to_euler
from foundation.run_folder.rows import Decision
from foundation.setpoints import Turn, Velocity

STATE = ("north_m", "east_m", "down_m", "forward_m_s", "right_m_s", "down_m_s", "roll_rad", "pitch_rad", "yaw_rad")
ACTION = ("go", "rotate", "think", "finished", "point_x", "point_y", "depth_m", "angle_deg")
BODY_VELOCITY = ("forward_m_s", "right_m_s", "down_m_s", "yaw_rate_rad_s", "duration_s")
EVERY_PX = 4  # the statistics of pictures use every 4th row and column
FPS = 1
FILE_BYTES = 100_000_000  # bytes of images in a data file, at most; a larger episode has its own file
IMAGE = "observation.images.front"
DATA, EPISODES = "data/chunk-000/file-{:03d}.parquet", "meta/episodes/chunk-000/file-000.parquet"
VECTORS = {"observation.state": STATE, "action": ACTION, "action.body_velocity": BODY_VELOCITY}
SCALARS = {
    "time.frame_s": "float32", "drone_index": "int64", "next.done": "bool", "judge.success": "bool",
    "timestamp": "float32", "frame_index": "int64", "episode_index": "int64", "index": "int64", "task_index": "int64",
}  # fmt: skip
ARROW = {"float32": pa.float32(), "int64": pa.int64(), "bool": pa.bool_()}
Vector = NDArray[np.float32]


def write(flights: Iterator[RecordedFlight], out: Path, overwrite: bool, left_out: list[str]) -> int:
    """Write a dataset, completely or not at all; return the number of its frames.

    The function adds a sentence about each unsuitable flight to `left_out`. Raises UsageError if no flight is suitable,
    or if `out` is not empty. With `overwrite`, it replaces a dataset in `out`.
    """
    there = out.exists() and any(out.iterdir())
    if there and not overwrite:
        raise UsageError(f"{out} exists already. Choose another --out, or replace it with --overwrite")
    if there and not (out / "meta" / "info.json").exists():
        raise UsageError(f"{out} is not a LeRobot dataset. Choose another --out")
    part = out.with_name(out.name + ".part")
    shutil.rmtree(part, ignore_errors=True)
    dataset = _Dataset(part)
    try:
        for flight in flights:
            if reason := _exclusion_reason(flight, dataset):
                left_out.append(reason)
                continue
            for drone in flight.drone_tracks:
                dataset.add(flight, drone)
        if not dataset.episodes:
            raise UsageError(f"nothing was exported: {'; '.join(left_out) or 'there is no episode'}")
        dataset.finish()
        if out.exists():
            shutil.rmtree(out)
        part.rename(out)
    finally:
        dataset.close()
        shutil.rmtree(part, ignore_errors=True)
    return dataset.frames


def _exclusion_reason(flight: RecordedFlight, dataset: "_Dataset") -> str | None:
    """Return the reason why a flight is unsuitable for the dataset, as a sentence; None: suitable."""
    folder = flight.folder
    if not flight.frames:
        return f"{folder} has no pictures"
    if any(drone.held is None for drone in flight.drone_tracks):
        return f"{folder} has no positions of the autopilot in its telemetry"
    if not flight.scored:
        return f"{folder} is not scored: {flight.verdict.error or flight.verdict.outcome}"
    if any(not _steps(flight, drone) for drone in flight.drone_tracks):
        return f"{folder} has a drone without decisions"
    try:
        sizes = {read_picture(frame.jpeg).shape for frame in flight.frames}
    except UsageError as damage:
        return str(damage)
    if len(sizes | ({dataset.shape} if dataset.shape else set())) > 1:
        return f"{folder} has pictures of another size than the flights before it"
    return None


def _steps(flight: RecordedFlight, drone: DroneTracks) -> list[Any]:
    return [step.decision for step in flight.steps if step.decision.drone == drone.number]


class _Dataset:
    """Writes a dataset, one episode at a time."""

    def __init__(self, folder: Path) -> None:
        self.frames = 0
        self.episodes: list[dict[str, Any]] = []
        self.shape: tuple[int, ...] | None = None  # (height, width, 3) of the pictures; None before the first episode
        self._folder = folder
        self._tasks: dict[str, int] = {}
        self._moments: list[dict[str, Moments]] = []  # statistics of each episode, by feature
        self._writer: pq.ParquetWriter | None = None
        self._file, self._bytes = 0, 0

    def add(self, flight: RecordedFlight, drone: DroneTracks) -> None:
        assert drone.held is not None
        decisions = _steps(flight, drone)
        jpegs = {frame.frame_id: frame.jpeg for frame in flight.frames if frame.drone == drone.number}
        first_s, count, number = decisions[0].t_frame, len(decisions), len(self.episodes)
        task = self._tasks.setdefault(flight.instruction, len(self._tasks))
        columns: dict[str, Any] = {
            "observation.state": np.array([state(drone.held, d.t_frame, first_s) for d in decisions]),
            "action": np.array([four_action(d) for d in decisions]),
            "action.body_velocity": np.array(
                [body_velocity(d, flight.camera_at(d.drone, d.t_frame)) for d in decisions]
            ),
            "time.frame_s": np.array([d.t_frame for d in decisions], np.float32),
            "drone_index": np.full(count, drone.number),
            "next.done": np.arange(count) == count - 1,
            "judge.success": np.full(count, bool(flight.verdict.success)),
            "timestamp": (np.arange(count) / FPS).astype(np.float32),
            "frame_index": np.arange(count),
            "episode_index": np.full(count, number),
            "index": self.frames + np.arange(count),
            "task_index": np.full(count, task),
        }
        pictures = [jpegs[d.frame_id] for d in decisions]
        self._write(columns, [path.read_bytes() for path in pictures])
        shown = [read_picture(path) for path in pictures]
        self.shape = shown[0].shape
        statistics = {IMAGE: image_moments(shown), **{name: moments(values) for name, values in columns.items()}}
        self._moments.append(statistics)
        self.episodes.append({
            "episode_index": number, "tasks": [flight.instruction], "length": count,
            "data/chunk_index": 0, "data/file_index": self._file,
            "dataset_from_index": self.frames, "dataset_to_index": self.frames + count,
            "meta/episodes/chunk_index": 0, "meta/episodes/file_index": 0,
            "flight.run": about(flight)["run"], "flight.episode": flight.id, "flight.drone_index": drone.number,
            "judge.success": bool(flight.verdict.success),
            **{f"stats/{name}/{key}": value for name, feature in statistics.items()
               for key, value in feature.as_lists().items()},
        })  # fmt: skip
        self.frames += count

    def _write(self, columns: dict[str, Any], jpegs: list[bytes]) -> None:
        """Write the rows of an episode into the data file, or into a new file if the data file is full."""
        size = sum(map(len, jpegs))
        if self._writer is not None and self._bytes + size > FILE_BYTES:
            self.close()
            self._file, self._bytes = self._file + 1, 0
        if self._writer is None:
            path = self._folder / DATA.format(self._file)
            path.parent.mkdir(parents=True, exist_ok=True)
            self._writer = pq.ParquetWriter(path, _schema())
        self._bytes += size
        images = [{"bytes": jpeg, "path": None} for jpeg in jpegs]
        arrays = [pa.array(images, _schema().field(IMAGE).type)]
        for name in VECTORS:
            arrays.append(pa.FixedSizeListArray.from_arrays(pa.array(columns[name].ravel()), columns[name].shape[1]))
        arrays += [pa.array(columns[name], ARROW[kind]) for name, kind in SCALARS.items()]
        self._writer.write_table(pa.Table.from_arrays(arrays, schema=_schema()))

    def finish(self) -> None:
        """Write the files about all episodes: info, tasks, episodes, statistics."""
        self.close()
        meta = self._folder / "meta"
        (self._folder / EPISODES).parent.mkdir(parents=True, exist_ok=True)
        pq.write_table(pa.Table.from_pylist(self.episodes), self._folder / EPISODES)
        pq.write_table(_task_table(self._tasks), meta / "tasks.parquet")
        merged_moments = {name: merged([feature[name] for feature in self._moments]) for name in self._moments[0]}
        stats = {name: feature.as_lists() for name, feature in merged_moments.items()}
        (meta / "stats.json").write_text(json.dumps(stats, indent=2) + "\n")
        (meta / "info.json").write_text(json.dumps(self._info(), indent=2) + "\n")

    def close(self) -> None:
        if self._writer is not None:
            self._writer.close()
            self._writer = None

    def _info(self) -> dict[str, Any]:
        image = {"dtype": "image", "shape": self.shape, "names": ["height", "width", "channels"]}
        vectors = {
            name: {"dtype": "float32", "shape": [len(names)], "names": list(names)} for name, names in VECTORS.items()
        }
        scalars = {name: {"dtype": kind, "shape": [1], "names": None} for name, kind in SCALARS.items()}
        return {
            "codebase_version": "v3.0",
            "robot_type": "multirotor",
            "total_episodes": len(self.episodes),
            "total_frames": self.frames,
            "total_tasks": len(self._tasks),
            "chunks_size": 1000,
            "data_files_size_in_mb": FILE_BYTES // 1_000_000,
            "video_files_size_in_mb": 200,
            "fps": FPS,
            "splits": {"train": f"0:{len(self.episodes)}"},
            "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
            "video_path": None,
            "features": {IMAGE: image, **vectors, **scalars},
        }


def _schema() -> pa.Schema:
    fields = [pa.field(IMAGE, pa.struct([("bytes", pa.binary()), ("path", pa.string())]))]
    fields += [pa.field(name, pa.list_(pa.float32(), len(names))) for name, names in VECTORS.items()]
    fields += [pa.field(name, ARROW[kind]) for name, kind in SCALARS.items()]
    return pa.schema(fields)


def _task_table(tasks: dict[str, int]) -> pa.Table:
    """Return the tasks in the format of a pandas data frame with the tasks as index, as LeRobot expects."""
    index = "__index_level_0__"
    pandas_metadata = {
        "index_columns": [index],
        "column_indexes": [{"name": None, "field_name": None, "pandas_type": "unicode", "numpy_type": "object",
                            "metadata": {"encoding": "UTF-8"}}],
        "columns": [
            {"name": "task_index", "field_name": "task_index", "pandas_type": "int64", "numpy_type": "int64",
             "metadata": None},
            {"name": None, "field_name": index, "pandas_type": "unicode", "numpy_type": "object", "metadata": None},
        ],
        "creator": {"library": "pyarrow", "version": pa.__version__},
        "pandas_version": "2.0.0",
    }  # fmt: skip
    table = pa.table({"task_index": pa.array(list(tasks.values()), pa.int64()), index: list(tasks)})
    return table.replace_schema_metadata({"pandas": json.dumps(pandas_metadata)})


def state(track: FlightTrack, t_s: float, first_s: float) -> Vector:
    """Return the estimate at a time as STATE (9,): displacement since `first_s`, velocity, attitude."""
    now, first = track.newest(t_s), track.newest(first_s)
    w, x, y, z = (float(value) for value in track.attitude[now])
    roll, pitch, yaw = quat_to_euler((w, x, y, z))
    vn, ve, vd = (float(value) for value in track.velocity_ned[now])
    forward, right = vn * math.cos(yaw) + ve * math.sin(yaw), ve * math.cos(yaw) - vn * math.sin(yaw)
    moved = track.position_ned[now] - track.position_ned[first]
    return np.array([*moved, forward, right, vd, roll, pitch, yaw], np.float32)


def four_action(decision: Decision) -> Vector:
    """Return a decision as ACTION (8,): the one-hot kind of action, then its numbers. Missing values are 0."""
    vector = np.zeros(len(ACTION), np.float32)
    match action_of(decision):
        case Go(x, y, depth_m):
            vector[[0, 4, 5, 6]] = (1.0, x, y, depth_m)
        case Rotate(angle_deg):
            vector[[1, 7]] = (1.0, angle_deg)
        case Think():
            vector[2] = 1.0
        case Finished():
            vector[3] = 1.0
    return vector


def body_velocity(decision: Decision, camera: CameraModel) -> Vector:
    """Return the motion of a decision as BODY_VELOCITY (5,): mean velocity, mean yaw rate, duration."""
    segments = plan(action_of(decision), camera)
    duration_s = sum(segment.duration_s for segment in segments)
    ahead = right = down = turned = 0.0
    for segment in segments:
        match segment.setpoint:
            case Turn(_, angle):
                turned = angle or 0.0
            case Velocity(forward, up, bearing):
                turned = bearing or 0.0
                ahead += forward * math.cos(turned) * segment.duration_s
                right += forward * math.sin(turned) * segment.duration_s
                down -= (up or 0.0) * segment.duration_s
    mean_velocity = np.array([ahead, right, down, turned]) / duration_s
    return np.array([*mean_velocity, duration_s], np.float32)


@dataclass(frozen=True, slots=True)
class Moments:
    """The statistics of a feature, per component. For pictures: per colour channel, (3, 1, 1), 0 … 1."""

    least: NDArray[np.float64]
    greatest: NDArray[np.float64]
    mean: NDArray[np.float64]
    std: NDArray[np.float64]
    count: int  # number of frames

    def as_lists(self) -> dict[str, Any]:
        """Return the statistics under LeRobot's names."""
        values = {"min": self.least, "max": self.greatest, "mean": self.mean, "std": self.std}
        return {**{name: value.tolist() for name, value in values.items()}, "count": [self.count]}


def moments(values: NDArray[Any]) -> Moments:
    """Return the statistics of a feature, (n,) or (n, k)."""
    table = values.reshape(len(values), -1).astype(np.float64)
    return Moments(table.min(0), table.max(0), table.mean(0), table.std(0), len(table))


def image_moments(pictures: Sequence[NDArray[np.uint8]]) -> Moments:
    """Return the statistics of pictures (h, w, 3), from every EVERY_PX-th row and column."""
    pixels = np.concatenate([picture[::EVERY_PX, ::EVERY_PX].reshape(-1, 3) for picture in pictures]) / 255.0
    least, greatest, mean, std = (
        moment.reshape(3, 1, 1) for moment in (pixels.min(0), pixels.max(0), pixels.mean(0), pixels.std(0))
    )
    return Moments(least, greatest, mean, std, len(pictures))


def merged(episodes: Sequence[Moments]) -> Moments:
    """Return the pooled statistics of several episodes."""
    weights = np.array([episode.count for episode in episodes], np.float64) / sum(episode.count for episode in episodes)
    shape = (-1,) + (1,) * episodes[0].mean.ndim
    means, variances = np.array([p.mean for p in episodes]), np.array([p.std**2 for p in episodes])
    mean = (weights.reshape(shape) * means).sum(0)
    variance = (weights.reshape(shape) * (variances + (means - mean) ** 2)).sum(0)
    least, greatest = np.min([p.least for p in episodes], 0), np.max([p.greatest for p in episodes], 0)
    return Moments(least, greatest, mean, np.sqrt(variance), sum(episode.count for episode in episodes))
