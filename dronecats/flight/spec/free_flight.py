"""A map to fly in without an episode: a record with a start and an instruction, and nothing that is judged."""

import math

from episodes import maps
from episodes.records.record import VERSION, EpisodeRecord, StartPose, TargetRecord
from foundation.errors import UsageError

HEIGHT_M = 2.5  # of the start over the map's spawn: PX4's MIS_TAKEOFF_ALT


def free_flight(name: str, instruction: str) -> EpisodeRecord:
    """Return a record of a map, beginning over its spawn. Raises UsageError for an unknown map.

    A record cannot be without a target, so some thing of the map itself is named as one: the picture stays the map's.
    """
    scene = maps.build(name)
    spawn, yaw = scene.spawn_ned, scene.spawn_yaw
    things = [i for i in scene.instances if i.kind != "ground" and i.solid and not i.movable]
    if not things:
        raise UsageError(f"map '{name}' has nothing on it but its ground, and an empty field cannot be flown by sight")
    thing = min(things, key=lambda i: math.dist(i.position_ned, spawn))
    north, east, down = (a - b for a, b in zip(thing.position_ned, spawn, strict=True))
    return EpisodeRecord(
        version=VERSION,
        id=f"free-{name}",
        map=name,
        map_seed=1,
        cell="approaching",
        instruction=instruction,
        target=TargetRecord(
            thing.kind, position_ned=thing.position_ned, yaw_deg=math.degrees(thing.yaw), native=thing.name
        ),
        starts=(StartPose((spawn[0], spawn[1], spawn[2] - HEIGHT_M), math.degrees(yaw)),),
        start_distance_m=math.hypot(north, east, down + HEIGHT_M),
        bearing_deg=math.degrees(math.atan2(east, north)) % 360.0,
        visible_at_start=True,
        seed=0,
    )
