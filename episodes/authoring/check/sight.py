"""Rules about the camera's view from the start, both facing the target and at the recorded yaw.

A pixel shows the target if the ray through the pixel's centre hits the target first. The renderer's image of ids
follows the same rule. A `Framing` shows at which yaws a thing is completely inside or outside a drone's picture.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from episodes.authoring.check.finding import BODY_M, DEFAULT_RULES, RULES, RuleFinding, at_least, between
from episodes.maps.scene import Array, Instance, Mesh, turn
from episodes.world.rays import NOTHING as NO_TRIANGLE
from episodes.world.rays import RayScene
from episodes.world.target import on_line
from episodes.world.visibility import NEAR_M, Occluder
from episodes.world.world import World
from foundation.camera import CameraModel
from foundation.frames import Quat, Vec3, bearing_deg, quat_from_euler, rotate, vec3
from foundation.protocol import RADIUS_M
from foundation.threads import once

STEP_DEG = 0.1  # between the yaws of a Framing
EDGE_DEG = 1.0  # a thing is completely inside the picture if it is at least this far from the picture's edge
CAMERA = CameraModel()
HALF_VIEW_DEG = math.degrees(math.atan(CAMERA.width / 2.0 / CAMERA.focal_px))

STEP_M = 0.5  # between checked points of the way to a target
MOST_STEPS = 201  # most points checked on the way to a target: enough for 100 m, the rules' largest start distance
FACED_FRACTION = 0.5  # share of the target's silhouette that must be visible when the drone faces it


@dataclass(frozen=True, slots=True)
class Patch:
    """The pixels of a picture that show the target."""

    pixels: int  # number of these pixels
    share: float  # 0 … 1 of all pixels of the picture
    box_share: float  # 0 … 1 of the picture that the box around these pixels covers
    cut: bool = False  # whether these pixels reach an edge of the picture


NOTHING = Patch(0, 0.0, 0.0)


def patch(target: Instance, solids: Occluder, origin: Vec3, attitude: Quat, camera: CameraModel = CAMERA) -> Patch:
    """Return the pixels that show a target in the picture of a drone at `origin` (m, NED). `solids` may hide them."""
    axes = turn(attitude).T
    eye = np.array(origin) + np.array(rotate(attitude, camera.offset_frd))
    to_world = turn(target.turned)
    across, down = _reach(target, eye, axes, camera)
    if len(across) == 0 or len(down) == 0:
        return NOTHING
    way = pixel_rays(across, down, axes, camera)
    own = _traced(target.mesh)
    hits = own.first_hits((eye - np.array(target.position_ned)) @ to_world, way @ to_world)
    shown = np.flatnonzero((hits.triangle != NO_TRIANGLE) & (hits.distance > NEAR_M))
    if len(shown):
        points = eye + way[shown] * hits.distance[shown, None].astype(np.float64)
        shown = shown[~solids.hidden(vec3(eye), points)]
    if len(shown) == 0:
        return NOTHING
    row, column = np.divmod(shown, len(across))
    box = (int(np.ptp(row)) + 1) * (int(np.ptp(column)) + 1)
    pixels = camera.width * camera.height
    edges = {int(across[column].min()), int(across[column].max()) + 1 - camera.width}
    edges |= {int(down[row].min()), int(down[row].max()) + 1 - camera.height}
    return Patch(len(shown), len(shown) / pixels, box / pixels, cut=0 in edges)


def pixel_rays(columns: NDArray[np.int64], rows: NDArray[np.int64], axes: Array, camera: CameraModel) -> Array:
    """Return the rays (N, 3) through the middles of pixels, row by row. `axes`: forward, right and down of the camera.

    The component of a ray along the optical axis is 1.
    """
    x = (columns + 0.5 - camera.width / 2) / camera.focal_px
    y = (rows + 0.5 - camera.height / 2) / camera.focal_px
    return np.asarray((axes[0] + x[None, :, None] * axes[1] + y[:, None, None] * axes[2]).reshape(-1, 3))


@once(16)  # the checks of a record and the episode search use the same few meshes repeatedly
def _traced(mesh: Mesh) -> RayScene:
    """Return a mesh prepared for rays, in the asset's axes."""
    return RayScene.of_mesh(mesh)


def _reach(
    target: Instance, eye: Array, axes: Array, camera: CameraModel
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the columns and the rows of the picture that the target's box may cover."""
    seen = (box_corners(target.mesh, target.position_ned, target.turned) - eye) @ axes.T
    if (seen[:, 0] <= NEAR_M).all():
        return np.arange(0), np.arange(0)
    if (seen[:, 0] <= NEAR_M).any():  # the box is partly behind the camera, so it may be anywhere in the picture
        return np.arange(camera.width), np.arange(camera.height)
    x = camera.width / 2 + camera.focal_px * seen[:, 1] / seen[:, 0]
    y = camera.height / 2 + camera.focal_px * seen[:, 2] / seen[:, 0]
    return _span(x, camera.width), _span(y, camera.height)


def _span(values: Array, size: int) -> NDArray[np.int64]:
    return np.arange(max(math.floor(values.min()), 0), min(math.ceil(values.max()) + 1, size))


@dataclass(frozen=True, slots=True, eq=False)
class Framing:
    """The horizontal position of a thing in a level drone's picture, for all yaws in steps of STEP_DEG."""

    off_deg: Array  # (N,) yaw of the nose from the thing's bearing, -180 … 180, + to the right
    left_deg: Array  # (N,) azimuth of the thing's left end from the optical axis, + to the right
    middle_deg: Array  # (N,) azimuth of the middle of the thing's box
    right_deg: Array  # (N,) azimuth of the thing's right end; left <= middle <= right, so ends may be beyond ±180

    def inside(self) -> NDArray[np.bool_]:
        """Return (N,) whether the whole width of the thing is in the picture."""
        limit = HALF_VIEW_DEG - EDGE_DEG
        return np.asarray((self.left_deg >= -limit) & (self.right_deg <= limit))

    def hidden(self) -> NDArray[np.bool_]:
        """Return (N,) whether no part of the thing's box is in the picture."""
        outside = HALF_VIEW_DEG + STEP_DEG
        beyond = (self.left_deg > outside) & (self.right_deg < 360.0 - outside)
        return np.asarray(beyond | ((self.right_deg < -outside) & (self.left_deg > outside - 360.0)))


def framing(corners_ned: Array, place: Vec3) -> Framing:
    """Return the framing of a box, corners (8, 3) in m NED, for a drone whose body origin is at `place` (m, NED)."""
    middle = corners_ned.mean(axis=0)
    ahead = math.atan2(middle[1] - place[1], middle[0] - place[0])
    off = np.arange(-180.0, 180.0, STEP_DEG)
    yaw = ahead + np.radians(off)
    lever = CAMERA.offset_frd[0]
    eye = np.stack([place[0] + lever * np.cos(yaw), place[1] + lever * np.sin(yaw)], axis=1)
    way = corners_ned[None, :, :2] - eye[:, None, :]
    to_middle = middle[None, :2] - eye
    centre = _wrap(np.degrees(np.arctan2(to_middle[:, 1], to_middle[:, 0]) - yaw))
    bearing = np.degrees(np.arctan2(way[..., 1], way[..., 0]) - yaw[:, None])
    beside = _wrap(bearing - centre[:, None])
    return Framing(off, centre + beside.min(axis=1), centre, centre + beside.max(axis=1))


def box_corners(mesh: Mesh, position_ned: Vec3, turned: float | Quat) -> Array:
    """Return the corners (8, 3) in m NED of a placed mesh's box; `turned` is the mesh's yaw (rad) or attitude."""
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    corners = np.array([[(low, high)[k >> b & 1][b] for b in range(3)] for k in range(8)], dtype=np.float64)
    return np.asarray(corners @ turn(turned).T + np.array(position_ned))


def yaw_showing(framing: Framing, share: float) -> float | None:
    """Return the yaw, relative to a thing's bearing (deg), that puts the thing's middle in the column of `share`.

    `share` runs from 0 for the rightmost to 1 for the leftmost column at which the picture shows the whole thing. None
    if the thing is too wide for the picture.
    """
    good = np.flatnonzero(framing.inside())
    if len(good) == 0:
        return None
    column = np.tan(np.radians(framing.middle_deg[good]))
    wanted = column.max() - share * (column.max() - column.min())  # from the right of the picture to its left
    return float(framing.off_deg[good[np.argmin(np.abs(column - wanted))]])


def yaw_showing_all(framings: Sequence[Framing], ahead_deg: Sequence[float], share: float) -> float | None:
    """Return a compass yaw (deg) at which the picture shows all things whole; None: there is none.

    `ahead_deg`: the bearing of each framing's thing. `share` (0 … 1) selects from the range of these yaws.
    """
    first = ahead_deg[0]
    common = np.ones(len(framings[0].off_deg), dtype=bool)
    for framing, ahead in zip(framings, ahead_deg, strict=True):
        turned = round(math.remainder(first - ahead, 360.0) / STEP_DEG)
        common &= np.roll(framing.inside(), -turned)
    good = np.flatnonzero(common)
    if len(good) == 0:
        return None
    low, high = framings[0].off_deg[good[0]], framings[0].off_deg[good[-1]]
    return first + float(low + share * (high - low))


def yaw_hiding(framing: Framing, share: float) -> float | None:
    """Return a yaw, relative to a thing's bearing (deg, 0 … 360), that hides the thing; None: there is none.

    `share` (0 … 1) selects from the range of these yaws.
    """
    hidden = np.flatnonzero(framing.hidden())
    if len(hidden) == 0:
        return None
    round_about = np.sort(framing.off_deg[hidden] % 360.0)  # from one end of the hiding range to the other
    return float(round_about[0] + share * (round_about[-1] - round_about[0]))


def _wrap(degrees: Array) -> Array:
    return np.asarray((degrees + 180.0) % 360.0 - 180.0)


def level(yaw_deg: float) -> Quat:
    return quat_from_euler(0.0, 0.0, math.radians(yaw_deg))


def rules(world: World) -> Iterator[RuleFinding]:
    """Yield the findings about the view.

    "When faced" means that the drone at its start looks straight at the target. Occupancy is the share of the picture
    that the box around the target's pixels covers.
    """
    record, start = world.record, world.record.starts[0]
    ahead = bearing_deg(start.position_ned, world.target_centre(0.0))
    faced = seen(world, start.position_ned, ahead)
    if record.cell != "commanding":
        allowed = RULES.get(record.map, DEFAULT_RULES).occupancy_percent
        finding = between("the occupancy of the target when faced", 100.0 * faced.box_share, allowed, "%")
        yield replace(finding, measured=f"{finding.measured} ({100 * faced.share:.2f} % of the pixels)")
    around = world.fleet.other_starts(0).values()
    fraction = world.measure(0.0, start.position_ned, level(ahead), CAMERA, around).visible_fraction or 0.0
    yield at_least("the visible share of the target when faced", fraction, FACED_FRACTION, "of it")
    yield way_to_target(world)
    m = world.measure(0.0, start.position_ned, level(start.yaw_deg), CAMERA, around)
    if record.visible_at_start:
        measured, wanted = f"{m.visible_fraction:.2f} of it", "visible, as recorded"
        yield RuleFinding("the target at the first frame", bool(m.visible), measured, wanted, "visible_at_start")
        if record.cell != "commanding":
            cut = seen(world, start.position_ned, start.yaw_deg).cut
            yield RuleFinding("the target in the first picture", not cut, "cut off" if cut else "whole", "whole")
        return
    shown = seen(world, start.position_ned, start.yaw_deg).pixels
    measured, wanted = f"{shown} pixels", "0 pixels, as recorded"
    yield RuleFinding("the target at the first frame", shown == 0, measured, wanted, "visible_at_start")


def seen(world: World, origin: Vec3, yaw_deg: float) -> Patch:
    """Return the target's pixels in the picture of the first drone, level at `origin`. Other drones can hide pixels."""
    return patch(world.target, world.past(world.fleet.other_starts(0).values()), origin, level(yaw_deg))


def way_to_target(world: World) -> RuleFinding:
    """Return whether a drone has room to fly straight from its start to RADIUS_M before the target."""
    start, goal = world.record.starts[0].position_ned, world.target_centre(0.0)
    span = math.dist(start, goal)
    clear = max(span - RADIUS_M, 0.0)
    worst = math.inf
    for along in np.linspace(0.0, clear, min(max(2, math.ceil(clear / STEP_M) + 1), MOST_STEPS)):
        worst = min(worst, world.clearance_m(on_line(start, goal, float(along) / max(span, 1e-9))))
    return at_least("the free space around the straight way to the target", worst, BODY_M, "m")
