"""Where the target stands and goes: on the ground, through nothing, and on for the whole episode."""

import itertools
import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from episodes.authoring.check.finding import RuleFinding, at_least, at_most
from episodes.authoring.check.limits import OF_OTHER_MAPS, OFF_GROUND_M, RULES, START_TO_PATH_M, WHEEL_OFF_M
from episodes.authoring.check.solid import StandingObstacles, box_of
from episodes.world.target import TargetMotion, has_wheels, motion
from episodes.world.visibility import turn
from episodes.world.wheels import contact_patch
from episodes.world.world import World
from foundation.protocol import CAP_S

GROUND_STEP_M = 0.1
SWEEP_STEP_M = 0.25
MOST_SWEEPS = 1500  # of a target that covers half a kilometre, the steps are longer
MARGIN_M = 0.05  # kept to everything by what stands or passes
LIFT_M = 0.12  # kerbs and roots lower than this stop no wheel


def rules(world: World, standing: StandingObstacles) -> Iterator[RuleFinding]:
    """Yield the findings about the target's footing and its path."""
    record = world.record
    if record.target.native is not None:
        return
    yield from wheels(world)
    if record.target.path is None:
        (north, east, down), yaw = motion(record.target).pose(0.0)  # which is level: `wheels` is of how it leans
        off = abs(down - world.ground_down(north, east))
        yield at_most("the target's foot off the ground", off, OFF_GROUND_M, "m", 3)
        met = standing.met(box_of(world.target, (north, east, down), yaw, 0.0, LIFT_M), "target")
        yield RuleFinding("what the target stands in", not met, met or "nothing", "nothing")
        return
    yield off_ground(world)
    yield swept(world, standing)
    yield long_enough(world)
    yield from pace(world)
    here = record.starts[0].position_ned
    times = np.arange(0.0, CAP_S + 0.5, 1.0)
    nearest = min(math.dist(here, world.target_centre(float(t))) for t in times)
    yield at_least("the path's distance from the start", nearest, START_TO_PATH_M, "m")


def off_ground(world: World) -> RuleFinding:
    """Return whether the path, as far as the target comes and between its waypoints too, lies on the ground."""
    path = world.record.target.path
    if path is None:
        raise ValueError("the target stands still")
    worst, where, gone = 0.0, path.waypoints_ned[0], 0.0
    for a, b in itertools.pairwise(path.waypoints_ned):
        leg = math.dist(a, b)
        for u in np.linspace(0.0, 1.0, max(2, math.ceil(leg / GROUND_STEP_M) + 1)):
            if gone + u * leg > path.speed_mps * CAP_S + MARGIN_M:
                break  # farther than it comes
            n, e, d = (float(p + u * (q - p)) for p, q in zip(a, b, strict=True))
            off = abs(d - world.ground_down(n, e))
            if off > worst:
                worst, where = off, (n, e, d)
        gone += leg
    says = f"{worst:.3f} m at north {where[0]:.1f}, east {where[1]:.1f}"
    return RuleFinding("the path off the ground", worst <= OFF_GROUND_M, says, f"≤ {OFF_GROUND_M:g} m")


def wheels(world: World) -> Iterator[RuleFinding]:
    """Yield whether every wheel of what the record adds touches the ground, of a target that moves on its whole way."""
    way = motion(world.record.target)
    worst, where = -1.0, (0.0, 0.0, 0.0)
    for one in world.target_and_lookalikes:
        if not has_wheels(one.kind):
            continue
        poses = [(one.position_ned, one.turned)]
        if one.movable:
            poses = [world.target_pose(float(t)) for t in _sweep(way)]
        low = contact_patch(one.mesh)
        for place, turned in poses:
            for n, e, d in low @ turn(turned).T + np.array(place):
                off = abs(float(d) - world.ground_down(float(n), float(e)))
                if off > worst:
                    worst, where = off, (float(n), float(e), float(d))
    if worst >= 0.0:
        says = f"{worst:.3f} m at north {where[0]:.1f}, east {where[1]:.1f}"
        yield RuleFinding("how far a wheel is from the ground", worst <= WHEEL_OFF_M, says, f"≤ {WHEEL_OFF_M:g} m")


def swept(world: World, standing: StandingObstacles) -> RuleFinding:
    """Return whether the target's box, moved along its path, meets nothing that stands."""
    way = motion(world.record.target)
    for t in _sweep(way):
        place, yaw = way.pose(float(t))
        met = standing.met(box_of(world.target, place, yaw, MARGIN_M, LIFT_M))
        if met:
            says = f"{met}, after {t:.0f} s, at north {place[0]:.1f}, east {place[1]:.1f}"
            return RuleFinding("what the target meets on its path", False, says, "nothing")
    return RuleFinding("what the target meets on its path", True, "nothing", "nothing")


def _sweep(way: TargetMotion) -> NDArray[np.float64]:
    """Return the times (s) at which a target that moves is looked at on its way."""
    last = min(CAP_S, way.length_m / way.speed_mps)
    return np.linspace(0.0, last, min(max(2, math.ceil(last * way.speed_mps / SWEEP_STEP_M) + 1), MOST_SWEEPS))


def long_enough(world: World) -> RuleFinding:
    """Return whether the target is still on its way when the episode ends."""
    way = motion(world.record.target)
    least = way.speed_mps * CAP_S
    says = f"{way.length_m:.1f} m"
    return RuleFinding("the path's length", way.length_m > least, says, f"> {least:g} m, what it covers in {CAP_S:g} s")


def pace(world: World) -> Iterator[RuleFinding]:
    """Yield whether the target moves at its map's speed."""
    wanted = RULES.get(world.record.map, OF_OTHER_MAPS).speed_mps
    speed = motion(world.record.target).speed_mps
    if wanted is not None:
        yield RuleFinding("the target's speed", abs(speed - wanted) < 1e-9, f"{speed:g} m/s", f"{wanted:g} m/s")
