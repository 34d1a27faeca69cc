"""Reads and writes the `extras` of a glTF file: facts about a map for which glTF has no field.

Other programs show them as custom properties.
"""

import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from episodes.maps.gltf.document import Document
from episodes.maps.scene import Instance, Scene, Sun
from foundation.frames import Vec3
from foundation.terrain import HeightField

GROUND = "ground"  # kind of instances that only show the ground; vehicles stand on the height field
MAX_ID = 2**31 - 1
_SCENE = "dronecats"
_ID, _KIND, _SOLID, _MOVABLE, _YAW = (f"dronecats_{name}" for name in ("id", "kind", "solid", "movable", "yaw"))


@dataclass(frozen=True, slots=True)
class NodeFacts:
    """The facts about one instance, from the extras of its node. None: not in the file."""

    id: int | None = None
    kind: str | None = None
    solid: bool = True
    movable: bool = False
    yaw: float | None = None  # rad, exact; the node's quaternion is rounded


@dataclass(frozen=True, slots=True, eq=False)
class SceneFacts:
    """The facts about a map, from the extras of its file. None: not in the file."""

    name: str = ""
    sun: Sun | None = None
    origin: tuple[float, float, float] | None = None  # degrees north, degrees east, m above mean sea level
    spawn_ned: Vec3 | None = None
    spawn_yaw: float = 0.0  # rad
    notes: tuple[str, ...] = ()
    terrain: HeightField | None = None


def of_instance(instance: Instance) -> dict[str, Any]:
    """Return the extras of an instance's node."""
    return {
        _ID: instance.id,
        _KIND: instance.kind,
        _SOLID: instance.solid,
        _MOVABLE: instance.movable,
        _YAW: float(instance.yaw),
    }


def node_facts(extras: Mapping[str, Any]) -> NodeFacts:
    """Return the facts in a node's extras; invalid values are ignored."""
    number, kind, yaw = extras.get(_ID), extras.get(_KIND), extras.get(_YAW)
    has_id = isinstance(number, int) and not isinstance(number, bool) and 1 <= number <= MAX_ID
    named = isinstance(kind, str) and 0 < len(kind) <= 64 and kind.isprintable()
    return NodeFacts(
        id=number if has_id else None,
        kind=kind if named else None,
        solid=_flag(extras.get(_SOLID), True),
        movable=_flag(extras.get(_MOVABLE), False),
        yaw=float(yaw) if isinstance(yaw, int | float) and abs(yaw) < 1e3 else None,
    )


def _flag(value: Any, default: bool) -> bool:
    return bool(value) if isinstance(value, bool) or value in (0, 1) else default  # some editors write 0 and 1


def of_scene(scene: Scene, terrain_view: int, terrain_bytes: bytes) -> dict[str, Any]:
    """Return the extras of a file's scene. The bufferView `terrain_view` contains the heights."""
    sun, field = scene.sun, scene.terrain
    return {
        _SCENE: {
            "name": scene.name,
            "sun": {
                "toward_ned": _floats(sun.toward_ned),
                "color": _floats(sun.color),
                "strength": float(sun.strength),
                "sky": _floats(sun.sky),
                "clouds": float(sun.clouds),
                "glow": _floats(sun.glow),
            },
            "origin": _floats((scene.latitude_deg, scene.longitude_deg, scene.altitude_m)),
            "spawn_ned": _floats(scene.spawn_ned),
            "spawn_yaw": float(scene.spawn_yaw),
            "notes": list(scene.notes),
            "terrain": {
                "origin": _floats((field.origin_north, field.origin_east)),
                "cell_m": float(field.cell_m),
                "shape": list(field.down.shape),
                "bufferView": terrain_view,
                "crc32": zlib.crc32(terrain_bytes),
            },
        }
    }


def scene_facts(document: Document) -> SceneFacts:
    """Return the facts from the extras of the file's scene, or the defaults if there are none.

    Raises UsageError if the facts are invalid.
    """
    if not document.count("scenes"):
        return SceneFacts()
    scene = document.entry("scenes", document.tree.get("scene", 0), "scene")
    extras = scene.get("extras")
    if not isinstance(extras, dict) or not isinstance(extras.get(_SCENE), dict):
        return SceneFacts()
    facts, where = extras[_SCENE], f"scene.extras.{_SCENE}"
    notes = facts.get("notes", [])
    return SceneFacts(
        name=document.name_of(facts),
        sun=_sun(document, facts, f"{where}.sun"),
        origin=_origin(document, facts, where),
        spawn_ned=_triple(document, facts, "spawn_ned", where) if "spawn_ned" in facts else None,
        spawn_yaw=document.number(facts, "spawn_yaw", where, 0.0),
        notes=tuple(n[:500] for n in notes[:100] if isinstance(n, str)) if isinstance(notes, list) else (),
        terrain=_terrain(document, facts, f"{where}.terrain"),
    )


def _sun(document: Document, facts: Mapping[str, Any], where: str) -> Sun | None:
    if "sun" not in facts:
        return None
    sun = document.mapping(facts, "sun", where)
    default = Sun(_triple(document, sun, "toward_ned", where))
    length = float(np.linalg.norm(default.toward_ned))
    if not 0.9 < length < 1.1:
        document.fail(f"{where}.toward_ned", "is not a direction of length one")
    return Sun(
        toward_ned=default.toward_ned,
        color=_triple(document, sun, "color", where, default.color),
        strength=document.number(sun, "strength", where, default.strength),
        sky=_triple(document, sun, "sky", where, default.sky),
        clouds=min(max(document.number(sun, "clouds", where, default.clouds), 0.0), 1.0),
        glow=_triple(document, sun, "glow", where, default.glow),
    )


def _origin(document: Document, facts: Mapping[str, Any], where: str) -> tuple[float, float, float] | None:
    if "origin" not in facts:
        return None
    north, east, height = _triple(document, facts, "origin", where)
    if not (abs(north) <= 85.0 and abs(east) <= 180.0 and -500.0 <= height <= 9000.0):
        document.fail(f"{where}.origin", "is not a valid latitude, longitude and altitude")
    return north, east, height


def _terrain(document: Document, facts: Mapping[str, Any], where: str) -> HeightField | None:
    """Return the height field; None if the file has none, or if another program has rearranged the file since."""
    if "terrain" not in facts:
        return None
    terrain = document.mapping(facts, "terrain", where)
    rows, columns = document.numbers(terrain, "shape", where, (0.0, 0.0))
    cell = document.number(terrain, "cell_m", where, 0.0)
    if not (rows.is_integer() and columns.is_integer() and min(rows, columns) >= 1 and 1e-3 <= cell <= 1e4):
        document.fail(where, "is not a grid of heights")
    index = terrain.get("bufferView")
    if isinstance(index, bool) or not isinstance(index, int) or not 0 <= index < document.count("bufferViews"):
        return None
    data = bytes(document.view(index, f"{where}.bufferView")[0])
    if len(data) != int(rows) * int(columns) * 8 or zlib.crc32(data) != terrain.get("crc32"):
        return None
    down = np.frombuffer(data, "<f8").reshape(int(rows), int(columns)).astype(np.float64)
    if not np.isfinite(down).all():
        document.fail(where, "has heights that are not finite")
    north, east = document.numbers(terrain, "origin", where, (0.0, 0.0))
    return HeightField(north, east, cell, down)


def _triple(
    document: Document, parent: Mapping[str, Any], key: str, where: str, default: Vec3 = (0.0, 0.0, 0.0)
) -> Vec3:
    x, y, z = document.numbers(parent, key, where, default)
    return x, y, z


def _floats(values: tuple[float, ...]) -> list[float]:
    return [float(v) + 0.0 for v in values]
