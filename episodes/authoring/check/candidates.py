"""Rules about the candidates of a commanding episode: the target and its look-alikes.

The candidates must look the same, stand apart, and be visible from every start. No inscription may be readable from a
start.
"""

import itertools
import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from episodes.authoring.check.finding import (
    CANDIDATES,
    FACING,
    GRID_TO_CANDIDATES_M,
    GRID_TO_TARGET_M,
    NEAREST_PAIR_M,
    OFF_GROUND_M,
    READABLE_PX,
    READING_FOCAL_PX,
    SPOTTED_PX,
    WIDEST_PAIR_M,
    RuleFinding,
    at_least,
    between,
)
from episodes.authoring.check.placement import LIFT_M, StaticObstacles, box_of
from episodes.authoring.check.sight import CAMERA, level, patch
from episodes.maps.assets import lettering, vehicles
from episodes.maps.scene import Instance, turn
from episodes.world.target import motion
from episodes.world.visibility import Occluder, Solids, SolidsUnion
from episodes.world.world import World, solids
from foundation.frames import Vec3, rotate, rotate_inverse, vec3

LETTER_M = {"sign": lettering.LETTER_M}  # asset → height of its letters, m
PLATE_LETTER_M = vehicles.DIGIT_M  # m, height of the letters of all other assets


def rules(world: World, obstacles: StaticObstacles) -> Iterator[RuleFinding]:
    """Yield the findings about the candidates of a commanding record."""
    record = world.record
    if record.cell != "commanding":
        return
    targets = (record.target, *record.candidates)
    yield RuleFinding("the number of candidates", len(targets) == CANDIDATES, str(len(targets)), str(CANDIDATES))
    looks = {f"{target.paint} {target.asset}" for target in targets}
    yield RuleFinding("the candidates' look", len(looks) == 1, ", ".join(sorted(looks)), "one asset in one paint")
    texts = [target.inscription or "none" for target in targets]
    distinct = len(set(texts)) == len(texts) and "none" not in texts
    yield RuleFinding("the inscriptions", distinct, ", ".join(texts), "one for each candidate, all different")
    candidates = world.target_and_lookalikes
    yield from spread(world, [candidate.centre_ned for candidate in candidates])
    for instance, lookalike in zip(candidates[1:], record.candidates, strict=True):
        place, yaw = motion(lookalike).pose(0.0)
        off = abs(place[2] - world.ground_down(*place[:2]))
        hit = obstacles.overlapping(box_of(instance.mesh, place, yaw, 0.0, LIFT_M), instance.name)
        measured = f"{off:.3f} m off the ground, in {hit or 'nothing'}"
        passed = off <= OFF_GROUND_M and not hit
        yield RuleFinding(f"{instance.name}'s footing", passed, measured, f"≤ {OFF_GROUND_M:g} m, in nothing")
    yield from legibility(world, [target.inscription or "" for target in targets])


def spread(world: World, centres: list[Vec3]) -> Iterator[RuleFinding]:
    """Yield the findings about the distances between candidates, and from the middle of the starts to candidates."""
    pairs = [math.dist(a, b) for a, b in itertools.combinations(centres, 2)] or [0.0]
    yield between("the nearest pair of candidates", min(pairs), NEAREST_PAIR_M, "m")
    yield between("the widest pair of candidates", max(pairs), WIDEST_PAIR_M, "m")
    grid = np.mean([start.position_ned for start in world.record.starts], axis=0)
    distances = [math.dist(grid, centre) for centre in centres]
    to_target = math.dist(grid, world.target_centre(0.0))
    yield between("the grid's distance from the named target", to_target, GRID_TO_TARGET_M, "m")
    yield between("the grid's distance from its nearest candidate", min(distances), GRID_TO_CANDIDATES_M, "m")
    yield between("the grid's distance from its farthest candidate", max(distances), GRID_TO_CANDIDATES_M, "m")


def legibility(world: World, texts: list[str]) -> Iterator[RuleFinding]:
    """Yield whether each drone sees all candidates from its start and reads none of their inscriptions (`texts`).

    If a candidate does not show its inscription, yield only a finding that says so.
    """
    candidates = world.target_and_lookalikes
    blank = [i.name for i, text in zip(candidates, texts, strict=True) if len(_inscription(i, text)) == 0]
    if blank:
        measured = f"not shown by {', '.join(blank)}, a {candidates[0].kind}"
        yield RuleFinding("the inscription", False, measured, "an asset that shows it")
        return
    fewest, highest, of_map = math.inf, 0.0, solids(world.record.map, world.record.map_seed)
    for candidate, text in zip(candidates, texts, strict=True):
        around = SolidsUnion(of_map, Solids(i for i in candidates if i is not candidate))
        for drone, start in enumerate(world.record.starts):
            past = world.fleet.among(around, world.fleet.other_starts(drone).values())
            fewest = min(fewest, patch(candidate, past, start.position_ned, level(start.yaw_deg)).pixels)
            # `around` has no drones: they move away, and then hide no letters
            highest = max(highest, letters_px(candidate, text, around, start.position_ned, start.yaw_deg))
    yield at_least("the smallest visible part of a candidate", fewest, SPOTTED_PX, "pixels", 0)
    measured = f"{highest:.2f} px high" if highest else "turned away"
    wanted = f"< {READABLE_PX:g} px high at 640 px"
    yield RuleFinding("the best view of an inscription from a start", highest < READABLE_PX, measured, wanted)


def letters_px(instance: Instance, text: str, past: Occluder, origin: Vec3, yaw_deg: float) -> float:
    """Return the height (px) of an inscription's letters in a 640 px wide picture from `origin`.

    0 if the inscription is turned away, or `past` hides it.
    """
    tri = _inscription(instance, text)
    attitude = level(yaw_deg)
    eye = np.array(origin) + np.array(rotate(attitude, CAMERA.offset_frd))
    points = tri.mean(axis=1) @ turn(instance.turned).T + np.array(instance.position_ned)
    normals = np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0]) @ turn(instance.turned).T
    way = points - eye
    toward = -np.einsum("ij,ij->i", way, normals)
    toward /= np.maximum(np.linalg.norm(way, axis=1) * np.linalg.norm(normals, axis=1), 1e-12)
    facing = toward > FACING
    if not facing.any():
        return 0.0
    shown = ~past.hidden(vec3(eye), points[facing])
    height = LETTER_M.get(instance.kind, PLATE_LETTER_M)
    depths = [rotate_inverse(attitude, vec3(w))[0] for w in way[facing][shown]]
    return max((READING_FOCAL_PX * height / depth for depth in depths if depth > 0.5), default=0.0)


def _inscription(instance: Instance, text: str) -> NDArray[np.float64]:
    """Return the triangles (T, 3, 3) that show an inscription, m in the asset's axes."""
    mesh = instance.mesh
    looks = [k for k, material in enumerate(mesh.materials) if material.name.endswith(f"-{text}")]
    return mesh.vertices[mesh.triangles[np.isin(mesh.material, looks)]].astype(np.float64)
