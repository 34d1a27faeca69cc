"""Which flights did not move at all, and are flown once more. Paper, appendix "Additional Results".

The paper's "pose track under 5 m" is of a vehicle that stands still when it hovers. Ours wanders, on its estimates,
over some 10 m of track in 300 s without leaving the spot, so steps shorter than half a metre are none of the track's.
"""

import math
from collections.abc import Iterable, Iterator
from pathlib import Path

from foundation.run_folder.reading import truth
from foundation.run_folder.rows import Pose

STUCK_M = 5.0  # m of track, under which a drone has not moved
STEP_M = 0.5  # m, a step of the track; a hover's wander is shorter, and the shortest stride is more than twice as long


def tracks_m(poses: Iterable[Pose]) -> Iterator[float]:
    """Yield how long the track of a pose's drone has become, m, for each pose."""
    places: dict[int, tuple[float, float, float]] = {}  # where the last step of each ended
    tracks: dict[int, float] = {}
    for pose in poses:
        step_m = math.dist(places.setdefault(pose.drone, pose.position_ned), pose.position_ned)
        if step_m >= STEP_M:
            tracks[pose.drone] = tracks.get(pose.drone, 0.0) + step_m
            places[pose.drone] = pose.position_ned
        yield tracks.get(pose.drone, 0.0)


def track_m(poses: Iterable[Pose]) -> float | None:
    """Return the longest track (m) of a fleet's drones; None without a pose."""
    return max(tracks_m(poses), default=None)


def is_stuck(poses: Iterable[Pose]) -> bool:
    """Return whether no drone of a flight moved; of one without a trace nobody knows. Stops where that is known."""
    known = False
    for track in tracks_m(poses):
        known = True
        if track >= STUCK_M:
            return False
    return known


def poses_of(folder: Path) -> Iterator[Pose]:
    """Yield the true poses of the flight in an episode folder. Raises UsageError for a damaged log."""
    return (row for row in truth(folder) if isinstance(row, Pose))
