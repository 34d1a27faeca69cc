"""Drafts of an episode, and the operations on them. This module uses no browser and no threads.

Callers give positions as north and east (m); heights follow from the map's ground. A draft is immutable and every
operation returns a new one, so undo goes back to an older draft.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from dronecats.view.editor import suggest
from dronecats.view.editor.suggest import Knots
from episodes.authoring.check.finding import DEFAULT_RULES, GRID_SIDE_M, RULES
from episodes.maps import assets
from episodes.maps.scene import Mesh, Scene, turn
from episodes.records.record import (
    HIDDEN,
    MAX_CANDIDATES,
    MAX_SPEED_MPS,
    MAX_STARTS,
    MAX_WAYPOINTS,
    MOVING,
    STATIONARY,
    VERSION,
    EpisodeRecord,
    Path3D,
    StartPose,
    TargetRecord,
)
from episodes.world.target import Wheels, motion, on_ground
from foundation.errors import UsageError
from foundation.frames import Vec3, bearing_deg
from foundation.protocol import CAP_S

HEIGHT_M = 1.6  # m, height of a new drone above the ground
SPEED_MPS = 0.3  # m/s, speed of a new moving target on a map without a rule for the speed
TURNED_AWAY_DEG = 90.0  # a drone with a hidden target starts turned this far away from the target
APART_M = 7.0  # m between neighbours in the suggested row of target and look-alikes
SHORTEST_LEG_M = 0.05


@dataclass(frozen=True, slots=True)
class Draft:
    """One state of an edited episode."""

    record: EpisodeRecord
    knots: Knots = ()  # the clicked points of the path; the record's waypoints follow from them
    own_words: bool = False  # whether the user wrote the instruction, so that no suggestion replaces it


T = TypeVar("T")
DraftOperation = Callable[[Draft], Draft]


class Drafting:
    """The operations on drafts of one map."""

    def __init__(self, scene: Scene) -> None:
        """`scene`: the map, without any target in it."""
        self.scene = scene
        self._instances = {instance.name: instance for instance in scene.instances if instance.kind != "ground"}

    def new(self, map_name: str, map_seed: int = 1) -> Draft:
        """Return a first draft: one drone at the map's spawn, which faces a cyan SUV 16 m to the north."""
        north, east, _ = self.scene.spawn_ned
        record = EpisodeRecord(
            version=VERSION,
            id=_first_id(map_name, "approaching"),
            map=map_name,
            map_seed=map_seed,
            cell="approaching",
            instruction="go to the cyan SUV",
            target=TargetRecord("suv", "cyan", None, self.on_ground(north + 16.0, east), 0.0),
            starts=(StartPose(self.on_ground(north, east, HEIGHT_M), 0.0),),
            start_distance_m=0.0,
            bearing_deg=0.0,
            visible_at_start=True,
            seed=1,
        )
        return self.with_derived_fields(Draft(record))

    def opened(self, record: EpisodeRecord) -> Draft:
        path = record.target.path
        knots = suggest.corners([(n, e) for n, e, _ in path.waypoints_ned]) if path else ()
        return Draft(record, knots, record.instruction != suggest.instruction(record))

    def on_ground(self, north: float, east: float, above: float = 0.0) -> Vec3:
        """Return a position (m, NED) `above` metres over the ground, rounded to 1 mm."""
        north, east = round(north, 3) + 0.0, round(east, 3) + 0.0  # + 0: no negative zeros
        return (north, east, round(self.scene.terrain.at(north, east) - above, 3) + 0.0)

    # ---- the target

    def choose(self, draft: Draft, asset: str, paint: str) -> Draft:
        """Return the draft with another asset as target and look-alikes, in the same places."""
        target = draft.record.target
        if draft.record.cell in MOVING and asset in STATIONARY:
            raise UsageError(f"the target of a {draft.record.cell} episode moves, but a {asset} cannot move.")
        paint = paint if paint in assets.PAINTS else "cyan"
        target = replace(target, asset=asset, paint=paint, native=None)
        candidates = tuple(replace(candidate, asset=asset, paint=paint) for candidate in draft.record.candidates)
        return self._changed(draft, target=target, candidates=candidates)

    def adopt(self, draft: Draft, name: str) -> Draft:
        """Return the draft with an object of the map as target. Raises UsageError if the cell does not allow this."""
        instance = self._instances.get(name)
        if instance is None:
            raise UsageError(f"the map has no object '{name}' that could be a target.")
        if draft.record.cell in MOVING or draft.record.cell == "commanding":
            raise UsageError(f"the target of a {draft.record.cell} episode cannot be an object of the map.")
        n, e, d = (round(float(v), 4) for v in instance.position_ned)
        target = TargetRecord(instance.kind, None, None, (n, e, d), round(math.degrees(instance.yaw), 3), native=name)
        draft = replace(draft, record=replace(draft.record, target=target), knots=())
        return self.face(draft, 0, TURNED_AWAY_DEG if draft.record.cell in HIDDEN else 0.0)

    def move_target(self, draft: Draft, north: float, east: float, yaw_deg: float | None = None) -> Draft:
        """Return the draft with the target and its path moved. Raises UsageError if the target is part of the map."""
        target = draft.record.target
        if target.native is not None:
            raise UsageError(f"'{target.native}' belongs to the map and cannot be moved. Choose an asset to place.")
        if target.path is not None:
            here = draft.knots[0]
            return self._walked(draft, tuple((n + north - here[0], e + east - here[1]) for n, e in draft.knots))
        yaw = target.yaw_deg if yaw_deg is None else _degrees(yaw_deg)
        moved = replace(target, position_ned=self.on_ground(north, east), yaw_deg=yaw)
        return self._changed(draft, target=moved)

    def inscribe(self, draft: Draft, which: int, text: str) -> Draft:
        """Return the draft with an inscription on the target (0) or on look-alike `which` (1 …); "" removes it."""
        written = text.strip().upper() or None
        if which == 0:
            return self._changed(draft, target=replace(draft.record.target, inscription=written))
        return self._with_candidate(draft, which - 1, inscription=written)

    # ---- the target's path

    def add_waypoint(self, draft: Draft, north: float, east: float) -> Draft:
        """Return the draft with the path extended to a point."""
        if draft.record.target.path is None:
            raise UsageError(f"the target of a {draft.record.cell} episode does not move: choose a tracking cell.")
        if math.dist(draft.knots[-1], (north, east)) < SHORTEST_LEG_M:
            return draft
        return self._walked(draft, (*draft.knots, (north, east)))

    def move_waypoint(self, draft: Draft, which: int, north: float, east: float) -> Draft:
        """Return the draft with one of the clicked points of the path moved."""
        knots = list(draft.knots)
        knots[which] = (north, east)
        return self._walked(draft, tuple(knots))

    def shorten(self, draft: Draft) -> Draft:
        """Return the draft without the path's last leg; the first leg is never removed."""
        return self._walked(draft, draft.knots[:-1]) if len(draft.knots) > 2 else draft

    def set_speed(self, draft: Draft, speed_mps: float) -> Draft:
        path = draft.record.target.path
        if path is None:
            return draft
        speed = min(max(round(speed_mps, 3), 0.01), MAX_SPEED_MPS)
        return self._changed(draft, target=replace(draft.record.target, path=replace(path, speed_mps=speed)))

    # ---- the drones

    def move_start(self, draft: Draft, which: int, north: float, east: float, yaw_deg: float | None = None) -> Draft:
        """Return the draft with one drone moved, at the same height above the ground."""
        start = draft.record.starts[which]
        yaw = start.yaw_deg if yaw_deg is None else _degrees(yaw_deg)
        place = self.on_ground(north, east, self.height(start))
        return self._changed(draft, starts=_with(draft.record.starts, which, StartPose(place, yaw)))

    def raise_start(self, draft: Draft, which: int, height_m: float) -> Draft:
        """Return the draft with one drone at another height above the ground."""
        start = draft.record.starts[which]
        place = self.on_ground(start.position_ned[0], start.position_ned[1], height_m)
        return self._changed(draft, starts=_with(draft.record.starts, which, replace(start, position_ned=place)))

    def height(self, start: StartPose) -> float:
        """Return the height (m) of a start above the ground."""
        north, east, down = start.position_ned
        return self.scene.terrain.at(north, east) - down

    def face(self, draft: Draft, which: int, off_deg: float = 0.0) -> Draft:
        """Return the draft with one drone facing `off_deg` clockwise from the target."""
        here, goal = draft.record.starts[which].position_ned, self.centre(draft.record)
        return self.move_start(draft, which, here[0], here[1], bearing_deg(here, goal) + off_deg)

    def stand_off(self, draft: Draft, distance_m: float) -> Draft:
        """Return the draft with the first drone at another distance (m, 3-D) from the target, on the same bearing."""
        here, goal = draft.record.starts[0].position_ned, self.centre(draft.record)
        span = max(math.dist(here[:2], goal[:2]), 1e-6)
        moved = draft
        for _ in range(4):  # iterate, since the height of the ground changes with the position
            level = math.sqrt(max(distance_m**2 - (moved.record.starts[0].position_ned[2] - goal[2]) ** 2, 0.01))
            north, east = (goal[k] + (here[k] - goal[k]) / span * level for k in (0, 1))
            moved = self.move_start(moved, 0, north, east)
        return moved

    def add_start(self, draft: Draft) -> Draft:
        """Return the draft with one more drone, two metres to the right of the last one."""
        starts = draft.record.starts
        if len(starts) >= MAX_STARTS:
            raise UsageError(f"an episode has at most {MAX_STARTS} drones.")
        (north, east, _), yaw = starts[-1].position_ned, starts[-1].yaw_deg
        right = math.radians(yaw + 90.0)
        place = self.on_ground(north + GRID_SIDE_M * math.cos(right), east + GRID_SIDE_M * math.sin(right), HEIGHT_M)
        return self._changed(draft, starts=(*starts, StartPose(place, yaw)))

    def drop_start(self, draft: Draft) -> Draft:
        """Return the draft without its last drone; the first one always stays."""
        return self._changed(draft, starts=draft.record.starts[:-1] or draft.record.starts)

    def grid(self, draft: Draft) -> Draft:
        """Return the draft with four drones in a square of 2 m. The first drone stays and gives height and yaw."""
        (north, east, _), yaw = draft.record.starts[0].position_ned, draft.record.starts[0].yaw_deg
        height, turned = self.height(draft.record.starts[0]), turn(math.radians(yaw))
        corners = ((0.0, 0.0), (0.0, GRID_SIDE_M), (-GRID_SIDE_M, 0.0), (-GRID_SIDE_M, GRID_SIDE_M))
        spots = [(north + turned[0, 0] * x + turned[0, 1] * y, east + turned[1, 0] * x + turned[1, 1] * y)
                 for x, y in corners]  # fmt: skip
        starts = tuple(StartPose(self.on_ground(n, e, height), yaw) for n, e in spots)
        return self._changed(draft, starts=starts)

    # ---- look-alikes

    def add_candidate(self, draft: Draft, north: float, east: float) -> Draft:
        """Return the draft with one more look-alike: a copy of the target with another inscription."""
        record = draft.record
        if record.cell != "commanding":
            raise UsageError("only a commanding episode has look-alikes. Choose the cell commanding first.")
        if len(record.candidates) >= MAX_CANDIDATES:
            raise UsageError(f"an episode has at most {MAX_CANDIDATES} look-alikes.")
        yaw = record.target.yaw_deg
        text = suggest.inscription({candidate.inscription for candidate in (record.target, *record.candidates)})
        added = replace(record.target, inscription=text, position_ned=self.on_ground(north, east), yaw_deg=yaw)
        return self._changed(draft, candidates=(*record.candidates, added))

    def move_candidate(
        self, draft: Draft, which: int, north: float, east: float, yaw_deg: float | None = None
    ) -> Draft:
        yaw = draft.record.candidates[which].yaw_deg if yaw_deg is None else _degrees(yaw_deg)
        return self._with_candidate(draft, which, position_ned=self.on_ground(north, east), yaw_deg=yaw)

    def drop_candidate(self, draft: Draft) -> Draft:
        """Return the draft without its last look-alike; the first one always stays."""
        return self._changed(draft, candidates=draft.record.candidates[:-1] or draft.record.candidates)

    # ---- the episode

    def cell(self, draft: Draft, cell: str) -> Draft:
        """Return the draft with another cell (kind of episode), changed as that cell requires."""
        old = draft.record
        fresh = old.id == _first_id(old.map, old.cell)
        record = replace(old, cell=cell, id=_first_id(old.map, cell) if fresh else old.id)
        target, draft = record.target, replace(draft, record=record)
        if cell in MOVING and target.path is None:
            place, yaw = motion(target).pose(0.0)
            speed = RULES.get(record.map, DEFAULT_RULES).speed_mps or SPEED_MPS
            walks = target.native is None and target.asset not in STATIONARY
            walker = target if walks else replace(target, asset="suv", paint="cyan", native=None)
            walker = replace(walker, position_ned=None, yaw_deg=None, path=Path3D((place, place), speed))
            knots = suggest.way(self.scene, record, (place[0], place[1]), yaw, 1.02 * speed * CAP_S)
            draft = self._walked(replace(draft, record=replace(record, target=walker)), knots)
        elif cell not in MOVING and target.path is not None:
            place, yaw = motion(target).pose(0.0)
            here = self.on_ground(place[0], place[1])
            still = replace(target, path=None, position_ned=here, yaw_deg=round(math.degrees(yaw), 1))
            draft = replace(draft, record=replace(record, target=still), knots=())
        if cell == "commanding":
            return self._commanded(draft)
        if draft.record.candidates:
            alone = replace(draft.record, candidates=(), starts=draft.record.starts[:1])
            draft = replace(draft, record=alone)
        return self.face(draft, 0, TURNED_AWAY_DEG if cell in HIDDEN else 0.0)

    def instruct(self, draft: Draft, text: str) -> Draft:
        """Return the draft with another instruction; an empty one restores the suggested one."""
        words = " ".join(text.split())[:500]
        if not words:
            return self.with_derived_fields(replace(draft, own_words=False))
        return replace(draft, record=replace(draft.record, instruction=words), own_words=True)

    def rename(self, draft: Draft, name: str) -> Draft:
        return replace(draft, record=replace(draft.record, id=name.strip()))

    def reseed(self, draft: Draft, seed: int) -> Draft:
        return replace(draft, record=replace(draft.record, seed=seed))

    # ---- derived values

    def centre(self, record: EpisodeRecord) -> Vec3:
        """Return the centre (m, NED) of the target's box at the beginning of the episode."""
        mesh, ground = self.mesh(record.target), self.scene.terrain
        wheels = Wheels.if_any(record.target.asset, mesh) if record.target.native is None else None
        place, turned = on_ground(wheels, ground, motion(record.target).pose(0.0))
        middle = turn(turned) @ ((mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0)) / 2.0)
        return (place[0] + float(middle[0]), place[1] + float(middle[1]), place[2] + float(middle[2]))

    def mesh(self, target: TargetRecord) -> Mesh:
        """Return the mesh of a target, in the target's axes."""
        if target.native is not None:
            return self._instances[target.native].mesh
        return assets.build(target.asset, str(target.paint), target.inscription)

    def with_derived_fields(self, draft: Draft) -> Draft:
        """Return the draft with updated derived fields: distance, bearing, visibility, suggested instruction."""
        record = draft.record
        here, goal = record.starts[0].position_ned, self.centre(record)
        bearing = bearing_deg(here, goal)
        record = replace(
            record,
            start_distance_m=round(math.dist(here, goal), 3),
            bearing_deg=round(bearing, 2) % 360.0,
            visible_at_start=record.cell not in HIDDEN,
        )
        if not draft.own_words:
            record = replace(record, instruction=suggest.instruction(record))
        return replace(draft, record=record)

    def _changed(self, draft: Draft, **fields: Any) -> Draft:
        """Return the draft with other values of fields of its record."""
        return self.with_derived_fields(replace(draft, record=replace(draft.record, **fields)))

    def _with_candidate(self, draft: Draft, which: int, **fields: Any) -> Draft:
        changed = replace(draft.record.candidates[which], **fields)
        return self._changed(draft, candidates=_with(draft.record.candidates, which, changed))

    def _walked(self, draft: Draft, knots: Knots) -> Draft:
        """Return the draft with a path through `knots` that follows the ground."""
        path = draft.record.target.path
        if path is None:
            raise ValueError("the target does not move")
        waypoints = suggest.draped(knots, self.on_ground)
        if len(waypoints) > MAX_WAYPOINTS:
            raise UsageError(
                f"the path needs {len(waypoints)} waypoints to follow the ground,"
                f" but at most {MAX_WAYPOINTS} are possible."
            )
        target = replace(draft.record.target, path=replace(path, waypoints_ned=waypoints))
        return self.with_derived_fields(replace(draft, record=replace(draft.record, target=target), knots=knots))

    def _commanded(self, draft: Draft) -> Draft:
        """Return the draft completed for a commanding episode: inscribed target, three look-alikes, four drones."""
        record = draft.record
        if record.target.native is not None:
            record = replace(record, target=replace(record.target, native=None, asset="suv", paint="cyan"))
        if not record.target.inscription:
            record = replace(record, target=replace(record.target, inscription=suggest.inscription(set())))
        draft = self.with_derived_fields(replace(draft, record=record))
        place, yaw = motion(record.target).pose(0.0)
        aside = (-math.sin(yaw), math.cos(yaw))
        for k in range(len(record.candidates), 3):
            off = APART_M * (1, -1, 2)[k]
            draft = self.add_candidate(draft, place[0] + off * aside[0], place[1] + off * aside[1])
        return self.grid(self.face(draft, 0)) if len(record.starts) != 4 else draft


def _with(values: tuple[T, ...], which: int, changed: T) -> tuple[T, ...]:
    return (*values[:which], changed, *values[which + 1 :])


def _degrees(yaw: float) -> float:
    return round(math.remainder(yaw, 360.0), 1) + 0.0


def _first_id(map_name: str, cell: str) -> str:
    return f"{map_name}-{cell}-new"
