"""The episode record, which defines one flight completely: its types, its JSON, and the published schema.

The type annotations of the fields are the rules for a record file. `make schemas` publishes them in
`record.schema.json` beside this module.
Source: paper, "Maps and Episodes".
"""

import itertools
import json
import math
import unicodedata
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final, Literal, NamedTuple

import msgspec
from msgspec import Meta

from episodes import maps
from episodes.maps import assets
from foundation.errors import UsageError
from foundation.typed_file import file_bytes, json_of, no_choice, short_repr, typed

VERSION: Final = 1
CELLS = ("approaching", "searching", "tracking", "search-and-track", "commanding")  # kinds of task
MOVING = ("tracking", "search-and-track")  # the target moves
HIDDEN = ("searching", "search-and-track")  # the target is hidden at the start
STATIONARY = ("quadrotor", "sign")  # assets that cannot move, because they are on a stand or on posts

MAX_POSITION_M = 1000.0
MAX_SPEED_MPS = 10.0
MAX_DISTANCE_M = 300.0
MAX_SEED = 2**31 - 1
MAX_WAYPOINTS, MAX_STARTS, MAX_CANDIDATES = 200, 8, 16

RecordSeed = Annotated[int, Meta(ge=0, le=MAX_SEED)]
Yaw = Annotated[float, Meta(ge=-360.0, le=360.0, description="0 = north, clockwise.")]
Metres = Annotated[float, Meta(ge=-MAX_POSITION_M, le=MAX_POSITION_M)]
MapPlace = Annotated[tuple[Metres, Metres, Metres], Meta(extra={"wrong": "is not a list of three numbers"})]  # NED
MapName = Annotated[
    str,
    Meta(
        pattern="^[a-z0-9]([a-z0-9_-]{0,62}[a-z0-9])?$",
        extra={"wrong": "may hold small letters, digits, hyphens and underscores only"},
    ),
]

SCHEMA_FILE = Path(__file__).with_name("record.schema.json")
SCHEMA_DIALECT = "https://json-schema.org/draft/2020-12/schema"
SHARED = {"seed": RecordSeed, "yaw": Yaw, "vector": MapPlace, "name": MapName}


class TargetKind(NamedTuple):
    """A kind of target."""

    title: str
    required: tuple[str, ...]  # fields that must be set
    forbidden: tuple[str, ...]  # fields that must not be set
    reason: str = ""  # why the fields are forbidden


STANDING = TargetKind("placed, standing", ("paint", "position_ned", "yaw_deg"), ("path", "native"))
ON_PATH = TargetKind("placed, on a path", ("paint", "path"), ("position_ned", "yaw_deg", "native"),
                     "but the path of the target already sets its pose")  # fmt: skip
NATIVE = TargetKind("native to the map", ("native", "position_ned", "yaw_deg"), ("paint", "inscription", "path"),
                    "but a native target keeps its look and place on the map")  # fmt: skip


def _about(description: str) -> Meta:
    return Meta(description=description)


def _choice(words: Iterable[str]) -> Meta:
    """Return the rule that a text is one of these words, for the schema; the loader checks it in `_faults`."""
    return Meta(extra_json_schema={"enum": list(words)})


@dataclass(frozen=True, slots=True)
class StartPose:
    """The hover pose of one drone at the start of the episode."""

    position_ned: MapPlace  # m, body origin
    yaw_deg: Yaw


@dataclass(frozen=True, slots=True)
class Path3D:
    """A one-way route on the ground, interpolated in three dimensions."""

    waypoints_ned: Annotated[tuple[MapPlace, ...], Meta(min_length=2, max_length=MAX_WAYPOINTS)]  # m
    speed_mps: Annotated[float, Meta(ge=0.01, le=MAX_SPEED_MPS)]


@dataclass(frozen=True, slots=True)
class TargetRecord:
    """A target or look-alike: placed on the map (standing or on a path), or native (an object of the map)."""

    asset: Annotated[MapName, _about("For a native target, the kind of the instance.")]  # else one of `assets.names()`
    paint: Annotated[str, _choice(assets.PAINTS)] | None = None
    # the text on the licence plates or on the board
    inscription: (
        Annotated[
            str,
            Meta(
                pattern="^[A-Z0-9]([A-Z0-9 -]{0,22}[A-Z0-9])?$",
                extra={"wrong": "may hold up to 24 capital letters, digits, spaces and hyphens only"},
            ),
        ]
        | None
    ) = None
    position_ned: MapPlace | None = None  # m, origin of the asset, on the ground under the asset's middle
    yaw_deg: Yaw | None = None
    path: Path3D | None = None
    # if set, position_ned and yaw_deg repeat the pose of this instance on the map
    native: Annotated[MapName, _about("The name of the instance.")] | None = None


@dataclass(frozen=True, slots=True)
class EpisodeRecord:
    """One episode. Metres, degrees, NED axes with the origin at the map's geodetic origin."""

    version: Annotated[Literal[1], Meta(extra={"wrong": f"is not {VERSION}, the version that this release reads"})]
    id: Annotated[
        str,
        Meta(
            pattern="^[a-z0-9]([a-z0-9-]{0,62}[a-z0-9])?$",
            extra={"wrong": "may hold small letters, digits and hyphens only"},
        ),
    ]
    map: Annotated[MapName, _about("Name of a shipped map (blocks, campus, residential) or of the user's own map.")]
    map_seed: RecordSeed
    cell: Annotated[str, _choice(CELLS)]
    instruction: Annotated[str, Meta(min_length=1, max_length=500, description="The instruction to the agent.")]
    target: TargetRecord
    starts: Annotated[
        tuple[StartPose, ...],
        Meta(min_length=1, max_length=MAX_STARTS, description="Hover pose of each drone at the start of the episode."),
    ]
    start_distance_m: Annotated[
        float,
        Meta(
            ge=0.0,
            le=MAX_DISTANCE_M,
            description="From the first drone to the centre of the target's box, in three dimensions.",
        ),
    ]
    bearing_deg: Annotated[
        float, Meta(ge=0.0, le=360.0, description="Compass bearing of that centre from the first drone.")
    ]
    visible_at_start: bool
    seed: RecordSeed  # of all random values in the flight
    candidates: Annotated[
        tuple[TargetRecord, ...],
        Meta(max_length=MAX_CANDIDATES, description="Look-alikes of the target; commanding episodes only."),
    ] = ()

    def to_json(self) -> str:
        """Return the record as JSON text that `parse` reads back to an equal record."""
        return json.dumps(_plain(self), indent=2, ensure_ascii=False) + "\n"


def _plain(value: Any) -> Any:
    """Return a dataclass as a dict without its empty optional fields, and a tuple as a list."""
    if hasattr(value, "__dataclass_fields__"):
        pairs = ((name, getattr(value, name)) for name in value.__dataclass_fields__)
        return {name: _plain(v) for name, v in pairs if v is not None and not (name == "candidates" and not v)}
    return [_plain(v) for v in value] if isinstance(value, tuple) else value


def load(path: Path) -> EpisodeRecord:
    """Return the record in a file. Raises UsageError with the file, the field and the reason."""
    if not path.is_file():
        raise UsageError(f"episode file '{path}' does not exist or is not a regular file")
    return parse(file_bytes(path, f"episode file '{path}'"), str(path))


def parse(data: bytes | str, source: str) -> EpisodeRecord:
    """Return the record in JSON text. Raises UsageError, which names `source`, if the record is wrong."""
    document = json_of(data.encode("utf-8", "surrogatepass") if isinstance(data, str) else data, source)
    if not isinstance(document, dict):
        raise UsageError(f"{source}: an episode record is a JSON object, not {short_repr(document)}")
    record = typed(document, EpisodeRecord, source)
    for field, reason in _faults(record):
        raise UsageError(f"{source}: {short_repr(field)} {reason}")
    return record


def _faults(record: EpisodeRecord) -> Iterator[tuple[str, str]]:
    """Yield (field, reason) of faults that the types allow: unknown words, and fields that contradict each other."""
    if record.map not in maps.names():
        yield "map", no_choice(record.map, maps.names())
    if record.cell not in CELLS:
        yield "cell", no_choice(record.cell, CELLS)
    for field in ("id", "instruction"):
        yield from _text_faults(field, getattr(record, field))
    yield from _target_faults("target", record.target)
    for k, candidate in enumerate(record.candidates):
        yield from _target_faults(f"candidates[{k}]", candidate)
    yield from _cell_faults(record)


def _text_faults(field: str, text: str) -> Iterator[tuple[str, str]]:
    if not text.strip():
        yield field, "is blank"
    if any(unicodedata.category(c) in ("Cc", "Cs", "Zl", "Zp") for c in text):
        yield field, "contains control characters"


def _target_faults(at: str, target: TargetRecord) -> Iterator[tuple[str, str]]:
    """Yield the faults of a target: fields that its kind must not have, missing fields, and wrong values."""
    for name in ("asset", "inscription", "native"):
        yield from _text_faults(f"{at}.{name}", getattr(target, name) or "-")
    kind = NATIVE if target.native is not None else STANDING if target.path is None else ON_PATH
    for name in kind.forbidden:
        if getattr(target, name) is not None:
            yield f"{at}.{name}", f"is set, {kind.reason}"
    for name in kind.required:
        if getattr(target, name) is None:
            yield f"{at}.{name}", "is missing"
    if target.native is None and target.asset not in assets.names():
        yield f"{at}.asset", no_choice(target.asset, assets.names())
    if target.paint is not None and target.paint not in assets.PAINTS:
        yield f"{at}.paint", no_choice(target.paint, assets.PAINTS)
    for k, (a, b) in enumerate(itertools.pairwise(target.path.waypoints_ned if target.path else ())):
        if math.dist(a, b) < 0.01:
            yield f"{at}.path.waypoints_ned[{k + 1}]", "repeats the waypoint before it"


def _cell_faults(record: EpisodeRecord) -> Iterator[tuple[str, str]]:
    """Yield the fields that contradict the cell: motion, visibility at the start, and look-alikes."""
    moving, commanding = record.target.path is not None, record.cell == "commanding"
    if record.cell in MOVING and not moving:
        yield "target.path", f"is missing, because the target of a {record.cell} episode moves"
    if record.cell not in MOVING and moving:
        yield "target.path", f"is set, but the target of a {record.cell} episode stands still"
    if record.visible_at_start == (record.cell in HIDDEN):
        value = str(record.visible_at_start).lower()
        yield "visible_at_start", f"is {value}, which contradicts the cell '{record.cell}'"
    for name, is_missing in (
        ("candidates", not record.candidates),
        ("target.inscription", not record.target.inscription),
    ):
        if commanding and is_missing:
            yield name, "is missing, because a commanding episode needs 'candidates' and 'target.inscription'"
    if not commanding and record.candidates:
        yield "candidates", f"is set, but a {record.cell} episode has one target only"
    if commanding and record.target.native is not None:
        yield "target.native", "is set, but the target of a commanding episode is placed, like its look-alikes"
    for k, candidate in enumerate(record.candidates):
        if candidate.path is not None or candidate.native is not None:
            yield f"candidates[{k}]", "has a path or is native, but look-alikes are placed and stand still"
    if moving and record.target.asset in STATIONARY:
        yield "target.path", f"is set, but a {record.target.asset} cannot move"


TABLES = {"start": StartPose, "path": Path3D, "target": TargetRecord}  # by their names in the schema


def schema() -> dict[str, Any]:
    """Return the JSON Schema."""
    (_,), tables = msgspec.json.schema_components([EpisodeRecord], ref_template="#/$defs/{name}")
    record = tables.pop("EpisodeRecord")
    shared = {name: _strict(msgspec.json.schema(kind)) for name, kind in SHARED.items()}
    definitions = {name: _folded(_strict(tables[kind.__name__]), shared) for name, kind in TABLES.items()}
    definitions["start"].pop("description")  # the field `starts` has the same description
    definitions["target"]["oneOf"] = [_shape(kind) for kind in (STANDING, ON_PATH, NATIVE)]
    top = _folded(_strict(record), shared)
    return {
        "$schema": SCHEMA_DIALECT,
        **{**top, "title": f"DroneCATS episode record, version {VERSION}"},
        "$defs": {**shared, **definitions, "asset": {"enum": assets.names()}},
    }


def write_schema() -> None:
    """Write the schema file, unless it already has this content in any layout. Raises OSError."""
    if not SCHEMA_FILE.exists() or json.loads(SCHEMA_FILE.read_text(encoding="utf-8")) != schema():
        SCHEMA_FILE.write_text(json.dumps(schema(), indent=2, ensure_ascii=False) + "\n", encoding="utf-8")


def _shape(kind: TargetKind) -> dict[str, Any]:
    forbidden = [{"required": [name]} for name in kind.forbidden]
    shape = {"title": kind.title, "required": list(kind.required), "not": {"anyOf": forbidden}}
    return shape if kind is NATIVE else {**shape, "properties": {"asset": {"$ref": "#/$defs/asset"}}}


def _strict(schema: Any) -> Any:
    """Return a schema as strict as `parse`: no null for a missing field, no unknown keys."""
    if isinstance(schema, list):
        return [_strict(item) for item in schema]
    if not isinstance(schema, dict):
        return schema
    plain = {key: _strict(value) for key, value in schema.items() if key not in ("default", "$schema")}
    if kinds := plain.pop("anyOf", None):
        (kind,) = (kind for kind in kinds if kind != {"type": "null"})
        plain = {**kind, **plain}
    if "enum" in plain:
        plain.pop("type", None)
        if len(plain["enum"]) == 1:
            plain["const"] = plain.pop("enum")[0]
    if plain.pop("prefixItems", None):  # all items of a vector have the same schema
        plain["items"] = _strict(schema["prefixItems"][0])
    if plain.get("type") == "object":
        plain.pop("title", None)
        plain["additionalProperties"] = False
    if "$ref" in plain:
        name = plain["$ref"].rpartition("/")[2]
        plain["$ref"] = "#/$defs/" + next((short for short, kind in TABLES.items() if kind.__name__ == name), name)
    return plain


def _folded(schema: Any, shared: dict[str, Any]) -> Any:
    """Return a schema with references in place of repeated shared schemas."""
    if isinstance(schema, list):
        return [_folded(item, shared) for item in schema]
    if not isinstance(schema, dict):
        return schema
    for name, part in shared.items():
        if part.items() <= schema.items():
            return {**{k: v for k, v in schema.items() if k not in part}, "$ref": f"#/$defs/{name}"}
    return {key: _folded(value, shared) for key, value in schema.items()}
