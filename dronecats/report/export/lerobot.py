"""Many flights as one LeRobot dataset, version 3.0 of its layout. Needs the extra `lerobot`.

A frame is a decision, on the picture that it was made on: `timestamp` counts decisions (1 a second), as LeRobot wants
frames of an even rate, and `time.frame_s` is when the picture was taken. An episode is one drone's part of a flight.
`observation.state` is what its autopilot thought; what the judge knew is in `judge.success` alone.
"""

import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from dronecats.report.export.action_vectors import ACTION, BODY_VELOCITY, STATE, body_velocity, four_action, state
from dronecats.report.export.dataset_statistics import Moments, image_moments, merged, moments
from dronecats.report.export.flight import ExportedDrone, ExportedFlight
from foundation.errors import UsageError

FPS = 1
FILE_BYTES = 100_000_000  # of a data file, after which another is begun
IMAGE = "observation.images.front"
DATA, EPISODES = "data/chunk-000/file-{:03d}.parquet", "meta/episodes/chunk-000/file-000.parquet"
VECTORS = {"observation.state": STATE, "action": ACTION, "action.body_velocity": BODY_VELOCITY}
SCALARS = {
    "time.frame_s": "float32", "drone_index": "int64", "next.done": "bool", "judge.success": "bool",
    "timestamp": "float32", "frame_index": "int64", "episode_index": "int64", "index": "int64", "task_index": "int64",
}  # fmt: skip
ARROW = {"float32": pa.float32(), "int64": pa.int64(), "bool": pa.bool_()}


def write(flights: Iterator[ExportedFlight], out: Path, overwrite: bool, left_out: list[str]) -> int:
    """Write a dataset, there whole or not at all; return how many frames it has.

    Flights that it cannot hold are told in `left_out`. Raises UsageError when something else is there, or none is left.
    """
    there = out.exists() and any(out.iterdir())
    if there and not overwrite:
        raise UsageError(f"{out} exists already: choose another --out, or write it anew with --overwrite")
    if there and not (out / "meta" / "info.json").exists():
        raise UsageError(f"{out} holds something else than a dataset: choose another --out")
    part = out.with_name(out.name + ".part")
    shutil.rmtree(part, ignore_errors=True)
    dataset = _Dataset(part)
    try:
        for flight in flights:
            if said := _unfit(flight, dataset):
                left_out.append(said)
                continue
            for drone in flight.drones:
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


def _unfit(flight: ExportedFlight, dataset: "_Dataset") -> str | None:
    """Return why a flight cannot be in a dataset; None where it can."""
    folder = flight.episode.folder
    if not flight.frames:
        return f"{folder} holds no pictures"
    if any(drone.held is None for drone in flight.drones):
        return f"{folder} holds no telemetry of where an autopilot thought it was"
    if flight.verdict.success is None:
        return f"{folder} is nobody's score: {flight.verdict.error or flight.verdict.outcome}"
    if any(not _steps(flight, drone) for drone in flight.drones):
        return f"{folder} has a drone that nothing was decided for"
    sizes = {_picture(frame.jpeg).shape for frame in flight.frames}
    if len(sizes | ({dataset.shape} if dataset.shape else set())) > 1:
        return f"{folder} has pictures of another size than those before it"
    return None


def _picture(path: Path) -> Any:
    picture = cv2.imread(str(path), cv2.IMREAD_COLOR_RGB)
    if picture is None:
        raise UsageError(f"{path} is damaged: it is no picture")
    return picture


def _steps(flight: ExportedFlight, drone: ExportedDrone) -> list[Any]:
    return [step.decision for step in flight.steps if step.decision.drone == drone.number]


class _Dataset:
    """A dataset that grows by one episode at a time."""

    def __init__(self, folder: Path) -> None:
        self.frames = 0
        self.episodes: list[dict[str, Any]] = []
        self.shape: tuple[int, ...] | None = None  # of the pictures: height, width, 3
        self._folder = folder
        self._tasks: dict[str, int] = {}
        self._told: list[dict[str, Moments]] = []  # of each episode, by feature
        self._writer: pq.ParquetWriter | None = None
        self._file, self._bytes = 0, 0

    def add(self, flight: ExportedFlight, drone: ExportedDrone) -> None:
        """Append a drone's part of a flight."""
        assert drone.held is not None
        decisions = _steps(flight, drone)
        jpegs = {frame.frame_id: frame.jpeg for frame in flight.frames if frame.drone == drone.number}
        first_s, count, number = decisions[0].t_frame, len(decisions), len(self.episodes)
        task = self._tasks.setdefault(flight.instruction, len(self._tasks))
        columns: dict[str, Any] = {
            "observation.state": np.array([state(drone.held, d.t_frame, first_s) for d in decisions]),
            "action": np.array([four_action(d) for d in decisions]),
            "action.body_velocity": np.array([body_velocity(d, flight.camera) for d in decisions]),
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
        shown = [_picture(path) for path in pictures]
        self.shape = shown[0].shape
        told = {IMAGE: image_moments(shown), **{name: moments(values) for name, values in columns.items()}}
        self._told.append(told)
        self.episodes.append({
            "episode_index": number, "tasks": [flight.instruction], "length": count,
            "data/chunk_index": 0, "data/file_index": self._file,
            "dataset_from_index": self.frames, "dataset_to_index": self.frames + count,
            "meta/episodes/chunk_index": 0, "meta/episodes/file_index": 0,
            "flight.run": flight.about()["run"], "flight.episode": flight.id, "flight.drone_index": drone.number,
            "judge.success": bool(flight.verdict.success),
            **{f"stats/{name}/{key}": value for name, one in told.items() for key, value in one.as_lists().items()},
        })  # fmt: skip
        self.frames += count

    def _write(self, columns: dict[str, Any], jpegs: list[bytes]) -> None:
        """Write the rows of an episode into the data file, or a new one where that is full."""
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
        """Write what is known of all: info, tasks, episodes, statistics."""
        self.close()
        meta = self._folder / "meta"
        (self._folder / EPISODES).parent.mkdir(parents=True, exist_ok=True)
        pq.write_table(pa.Table.from_pylist(self.episodes), self._folder / EPISODES)
        pq.write_table(_task_table(self._tasks), meta / "tasks.parquet")
        whole = {name: merged([one[name] for one in self._told]) for name in self._told[0]}
        stats = {name: one.as_lists() for name, one in whole.items()}
        (meta / "stats.json").write_text(json.dumps(stats, indent=2) + "\n")
        (meta / "info.json").write_text(json.dumps(self._info(), indent=2) + "\n")

    def close(self) -> None:
        """Close the data file."""
        if self._writer is not None:
            self._writer.close()
            self._writer = None

    def _info(self) -> dict[str, Any]:
        picture = {"dtype": "image", "shape": self.shape, "names": ["height", "width", "channels"]}
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
            "features": {IMAGE: picture, **vectors, **scalars},
        }


def _schema() -> pa.Schema:
    fields = [pa.field(IMAGE, pa.struct([("bytes", pa.binary()), ("path", pa.string())]))]
    fields += [pa.field(name, pa.list_(pa.float32(), len(names))) for name, names in VECTORS.items()]
    fields += [pa.field(name, ARROW[kind]) for name, kind in SCALARS.items()]
    return pa.schema(fields)


def _task_table(tasks: dict[str, int]) -> pa.Table:
    """Return the tasks as pandas stores a frame whose index they are, which is how LeRobot looks them up."""
    index = "__index_level_0__"
    about = {
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
    return table.replace_schema_metadata({"pandas": json.dumps(about)})
