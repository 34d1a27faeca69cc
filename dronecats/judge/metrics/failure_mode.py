"""Finds the failure mode of a flight: the paper's modes and thresholds. Each scored episode has exactly one mode.

Source: paper, "Failure Taxonomy" and appendix "Additional Results". The paper does not say which mode counts if several
hold. Here the first mode of MODES that holds counts. After success, MODES has the order of the appendix, except for
"did not move", which the appendix counts as "timed out". "Did not move" is meant for simulation faults, so it holds
only if moves were commanded. It precedes the modes from "never grounded" on, which assume a moving drone.

For a fleet, "declared" and "arrived" need only one drone. The closed share of the distance and the share of steps with
the target ahead are the best drone's. A fleet oscillated if every drone oscillated. It did not move if no drone moved.

`dronecats bench` retries a "did not move" flight once. The paper's "pose track under 5 m" assumes a vehicle that hovers
without motion. The simulated vehicle follows its drifting estimate: a hover of 300 s makes a path of about 10 m. So
movements below half a metre are not part of the track.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Literal

from dronecats.judge.judged_flight import JudgedFlight
from dronecats.judge.metrics.outcomes import oracle_success
from foundation.protocol import BRAKE_M, NEAR_M, NEAR_SCALE, STRIDE_MAX_M
from foundation.run_folder.reading import truth
from foundation.run_folder.rows import Pose

FailureMode = Literal[
    "success", "declared", "arrived", "did not move", "never grounded", "oscillated", "never closed", "timed out"
]
HALF_FOV_DEG, GROUNDED = 45.0, 0.10  # half field of view; "never grounded": target ahead in a smaller share of steps
WANDERED, TURNED_DEG = 8.0, 720.0  # "oscillated": least ratio of path to net displacement; least sum of yaw changes
CLOSED = 0.30  # "never closed": a smaller share of the start distance was closed
STUCK_M = 5.0  # m of track; a drone with less did not move
STEP_M = 0.5  # m, least movement that counts: above the drift in a hover, below half of the shortest stride


def failure_mode(flight: JudgedFlight) -> FailureMode | None:
    """Return the first of MODES that holds; None for an unscored flight."""
    if not flight.scored:
        return None
    return next(mode for mode, (_, holds) in MODES.items() if holds(flight))


def share_ahead(flight: JudgedFlight) -> float | None:
    """Return the share of steps with the target within 45° of the nose, even if hidden; for a fleet, the best drone's.

    Steps without a logged bearing are omitted. None if no step has one.
    """
    ahead: dict[int, list[bool]] = {}
    for step in flight.steps:
        bearing_deg = step.truth.bearing_deg if step.truth else None
        if step.counts and bearing_deg is not None:
            ahead.setdefault(step.decision.drone, []).append(abs(bearing_deg) <= HALF_FOV_DEG)
    return max((sum(flags) / len(flags) for flags in ahead.values()), default=None)


def stride(depth_m: float) -> float:
    """Return the distance (m) that a drone flies for a go of this depth. Paper, "Executing go"."""
    if depth_m < BRAKE_M:
        return 0.0
    return min(depth_m, STRIDE_MAX_M) * (NEAR_SCALE if depth_m < NEAR_M else 1.0)


def tracks_m(poses: Iterable[Pose]) -> Iterator[float]:
    """Yield for each pose the length (m) of the drone's track so far: its path without movements below STEP_M."""
    places: dict[int, tuple[float, float, float]] = {}  # end of the last movement that counted, by drone
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
    """Return whether no drone of a flight moved; False without a trace. Stops at the first drone that moved."""
    has_pose = False
    for track in tracks_m(poses):
        has_pose = True
        if track >= STUCK_M:
            return False
    return has_pose


def poses_of(folder: Path) -> Iterator[Pose]:
    """Yield the true poses of the flight in an episode folder. Raises UsageError for a damaged log."""
    return (row for row in truth(folder) if isinstance(row, Pose))


def _did_not_move(flight: JudgedFlight) -> bool:
    commanded_m: dict[int, float] = {}
    for step in flight.steps:
        if step.counts and step.go:
            commanded_m[step.decision.drone] = commanded_m.get(step.decision.drone, 0.0) + stride(step.go.depth_m)
    stuck = is_stuck(pose for pose in flight.logs.poses if pose.t <= flight.cap_s)
    return stuck and max(commanded_m.values(), default=0.0) >= STUCK_M


def _never_grounded(flight: JudgedFlight) -> bool:
    share = share_ahead(flight)
    return share is not None and share < GROUNDED


def _oscillated(flight: JudgedFlight) -> bool:
    traces: dict[int, list[Pose]] = {}
    for pose in sorted(flight.logs.poses, key=lambda pose: pose.t):
        if pose.t <= flight.cap_s:
            traces.setdefault(pose.drone, []).append(pose)
    return bool(traces) and all(map(_wandered, traces.values()))


def _wandered(poses: Sequence[Pose]) -> bool:
    """Return whether the path of one drone is long and turns much, but ends near its start."""
    yaws = [pose.yaw_deg for pose in poses if pose.yaw_deg is not None]
    path_m = sum(math.dist(a.position_ned, b.position_ned) for a, b in pairwise(poses))
    turned_deg = sum(abs(math.remainder(b - a, 360.0)) for a, b in pairwise(yaws))
    net_m = math.dist(poses[0].position_ned, poses[-1].position_ned)
    return path_m > WANDERED * net_m and turned_deg >= TURNED_DEG


def _never_closed(flight: JudgedFlight) -> bool:
    closed = flight.verdict.diagnostics.approach_ratio if flight.verdict.diagnostics else None
    return closed is not None and closed < CLOSED


# in the order of precedence: mode → its condition in words, and as a function
MODES: dict[FailureMode, tuple[str, Callable[[JudgedFlight], bool]]] = {
    "success": ("a declaration qualifies", lambda flight: flight.verdict.outcome == "success"),
    "declared": ("declarations were made, and none qualifies", lambda flight: flight.verdict.declarations > 0),
    "arrived": ("a drone came within the radius, and no drone declared", lambda flight: oracle_success(flight) is True),
    "did not move": (
        "the track (the path without movements below 0.5 m) is under 5 m, "
        "although the commanded moves add up to 5 m or more",
        _did_not_move,
    ),
    "never grounded": ("the target was within 45° of the nose in fewer than 10 % of the steps", _never_grounded),
    "oscillated": (
        "the path is more than eight times as long as the distance from its start to its end, "
        "and the drone turned by 720° or more",
        _oscillated,
    ),
    "never closed": ("less than 30 % of the start distance was closed", _never_closed),
    "timed out": ("none of these", lambda flight: True),
}
