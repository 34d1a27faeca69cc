"""Loads a glTF file as a map."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from episodes.maps.gltf import extras, ground, meshes
from episodes.maps.gltf import materials as looks
from episodes.maps.gltf.document import Document
from episodes.maps.gltf.materials import Images
from episodes.maps.scene import Instance, Mesh, Scene, Sun
from foundation.errors import UsageError
from foundation.frames import PX4_HOME, Vec3, vec3
from foundation.terrain import HeightField

SUN = Sun((-0.5065, 0.3957, -0.7660))  # default: late morning, northern summer

_NOWHERE = HeightField(0.0, 0.0, 1.0, np.zeros((1, 1)))


def load(path: Path, spawn: Sequence[float] | None = None, name: str | None = None) -> Scene:
    """Return the map in a binary glTF file; `name` becomes the map's name. A file of `writer.save` gives the same map.

    `spawn` is a free place on the ground, (north, east) or (north, east, down), m NED. Files of `writer.save` have
    a spawn. Without a height, the spawn is on the lowest floor with two metres of headroom. Facts that the file does
    not state have defaults: sun of a late morning, PX4's usual home, all instances solid, none movable. Raises
    UsageError for a file that is damaged, too large, compressed or not self-contained, or lacks a spawn or ground under
    the spawn.
    """
    document = Document(path)
    placed = meshes.placed(document)
    total = sum(meshes.triangle_count(document, node.mesh) for node in placed)
    if total > meshes.MAX_TRIANGLES:
        document.fail("the scene", f"has {total} triangles; {meshes.MAX_TRIANGLES} are allowed: simplify it")
    worn = set().union(*(meshes.materials_of(document, node.mesh) for node in placed)) if placed else set()
    images = Images(document, looks.used_images(document, worn))
    reader = meshes.Shapes(document, {k: looks.read(document, k, images) for k in sorted(worn)})
    instances, notes = _instances(document, placed, reader)
    if not instances:
        document.fail("the scene", "has no triangles")
    facts = extras.scene_facts(document)
    name = name or facts.name or _slug(path.stem) or "map"
    notes = (*facts.notes, *notes)
    described = Scene(name, tuple(instances), _NOWHERE, facts.sun or SUN, *(facts.origin or PX4_HOME), notes=notes)
    if facts.terrain is not None and facts.spawn_ned is not None:
        return _as_written(replace(described, terrain=facts.terrain), facts, spawn, document)
    return _grounded(described, facts, spawn, document)


def _instances(
    document: Document, placed: list[meshes.Placed], reader: meshes.Shapes
) -> tuple[list[Instance], tuple[str, ...]]:
    """Return the instances of the file, and notes about everything that is left out.

    If an id is missing or repeated, the ids in the file are ignored and the nodes are numbered from 1.
    """
    facts = [extras.node_facts(node.extras) for node in placed]
    ids = [fact.id for fact in facts]
    ours = None not in ids and len(set(ids)) == len(ids)
    taken: dict[str, int] = {}
    bent: dict[tuple[int, bytes], Mesh | None] = {}
    instances, flat = [], 0
    for k, (node, fact) in enumerate(zip(placed, facts, strict=True), 1):
        mesh = reader.mesh(node.mesh)
        place, yaw, linear = meshes.pose(node.matrix, fact.yaw)
        if mesh is not None and linear is not None:
            key = (node.mesh, linear.tobytes())
            if key not in bent:
                bent[key] = meshes.deformed(mesh, linear)
                flat += bent[key] is None
            mesh = bent[key]
        if mesh is None:
            continue
        name = _unused(node.name or f"node-{k}", taken)
        number = fact.id if ours and fact.id is not None else k
        kind = fact.kind or _kind(node.name)
        instances.append(Instance(number, name, kind, mesh, place, yaw, fact.movable, fact.solid))
    notes = []
    if reader.left_out:
        notes.append(f"{reader.left_out} sets of points or lines are left out: they have no surface.")
    if flat:
        notes.append(f"{flat} nodes are scaled to nothing and left out.")
    for feature, word in (("animations", "Animations"), ("skins", "Skins")):
        if document.tree.get(feature):
            notes.append(f"{word} are ignored: everything stands as the file places it at rest.")
    return instances, tuple(notes)


def _as_written(scene: Scene, facts: extras.SceneFacts, spawn: Sequence[float] | None, document: Document) -> Scene:
    """Return a map that `save` wrote; `spawn` replaces the spawn in the file."""
    if spawn is None:
        place = facts.spawn_ned
    else:
        north, east = _on_map(scene, spawn, document)
        place = (north, east, float(spawn[2]) if len(spawn) > 2 else scene.terrain.at(north, east))
    assert place is not None
    return replace(scene, spawn_ned=place, spawn_yaw=facts.spawn_yaw if spawn is None else 0.0)


def _grounded(scene: Scene, facts: extras.SceneFacts, spawn: Sequence[float] | None, document: Document) -> Scene:
    """Return a map whose ground is found in its geometry and separated from the other instances."""
    wanted = spawn if spawn is not None else facts.spawn_ned
    if wanted is None:
        raise UsageError(f"map file '{document.source}' has no start place. Give one with --spawn=NORTH,EAST.")
    north, east = _on_map(scene, wanted, document)
    named = [instance for instance in scene.instances if instance.kind == extras.GROUND]
    searched = named or [instance for instance in scene.instances if instance.solid and not instance.movable]
    if not searched:
        document.fail("the scene", "has nothing solid that could be its ground")
    corners = [instance.triangles_ned() for instance in searched]
    soil = ground.find(np.concatenate(corners), north, east, float(wanted[2]) if len(wanted) > 2 else None)
    if soil is None:
        raise UsageError(
            f"map file '{document.source}' has no ground under the spawn {north:g}, {east:g}: "
            "name a place (north, east) above a surface that faces up."
        )
    ends = np.cumsum([len(piece) for piece in corners])[:-1]
    flags = dict(zip((instance.id for instance in searched), np.split(soil.triangles, ends), strict=True))
    instances = scene.instances if named else _split(scene.instances, flags)
    return replace(
        scene,
        instances=tuple(instances),
        terrain=soil.field,
        spawn_ned=(north, east, soil.spawn_down),
        spawn_yaw=facts.spawn_yaw if spawn is None else 0.0,
    )


def _split(instances: Sequence[Instance], flags: Mapping[int, Any]) -> list[Instance]:
    """Return the instances, with the triangles flagged as ground moved to separate instances."""
    result, number = [], max(instance.id for instance in instances)
    for instance in instances:
        flag = flags.get(instance.id)
        if flag is None or not flag.any():
            result.append(instance)
        elif flag.all():
            result.append(replace(instance, kind=extras.GROUND))
        else:
            number += 1
            result.append(replace(instance, mesh=_part(instance.mesh, ~flag)))
            soil = replace(
                instance, id=number, name=f"{instance.name} ground", kind=extras.GROUND, mesh=_part(instance.mesh, flag)
            )
            result.append(soil)
    return result


def _part(mesh: Mesh, keep: Any) -> Mesh:
    """Return some triangles of a mesh with the vertices and materials that they use."""
    used, material = np.unique(mesh.material[keep], return_inverse=True)
    return meshes.compact(
        replace(
            mesh,
            triangles=mesh.triangles[keep],
            material=material.reshape(-1).astype(np.int32),
            materials=tuple(mesh.materials[k] for k in used),
        )
    )


def _on_map(scene: Scene, spawn: Sequence[float], document: Document) -> tuple[float, float]:
    """Return north and east of a spawn. Raises UsageError if they are outside the map."""
    north, east = float(spawn[0]), float(spawn[1])
    low, high = extent(scene)
    if not (low[0] <= north <= high[0] and low[1] <= east <= high[1]):
        raise UsageError(
            f"spawn {north:g}, {east:g} lies outside map file '{document.source}', which spans "
            f"north {low[0]:.1f} … {high[0]:.1f} m and east {low[1]:.1f} … {high[1]:.1f} m."
        )
    return north, east


def extent(scene: Scene) -> tuple[Vec3, Vec3]:
    """Return the lower and the upper corner (m, NED) of the box around everything in a scene."""
    boxes = []
    for instance in scene.instances:
        placed = instance.vertices_ned()[np.unique(instance.mesh.triangles)]
        boxes.append((placed.min(axis=0), placed.max(axis=0)))
    return vec3(np.min([box[0] for box in boxes], axis=0)), vec3(np.max([box[1] for box in boxes], axis=0))


def _unused(name: str, taken: dict[str, int]) -> str:
    """Return a name that no other instance has. Records and collisions identify instances by name."""
    while name in taken:
        taken[name] += 1
        name = f"{name}-{taken[name]}"
    taken[name] = 1
    return name


def _slug(text: str) -> str:
    return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-")[:40]


def _kind(name: str) -> str:
    """Return the kind that a node's name suggests: 'Oak tree.012' is an 'oak-tree'; 'thing' if it suggests none."""
    kind = _slug(re.sub(r"[\d._\s-]+$", "", name))
    return kind if kind and kind != extras.GROUND else "thing"
