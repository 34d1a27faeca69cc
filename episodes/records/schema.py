"""The published schema of the episode record, made from its types. `make schemas` writes it."""

import json
from pathlib import Path
from typing import Any

import msgspec

from episodes.maps import assets
from episodes.records.record import (
    VERSION,
    EpisodeRecord,
    MapName,
    MapPlace,
    Path3D,
    RecordSeed,
    StartPose,
    TargetRecord,
    Yaw,
)

FILE = Path(__file__).with_name("record.schema.json")
DIALECT = "https://json-schema.org/draft/2020-12/schema"
TABLES = {"start": StartPose, "path": Path3D, "target": TargetRecord}  # by their names in the schema
SHARED = {"seed": RecordSeed, "yaw": Yaw, "vector": MapPlace, "name": MapName}
PLACED = {"asset": {"$ref": "#/$defs/asset"}}
SHAPES: list[dict[str, Any]] = [  # of a target: what it has, what it has not
    {"title": "placed, standing", "has": ("paint", "position_ned", "yaw_deg"), "not": ("path", "native")},
    {"title": "placed, on a path", "has": ("paint", "path"), "not": ("position_ned", "yaw_deg", "native")},
    {"title": "native to the map", "has": ("native", "position_ned", "yaw_deg"),
     "not": ("paint", "inscription", "path")},
]  # fmt: skip


def published() -> dict[str, Any]:
    """Return the JSON Schema."""
    (_,), tables = msgspec.json.schema_components([EpisodeRecord], ref_template="#/$defs/{name}")
    record = tables.pop("EpisodeRecord")
    shared = {name: _plain(msgspec.json.schema(kind)) for name, kind in SHARED.items()}
    parts = {name: _folded(_plain(tables[kind.__name__]), shared) for name, kind in TABLES.items()}
    parts["start"].pop("description")  # which `starts` has
    parts["target"]["oneOf"] = [_shape(**shape) for shape in SHAPES]
    top = _folded(_plain(record), shared)
    return {
        "$schema": DIALECT,
        **{**top, "title": f"DroneCATS episode record, version {VERSION}"},
        "$defs": {**shared, **parts, "asset": {"enum": assets.names()}},
    }


def write() -> None:
    """Write the file where it says something else; a layout made by hand stays. Raises OSError."""
    if not FILE.exists() or json.loads(FILE.read_text(encoding="utf-8")) != published():
        FILE.write_text(json.dumps(published(), indent=2, ensure_ascii=False) + "\n", encoding="utf-8")


def _shape(title: str, has: tuple[str, ...], **rest: tuple[str, ...]) -> dict[str, Any]:
    forbidden = [{"required": [name]} for name in rest["not"]]
    shape = {"title": title, "required": list(has), "not": {"anyOf": forbidden}}
    return shape if "native" in has else {**shape, "properties": PLACED}


def _plain(schema: Any) -> Any:
    """Return a schema as the reader takes it: no null where a field may be missing, no key that is no field."""
    if isinstance(schema, list):
        return [_plain(each) for each in schema]
    if not isinstance(schema, dict):
        return schema
    plain = {key: _plain(value) for key, value in schema.items() if key not in ("default", "$schema")}
    if kinds := plain.pop("anyOf", None):
        (kind,) = (each for each in kinds if each != {"type": "null"})
        plain = {**kind, **plain}
    if "enum" in plain:
        plain.pop("type", None)
        if len(plain["enum"]) == 1:
            plain["const"] = plain.pop("enum")[0]
    if plain.pop("prefixItems", None):  # all of a vector's items are alike
        plain["items"] = _plain(schema["prefixItems"][0])
    if plain.get("type") == "object":
        plain.pop("title", None)
        plain["additionalProperties"] = False
    if "$ref" in plain:
        name = plain["$ref"].rpartition("/")[2]
        plain["$ref"] = "#/$defs/" + next((short for short, kind in TABLES.items() if kind.__name__ == name), name)
    return plain


def _folded(schema: Any, shared: dict[str, Any]) -> Any:
    """Return a schema with a reference wherever a shared one is repeated."""
    if isinstance(schema, list):
        return [_folded(each, shared) for each in schema]
    if not isinstance(schema, dict):
        return schema
    for name, part in shared.items():
        if part.items() <= schema.items():
            return {**{k: v for k, v in schema.items() if k not in part}, "$ref": f"#/$defs/{name}"}
    return {key: _folded(value, shared) for key, value in schema.items()}
