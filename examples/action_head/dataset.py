"""Reads the training data as arrays from a LeRobot dataset of `dronecats export --to lerobot`.

pyarrow reads the files. tests/report/export/test_lerobot.py checks that LeRobot's own class reads the same values.
"""

import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from dronecats.agent.action import Action, Finished, Go, Rotate, Think
from dronecats.pilots.actions import PastAction
from examples.action_head import features
from foundation.errors import UsageError
from foundation.protocol import HISTORY_LENGTH, POINT_SPAN

IMAGE = "observation.images.front"
HELD_OUT = 8  # about one episode in 8 is held out from training


@dataclass(frozen=True, slots=True)
class Decisions:
    """n decisions of some flights with the pilot's inputs, in the order of the flights.

    `words` and `past` have a mirrored version: [0] as flown, [1] mirrored left to right.
    """

    pictures: NDArray[np.uint8]  # (n, 3, HEIGHT, WIDTH), RGB
    words: NDArray[np.float32]  # (2, n, WORDS)
    past: NDArray[np.float32]  # (2, n, PAST)
    kinds: NDArray[np.int64]  # (n,), indices in features.KINDS
    points: NDArray[np.float32]  # (n, 2), x and y 0 … 1 from the top left; used only if the action is a go
    depths_m: NDArray[np.float32]  # (n,), m; used only if the action is a go
    angles_deg: NDArray[np.float32]  # (n,), °, positive to the right; used only if the action is a rotate
    flights: NDArray[np.int64]  # (n,), index of the flight
    held_out: NDArray[np.bool_]  # (n,), whether the flight is held out for evaluation

    def __len__(self) -> int:
        return len(self.kinds)


@dataclass(frozen=True, slots=True)
class _Row:
    """A decision of the dataset, with its picture."""

    picture: NDArray[np.uint8]
    action: NDArray[np.float32]
    flight: int


def read(folder: Path) -> Decisions:
    """Return the decisions of a dataset's flights that succeeded.

    Raises UsageError if the dataset is missing or damaged, has blank pictures, or has no successful flight.
    """
    if not (folder / "meta" / "info.json").is_file():
        raise UsageError(f"{folder} is not a dataset. Make one: dronecats export RUN --to lerobot --out {folder}")
    try:
        rows = [row for file in sorted((folder / "data").rglob("*.parquet")) for row in _rows(file)]
        flights = pq.read_table(folder / "meta" / "episodes", columns=["episode_index", "tasks", "flight.episode"])
        about = {row["episode_index"]: (row["tasks"][0], row["flight.episode"]) for row in flights.to_pylist()}
    except (OSError, KeyError, pa.ArrowException) as error:
        raise UsageError(f"{folder} is damaged: {str(error).splitlines()[0]}") from None
    if not rows:
        raise UsageError(f"{folder} has no successful flight, so there is nothing to learn from.")
    return _decisions(rows, about)


def _rows(file: Path) -> Iterator[_Row]:
    """Yield the decisions with an action, from successful flights only. Pictures are scaled down to save memory."""
    for batch in pq.ParquetFile(file).iter_batches(
        batch_size=64, columns=[IMAGE, "action", "episode_index", "judge.success"]
    ):
        for row in batch.to_pylist():
            if row["judge.success"] and any(row["action"][: len(features.KINDS)]):
                shown = features.picture(row[IMAGE]["bytes"])
                if shown.min() == shown.max():
                    raise UsageError(f"{file} has blank pictures. Fly again with --rendered.")
                yield _Row(shown, np.array(row["action"], np.float32), row["episode_index"])


def _decisions(rows: list[_Row], about: dict[int, tuple[str, str]]) -> Decisions:
    past: list[PastAction] = []
    pasts, flight = [], -1
    for row in rows:
        if row.flight != flight:
            past, flight = [], row.flight
        pasts.append(tuple(past))
        past = [*past, features.as_past(action_of(row.action))][-HISTORY_LENGTH:]
    texts = [about[row.flight][0] for row in rows]
    actions = np.stack([row.action for row in rows])
    mirrors = (False, True)
    return Decisions(
        pictures=np.stack([row.picture for row in rows]),
        words=np.stack([np.stack([features.words(text, mirrored=m) for text in texts]) for m in mirrors]),
        past=np.stack([np.stack([features.history(past, mirrored=m) for past in pasts]) for m in mirrors]),
        kinds=actions[:, :4].argmax(1).astype(np.int64),
        points=actions[:, 4:6] / np.float32(POINT_SPAN),
        depths_m=actions[:, 6],
        angles_deg=actions[:, 7],
        flights=np.array([row.flight for row in rows], np.int64),
        held_out=np.array([is_held_out(about[row.flight][1]) for row in rows]),
    )


def action_of(vector: NDArray[np.float32]) -> Action:
    """Return the action that eight numbers of a dataset encode. Raises UsageError for invalid numbers."""
    match [bool(number) for number in vector[:4]]:
        case [True, False, False, False]:
            return Go(float(vector[4]), float(vector[5]), float(vector[6]))
        case [False, True, False, False]:
            return Rotate(float(vector[7]))
        case [False, False, True, False]:
            return Think()
        case [False, False, False, True]:
            return Finished()
    raise UsageError(f"the dataset has an invalid action: {vector.tolist()}")


def is_held_out(episode: str) -> bool:
    """Return whether flights of this episode are held out for evaluation. This depends only on the episode's id."""
    return zlib.crc32(episode.encode()) % HELD_OUT == 0
