"""What an editor proposes where nothing has been chosen yet: a path, an inscription, an instruction."""

import itertools
import math

from dronecats.view.editor import drape
from dronecats.view.editor.drape import Knot, Knots
from episodes import maps
from episodes.authoring.check.nouns import nouns
from episodes.maps.scene import Scene
from episodes.records.record import HIDDEN, MOVING, EpisodeRecord
from foundation.errors import UsageError

LANE_OFF_M = 0.25  # a proposed path may cut a lane's corners by so much, and has few points to drag for it


def way(scene: Scene, record: EpisodeRecord, here: Knot, yaw: float, length_m: float) -> Knots:
    """Return a first path: the long enough lane that begins nearest, or straight ahead to the end of the ground."""
    try:
        lanes = [one for one in maps.places(record.map, record.map_seed).lanes if one.length_m >= length_m]
    except UsageError:  # a user's map lists none
        lanes = []
    if lanes:
        nearest = min(lanes, key=lambda one: math.dist(one.waypoints_ned[0][:2], here))
        return drape.corners([(n, e) for n, e, _ in nearest.waypoints_ned], LANE_OFF_M)
    field = scene.terrain
    low = (field.origin_north, field.origin_east)
    high = tuple(low[k] + field.cell_m * (field.down.shape[k] - 1) for k in (0, 1))
    ahead = (math.cos(yaw), math.sin(yaw))
    room = [((high if ahead[k] > 0 else low)[k] - here[k]) / ahead[k] for k in (0, 1) if abs(ahead[k]) > 1e-6]
    reach = max(min(length_m, *room), 1.0)
    return (here, (here[0] + reach * ahead[0], here[1] + reach * ahead[1]))


def inscription(taken: set[str | None]) -> str:
    """Return the first inscription that nothing bears yet."""
    return next(text for k in itertools.count() if (text := f"DC {1000 + 111 * k}") not in taken)


def instruction(record: EpisodeRecord) -> str:
    """Return an instruction that names the target."""
    target, noun = record.target, nouns(record.target.asset)[0]
    if record.cell == "commanding":
        mark = "that says" if target.asset == "sign" else "with the plate"
        return f"go to the {noun} {mark} {target.inscription}"
    verb = "follow" if record.cell in MOVING else "go to"
    if record.cell in HIDDEN:
        verb = "find and follow" if record.cell in MOVING else "find and go to"
    return f"{verb} the {noun}" if target.paint is None else f"{verb} the {target.paint} {noun}"
