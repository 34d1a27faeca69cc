"""The look-alikes of a commanding episode: alike, spread out, all in sight, and none to be read from the start."""

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
from episodes.authoring.check.placement import LIFT_M, StandingObstacles, box_of
from episodes.authoring.check.sight import CAMERA, level, patch
from episodes.maps.assets import exhibits, vehicles
from episodes.maps.scene import Instance
from episodes.records.record import TargetRecord
from episodes.world.target import motion
from episodes.world.visibility import Hides, Solids, Together, turn
from episodes.world.world import World, solids
from foundation.frames import Vec3, rotate, rotate_inverse

LETTER_M = {"sign": exhibits.LETTER_M}  # height of an inscription's letters, by asset …
PLATE_LETTER_M = vehicles.DIGIT_M  # … and of every other


def rules(world: World, standing: StandingObstacles) -> Iterator[RuleFinding]:
    """Yield the findings about the candidates of a commanding record."""
    record = world.record
    if record.cell != "commanding":
        return
    everyone = (record.target, *record.candidates)
    yield RuleFinding("the number of candidates", len(everyone) == CANDIDATES, str(len(everyone)), str(CANDIDATES))
    looks = {f"{one.paint} {one.asset}" for one in everyone}
    yield RuleFinding("the candidates' look", len(looks) == 1, ", ".join(sorted(looks)), "one asset in one paint")
    texts = [one.inscription or "none" for one in everyone]
    alone = len(set(texts)) == len(texts) and "none" not in texts
    yield RuleFinding("the inscriptions", alone, ", ".join(texts), "one for each, no two the same")
    things = world.target_and_lookalikes
    yield from spread(world, [centre(one) for one in things])
    for one, told in zip(things[1:], record.candidates, strict=True):
        place, yaw = motion(told).pose(0.0)
        off = abs(place[2] - world.ground_down(*place[:2]))
        met = standing.met(box_of(one, place, yaw, 0.0, LIFT_M), one.name)
        says = f"{off:.3f} m off the ground, in {met or 'nothing'}"
        fine = off <= OFF_GROUND_M and not met
        yield RuleFinding(f"{one.name}'s footing", fine, says, f"≤ {OFF_GROUND_M:g} m, in nothing")
    yield from legibility(world, things, everyone)


def centre(one: Instance) -> Vec3:
    """Return the middle (m, NED) of an instance's box."""
    low, high = one.mesh.vertices.min(axis=0), one.mesh.vertices.max(axis=0)
    n, e, d = np.array(one.position_ned) + turn(one.turned) @ ((low + high) / 2)
    return (float(n), float(e), float(d))


def spread(world: World, centres: list[Vec3]) -> Iterator[RuleFinding]:
    """Yield how far the candidates stand from each other and from the drones."""
    pairs = [math.dist(a, b) for a, b in itertools.combinations(centres, 2)] or [0.0]
    yield between("the nearest pair of candidates", min(pairs), NEAREST_PAIR_M, "m")
    yield between("the widest pair of candidates", max(pairs), WIDEST_PAIR_M, "m")
    grid = np.mean([start.position_ned for start in world.record.starts], axis=0)
    ways = [math.dist(grid, one) for one in centres]
    to_target = math.dist(grid, world.target_centre(0.0))
    yield between("the grid's distance from the named target", to_target, GRID_TO_TARGET_M, "m")
    yield between("the grid's distance from its nearest candidate", min(ways), GRID_TO_CANDIDATES_M, "m")
    yield between("the grid's distance from its farthest candidate", max(ways), GRID_TO_CANDIDATES_M, "m")


def legibility(world: World, things: tuple[Instance, ...], everyone: tuple[TargetRecord, ...]) -> Iterator[RuleFinding]:
    """Yield whether every candidate is spotted from every start, and no inscription can be read from any."""
    texts = {"target": everyone[0].inscription or ""}
    texts |= {f"candidate-{k}": one.inscription or "" for k, one in enumerate(everyone[1:], 1)}
    blank = [one.name for one in things if len(_written(one, texts[one.name])) == 0]
    if blank:
        says = f"not shown by {', '.join(blank)}, a {things[0].kind}"
        yield RuleFinding("the inscription", False, says, "an asset that shows it")
        return
    fewest, highest, standing = math.inf, 0.0, solids(world.record.map, world.record.map_seed)
    for one in things:
        others = Together(standing, Solids(i for i in things if i is not one))
        for drone, start in enumerate(world.record.starts):
            past = world.fleet.among(others, world.fleet.others(drone).values())
            attitude = level(start.yaw_deg)
            spot = patch(one, one.position_ned, one.turned, past, start.position_ned, attitude, CAMERA)
            fewest = min(fewest, spot.pixels)
            # letters that only a drone hides may be read as soon as it has gone
            highest = max(highest, letters_px(one, texts[one.name], others, start.position_ned, start.yaw_deg))
    yield at_least("the least that a drone sees of a candidate", fewest, SPOTTED_PX, "pixels", 0)
    says = f"{highest:.2f} px high" if highest else "turned away"
    fine = highest < READABLE_PX
    yield RuleFinding(
        "the best view of an inscription from a start", fine, says, f"< {READABLE_PX:g} px high at 640 px"
    )


def letters_px(one: Instance, text: str, past: Hides, origin: Vec3, yaw_deg: float) -> float:
    """Return how high (px, in the picture of 640 px) an inscription's letters are; 0 when they do not face it."""
    tri = _written(one, text)
    attitude = level(yaw_deg)
    eye = np.array(origin) + np.array(rotate(attitude, CAMERA.offset_frd))
    points = tri.mean(axis=1) @ turn(one.turned).T + np.array(one.position_ned)
    normals = np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0]) @ turn(one.turned).T
    way = points - eye
    toward = -np.einsum("ij,ij->i", way, normals)
    toward /= np.maximum(np.linalg.norm(way, axis=1) * np.linalg.norm(normals, axis=1), 1e-12)
    facing = toward > FACING
    if not facing.any():
        return 0.0
    shown = ~past.hidden((float(eye[0]), float(eye[1]), float(eye[2])), points[facing])
    height = LETTER_M.get(one.kind, PLATE_LETTER_M)
    depths = [rotate_inverse(attitude, (float(w[0]), float(w[1]), float(w[2])))[0] for w in way[facing][shown]]
    return max((READING_FOCAL_PX * height / depth for depth in depths if depth > 0.5), default=0.0)


def _written(one: Instance, text: str) -> NDArray[np.float64]:
    """Return the triangles (T, 3, 3) in the asset's axes (m) that an inscription is written on; none when it is not."""
    looks = [k for k, look in enumerate(one.mesh.materials) if look.name.endswith(f"-{text}")]
    return one.mesh.vertices[one.mesh.triangles[np.isin(one.mesh.material, looks)]].astype(np.float64)
