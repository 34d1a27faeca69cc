"""What the camera sees from the start: the target, when it is faced and when the record's yaw is flown."""

import math
from collections.abc import Iterator

import numpy as np

from episodes.authoring.check.finding import RuleFinding, at_least, between
from episodes.authoring.check.limits import BODY_M, OF_OTHER_MAPS, RULES
from episodes.authoring.check.pixels import Patch, patch
from episodes.world.world import World
from foundation.camera import CameraModel
from foundation.frames import Quat, Vec3, quat_from_euler
from foundation.protocol import RADIUS_M

CAMERA = CameraModel()
STEP_M = 0.5
MOST_STEPS = 201  # a start that far off is red for its distance
FACED_FRACTION = 0.5  # of the target's silhouette that must be open to view when it is faced


def level(yaw_deg: float) -> Quat:
    """Return the attitude of a hovering drone."""
    return quat_from_euler(0.0, 0.0, math.radians(yaw_deg))


def rules(world: World) -> Iterator[RuleFinding]:
    """Yield the findings about sight. Occupancy is that of the box around the target's pixels, as a detector has it."""
    record, start = world.record, world.record.starts[0]
    ahead = bearing_deg(start.position_ned, world.target_centre(0.0))
    faced = seen(world, start.position_ned, ahead)
    if record.cell != "commanding":
        allowed = RULES.get(record.map, OF_OTHER_MAPS).occupancy_percent
        said = between("the occupancy of the faced target", 100.0 * faced.box_share, allowed, "%")
        yield RuleFinding(
            said.rule, said.passed, f"{said.measured} ({100 * faced.share:.2f} % of the pixels)", said.wanted
        )
    others = world.fleet.others(0).values()
    fraction = world.measure(0.0, start.position_ned, level(ahead), CAMERA, others).visible_fraction or 0.0
    yield at_least("the share of the faced target that nothing hides", fraction, FACED_FRACTION, "of it")
    yield way(world)
    m = world.measure(0.0, start.position_ned, level(start.yaw_deg), CAMERA, others)
    if record.visible_at_start:
        says = f"{m.visible_fraction:.2f} of it"
        yield RuleFinding(
            "the target at the first frame", bool(m.visible), says, "visible, as recorded", "visible_at_start"
        )
        if record.cell != "commanding":
            cut = seen(world, start.position_ned, start.yaw_deg).cut
            yield RuleFinding("the target in the first picture", not cut, "cut off" if cut else "whole", "whole")
        return
    shown = seen(world, start.position_ned, start.yaw_deg).pixels
    yield RuleFinding(
        "the target at the first frame", shown == 0, f"{shown} pixels", "0 pixels, as recorded", "visible_at_start"
    )


def seen(world: World, origin: Vec3, yaw_deg: float) -> Patch:
    """Return where the target is in the first picture of the first drone, level, the others of its fleet around it."""
    place, turned = world.target_pose(0.0)
    past = world.past(world.fleet.others(0).values())
    return patch(world.target, place, turned, past, origin, level(yaw_deg), CAMERA)


def way(world: World) -> RuleFinding:
    """Return whether a drone may fly straight at the target, as far as the radius of success."""
    start, goal = world.record.starts[0].position_ned, world.target_centre(0.0)
    span = math.dist(start, goal)
    clear = max(span - RADIUS_M, 0.0)
    worst = math.inf
    for along in np.linspace(0.0, clear, min(max(2, math.ceil(clear / STEP_M) + 1), MOST_STEPS)):
        u = float(along) / max(span, 1e-9)
        point = (
            start[0] + u * (goal[0] - start[0]),
            start[1] + u * (goal[1] - start[1]),
            start[2] + u * (goal[2] - start[2]),
        )
        worst = min(worst, world.clearance_m(point))
    return at_least("the room around the straight way to the target", worst, BODY_M, "m")


def bearing_deg(origin: Vec3, goal: Vec3) -> float:
    """Return the compass bearing of a goal, 0 … 360."""
    return math.degrees(math.atan2(goal[1] - origin[1], goal[0] - origin[0])) % 360.0
