"""The episode record: everything that defines one flight, read from and written to JSON.

`record.schema.json` beside this file publishes the same shape for other tools. Source: paper, "Maps and Episodes".
"""

import difflib
import itertools
import json
import math
import re
import unicodedata
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

from episodes import maps
from episodes.maps import assets
from foundation.errors import UsageError
from foundation.frames import Vec3

VERSION = 1
CELLS = ("approaching", "searching", "tracking", "search-and-track", "commanding")
MOVING = ("tracking", "search-and-track")
HIDDEN = ("searching", "search-and-track")
STANDING = ("quadrotor", "sign")  # assets on a stand or on posts

MAX_BYTES = 1_000_000
MAX_DEPTH = 12
MAX_POSITION_M = 1000.0
MAX_SPEED_MPS = 10.0
MAX_DISTANCE_M = 300.0
MAX_SEED = 2**31 - 1
MAX_WAYPOINTS, MAX_STARTS, MAX_CANDIDATES = 200, 8, 16

_ID = re.compile(r"[a-z0-9](?:[a-z0-9-]{0,62}[a-z0-9])?")
_INSCRIPTION = re.compile(r"[A-Z0-9](?:[A-Z0-9 -]{0,22}[A-Z0-9])?")
_NAME = re.compile(r"[a-z0-9](?:[a-z0-9_-]{0,62}[a-z0-9])?")


@dataclass(frozen=True, slots=True)
class StartPose:
    """Where one drone hovers when the episode begins."""

    position_ned: Vec3  # m, body origin
    yaw_deg: float  # 0 = north, clockwise


@dataclass(frozen=True, slots=True)
class Path3D:
    """A one-way route at constant speed."""

    waypoints_ned: tuple[Vec3, ...]  # m, at least two, on the ground
    speed_mps: float


@dataclass(frozen=True, slots=True)
class TargetRecord:
    """A thing to be reached: placed on the map, standing or following a path, or native to the map."""

    asset: str  # `assets.names()`; of a native target, the kind of its instance
    paint: str | None = None  # `assets.PAINTS`; None of a native target
    inscription: str | None = None  # on its plates or its board
    position_ned: Vec3 | None = None  # m, origin of the asset: on the ground under its middle
    yaw_deg: float | None = None
    path: Path3D | None = None
    native: str | None = None  # name of the map's own instance that is the target; the pose repeats where it stands


@dataclass(frozen=True, slots=True)
class EpisodeRecord:
    """One episode."""

    version: int
    id: str
    map: str
    map_seed: int
    cell: str  # one of CELLS
    instruction: str
    target: TargetRecord
    starts: tuple[StartPose, ...]  # one per drone
    start_distance_m: float  # 3-D, first drone to the target's centre at t = 0
    bearing_deg: float  # compass bearing of the target's centre from the first drone at t = 0, [0, 360)
    visible_at_start: bool
    seed: int  # of everything random in the flight
    candidates: tuple[TargetRecord, ...] = ()  # look-alikes; commanding only

    def to_json(self) -> str:
        """Return the record as JSON text that `parse` reads back to an equal record."""
        return json.dumps(_plain(self), indent=2, ensure_ascii=False) + "\n"


def _plain(value: Any) -> Any:
    """Return dataclasses as dicts without their empty optional fields, tuples as lists."""
    if hasattr(value, "__dataclass_fields__"):
        pairs = ((name, getattr(value, name)) for name in value.__dataclass_fields__)
        return {name: _plain(v) for name, v in pairs if v is not None and not (name == "candidates" and not v)}
    return [_plain(v) for v in value] if isinstance(value, tuple) else value


def load(path: Path) -> EpisodeRecord:
    """Return the record in a file. Raises UsageError naming the file, the field and the reason."""
    try:
        if not path.is_file():
            raise UsageError(f"episode file '{path}' does not exist or is not a regular file.")
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise UsageError(f"episode file '{path}' cannot be read: {error.strerror}.") from None
    return parse(data, str(path))


def parse(data: bytes | str, source: str) -> EpisodeRecord:
    """Return the record in JSON text; `source` is named in errors. Raises UsageError."""
    raw = data.encode("utf-8", "surrogatepass") if isinstance(data, str) else data
    if len(raw) > MAX_BYTES:
        raise UsageError(f"{source}: the file is larger than {MAX_BYTES} bytes, which no episode record is.")
    return _Reader(source).record(_document(raw, source))


def _document(raw: bytes, source: str) -> Any:
    """Return the decoded JSON, refusing what Python's parser is too generous or too fragile for."""

    def constant(name: str) -> NoReturn:
        raise UsageError(f"{source}: {name} is not a number that JSON allows.")

    def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        found: dict[str, Any] = {}
        for name, value in pairs:
            if name in found:
                raise UsageError(f"{source}: the field {_quoted(name)} appears twice in one object.")
            found[name] = value
        return found

    try:
        text = raw.decode("utf-8")
    except UnicodeDecodeError as error:
        raise UsageError(f"{source}: the file is not UTF-8 text (byte {error.start}).") from None
    depth = 0
    for mark in re.finditer(r'"(?:[^"\\]|\\.)*"|[\[{\]}]', text, re.DOTALL):
        depth += {"[": 1, "{": 1, "]": -1, "}": -1}.get(mark.group(), 0)
        if depth > MAX_DEPTH:
            raise UsageError(f"{source}: the JSON is nested more than {MAX_DEPTH} levels deep.")
    try:
        return json.loads(text, parse_constant=constant, object_pairs_hook=unique)
    except json.JSONDecodeError as error:
        raise UsageError(
            f"{source}: not valid JSON at line {error.lineno}, column {error.colno}: {error.msg}."
        ) from None
    except (ValueError, RecursionError) as error:
        raise UsageError(f"{source}: the JSON cannot be read: {str(error).split(';')[0].rstrip('.')}.") from None


def _quoted(value: Any) -> str:
    """Return a value for an error message, short and on one line."""
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


class _Reader:
    """Turns decoded JSON into a record, complaining in one sentence with the field's full name."""

    def __init__(self, source: str) -> None:
        self._source = source

    def fail(self, field: str, reason: str) -> NoReturn:
        raise UsageError(f"{self._source}: field '{field}' {reason}.")

    def fields(
        self, value: Any, where: str, required: Iterable[str], optional: Iterable[str] = ()
    ) -> Mapping[str, Any]:
        if not isinstance(value, dict):
            self.fail(where, "is not an object")
        known = [*required, *optional]
        for name in value:
            if name not in known:
                near = difflib.get_close_matches(name, known, 1)
                hint = f"did you mean '{near[0]}'?" if near else f"known are {', '.join(known)}."
                raise UsageError(f"{self._source}: field {_quoted(_join(where, name))} is unknown: {hint}")
        for name in required:
            if name not in value:
                self.fail(_join(where, name), "is missing")
        return dict(value)

    def number(self, value: Any, where: str, low: float, high: float) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            self.fail(where, f"is not a number ({_quoted(value)})")
        if not low <= value <= high:  # false for nan, too
            self.fail(where, f"is {_quoted(value)}, outside {low:g} … {high:g}")
        return float(value)

    def whole(self, value: Any, where: str, low: int, high: int) -> int:
        if isinstance(value, bool) or not isinstance(value, int):
            self.fail(where, f"is not a whole number ({_quoted(value)})")
        if not low <= value <= high:
            self.fail(where, f"is {_quoted(value)}, outside {low} … {high}")
        return value

    def text(self, value: Any, where: str, longest: int) -> str:
        if not isinstance(value, str):
            self.fail(where, f"is not text ({_quoted(value)})")
        if not value.strip() or len(value) > longest:
            self.fail(where, f"must have 1 … {longest} characters")
        if any(unicodedata.category(c) in ("Cc", "Cs", "Zl", "Zp") for c in value):  # line breaks among them
            self.fail(where, "contains control characters")
        return value

    def choice(self, value: Any, where: str, known: Iterable[str]) -> str:
        names = list(known)
        if value not in names:
            near = difflib.get_close_matches(value, names, 3, 0.4) if isinstance(value, str) else []
            self.fail(where, f"is {_quoted(value)}: use one of {', '.join(near or names)}")
        return str(value)

    def vector(self, value: Any, where: str) -> Vec3:
        if not isinstance(value, list) or len(value) != 3:
            self.fail(where, "is not a list of three numbers")
        n, e, d = (self.number(v, f"{where}[{k}]", -MAX_POSITION_M, MAX_POSITION_M) for k, v in enumerate(value))
        return (n, e, d)

    def several(self, value: Any, where: str, low: int, high: int, read: Callable[[Any, str], Any]) -> tuple[Any, ...]:
        if not isinstance(value, list) or not low <= len(value) <= high:
            self.fail(where, f"is not a list of {low} … {high} items")
        return tuple(read(item, f"{where}[{k}]") for k, item in enumerate(value))

    def start(self, value: Any, where: str) -> StartPose:
        f = self.fields(value, where, ("position_ned", "yaw_deg"))
        position = self.vector(f["position_ned"], f"{where}.position_ned")
        return StartPose(position, self.number(f["yaw_deg"], f"{where}.yaw_deg", -360.0, 360.0))

    def path(self, value: Any, where: str) -> Path3D:
        f = self.fields(value, where, ("waypoints_ned", "speed_mps"))
        points = self.several(f["waypoints_ned"], f"{where}.waypoints_ned", 2, MAX_WAYPOINTS, self.vector)
        for k, (a, b) in enumerate(itertools.pairwise(points)):
            if math.dist(a, b) < 0.01:
                self.fail(f"{where}.waypoints_ned[{k + 1}]", "repeats the waypoint before it")
        return Path3D(points, self.number(f["speed_mps"], f"{where}.speed_mps", 0.01, MAX_SPEED_MPS))

    def target(self, value: Any, where: str) -> TargetRecord:
        f = self.fields(value, where, ("asset",), ("paint", "inscription", "position_ned", "yaw_deg", "path", "native"))
        if "native" in f:
            return self.native(f, where)
        if "paint" not in f:
            self.fail(f"{where}.paint", "is missing")
        asset = self.choice(f["asset"], f"{where}.asset", assets.names())
        paint = self.choice(f["paint"], f"{where}.paint", assets.PAINTS)
        inscription = None
        if "inscription" in f:
            inscription = self.text(f["inscription"], f"{where}.inscription", 24)
            if not _INSCRIPTION.fullmatch(inscription):
                self.fail(f"{where}.inscription", "may hold capital letters, digits, spaces and hyphens only")
        if "path" in f:
            for name in ("position_ned", "yaw_deg"):
                if name in f:
                    self.fail(f"{where}.{name}", "stands beside 'path', which already says where the target is")
            return TargetRecord(asset, paint, inscription, path=self.path(f["path"], f"{where}.path"))
        return TargetRecord(asset, paint, inscription, *self.pose(f, where))

    def native(self, f: Mapping[str, Any], where: str) -> TargetRecord:
        """Return a target that the map brings: what it is made of, the map knows."""
        for name in ("paint", "inscription", "path"):
            if name in f:
                self.fail(f"{where}.{name}", "stands beside 'native': what the map brings keeps its look and its place")
        for name in ("native", "asset"):
            if not _NAME.fullmatch(self.text(f[name], f"{where}.{name}", 64)):
                self.fail(f"{where}.{name}", "may hold small letters, digits, hyphens and underscores only")
        position, yaw = self.pose(f, where)
        return TargetRecord(f["asset"], None, None, position, yaw, native=f["native"])

    def pose(self, f: Mapping[str, Any], where: str) -> tuple[Vec3, float]:
        for name in ("position_ned", "yaw_deg"):
            if name not in f:
                self.fail(f"{where}.{name}", "is missing")
        position = self.vector(f["position_ned"], f"{where}.position_ned")
        return position, self.number(f["yaw_deg"], f"{where}.yaw_deg", -360.0, 360.0)

    def record(self, value: Any) -> EpisodeRecord:
        if not isinstance(value, dict):
            raise UsageError(f"{self._source}: an episode record is a JSON object, not {_quoted(value)}.")
        names = list(EpisodeRecord.__dataclass_fields__)
        f = self.fields(value, "", names[:-1], names[-1:])
        if self.whole(f["version"], "version", 0, MAX_SEED) != VERSION:
            self.fail("version", f"is {f['version']}: this release reads version {VERSION}")
        name = self.text(f["id"], "id", 64)
        if not _ID.fullmatch(name):
            self.fail("id", "may hold small letters, digits and hyphens only")
        if not isinstance(f["visible_at_start"], bool):
            self.fail("visible_at_start", "is neither true nor false")
        record = EpisodeRecord(
            version=VERSION,
            id=name,
            map=self.choice(f["map"], "map", maps.names()),
            map_seed=self.whole(f["map_seed"], "map_seed", 0, MAX_SEED),
            cell=self.choice(f["cell"], "cell", CELLS),
            instruction=self.text(f["instruction"], "instruction", 500),
            target=self.target(f["target"], "target"),
            starts=self.several(f["starts"], "starts", 1, MAX_STARTS, self.start),
            start_distance_m=self.number(f["start_distance_m"], "start_distance_m", 0.0, MAX_DISTANCE_M),
            bearing_deg=self.number(f["bearing_deg"], "bearing_deg", 0.0, 360.0),
            visible_at_start=f["visible_at_start"],
            seed=self.whole(f["seed"], "seed", 0, MAX_SEED),
            candidates=self.several(f.get("candidates", []), "candidates", 0, MAX_CANDIDATES, self.target),
        )
        self._consistent(record)
        return record

    def _consistent(self, record: EpisodeRecord) -> None:
        """Check what the cell demands: who moves, who is hidden, who has look-alikes."""
        moving, commanding = record.target.path is not None, record.cell == "commanding"
        if record.cell in MOVING and not moving:
            self.fail("target.path", f"is missing: the target of a {record.cell} episode moves")
        if record.cell not in MOVING and moving:
            self.fail("target.path", f"is given, but the target of a {record.cell} episode stands still")
        if record.visible_at_start == (record.cell in HIDDEN):
            says = str(record.visible_at_start).lower()
            self.fail("visible_at_start", f"is {says}, which contradicts the cell '{record.cell}'")
        if commanding and not (record.candidates and record.target.inscription):
            self.fail("candidates", "or 'target.inscription' is missing: a commanding episode needs both")
        if not commanding and record.candidates:
            self.fail("candidates", f"is given, but a {record.cell} episode has one target only")
        if commanding and record.target.native is not None:
            self.fail(
                "target.native", "is given, but the target of a commanding episode is placed, as its look-alikes are"
            )
        for k, other in enumerate(record.candidates):
            if other.path is not None or other.native is not None:
                self.fail(f"candidates[{k}]", "has a path or is native, but look-alikes are placed and stand still")
        if moving and record.target.asset in STANDING:
            self.fail("target.path", f"is given, but a {record.target.asset} cannot move")


def _join(where: str, name: str) -> str:
    return f"{where}.{name}" if where else name
