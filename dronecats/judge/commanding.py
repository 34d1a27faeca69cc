"""Computes diagnostics of a fleet's commands: identical points, spread of the places, and approached candidates.

Source: paper, "Commanding Several Drones". The diagnostics do not affect the verdict. A `go` commands a drone to a
point of a camera frame at a depth. A place is the 3-D position of that point. It is computed from the true position,
heading and camera pitch at the frame, for the benchmark's camera on a level drone.
"""

import itertools
import math
import statistics
from collections.abc import Mapping, Sequence

from msgspec import UNSET

from foundation.camera import CameraModel
from foundation.frames import Vec3
from foundation.protocol import CAP_S, POINT_SPAN, STRIDE_MAX_M
from foundation.run_folder.reading import Logs
from foundation.run_folder.results import CommandedStep, CommandingDiagnostics
from foundation.run_folder.rows import Decision, FrameTruth, PointedGo

COMMANDING = "commanding"  # the cell (kind of episode) that these diagnostics are for
_CAMERA = CameraModel()
_FOCAL_PX = _CAMERA.focal_px


def commanding(logs: Logs, cap_s: float = CAP_S) -> CommandingDiagnostics | None:
    """Return the diagnostics of a commanding episode, for its decisions until `cap_s`.

    The candidates are the target and the record's other candidates. Return None for other episodes, without truth, and
    if the position of a candidate is unknown.
    """
    record = logs.record
    if record is None or record.cell != COMMANDING or not logs.true:
        return None
    candidates = [c.position_ned for c in (record.target, *record.candidates) if c.position_ned is not None]
    if len(candidates) < 1 + len(record.candidates):
        return None
    acted = sorted((d for d in logs.decisions if d.t_decided <= cap_s), key=lambda d: (d.step, d.drone))
    steps = [
        _step(step, list(decisions), logs.frames, candidates)
        for step, decisions in itertools.groupby(acted, lambda d: d.step)
    ]
    all_go = [step for step in steps if step.identical_point is not None]
    identical = sum(step.identical_point is True for step in all_go)
    spreads = [step.spread_m for step in steps if step.spread_m is not None]
    return CommandingDiagnostics(
        all_go_steps=len(all_go),
        identical_points=identical,
        identical_share=round(identical / len(all_go), 4) if all_go else None,
        one_candidate=sum(len(set(step.nears)) == 1 and step.nears[0] is not None for step in all_go),
        candidates_neared=len({near for step in steps for near in step.nears if near is not None}),
        spread_m=round(statistics.median(spreads), 3) if spreads else None,
        steps=tuple(steps),
    )


def _step(
    step: int, decisions: Sequence[Decision], frames: Mapping[tuple[int, int], FrameTruth], candidates: Sequence[Vec3]
) -> CommandedStep:
    gos = [decision.go for decision in decisions]
    seen = [frames.get((decision.drone, decision.frame_id)) for decision in decisions]
    places = [place(go, frame) if go and frame else None for go, frame in zip(gos, seen, strict=True)]
    sent = [p for p in places if p is not None]
    points = {(go.x, go.y) for go in gos if go}
    return CommandedStep(
        step=step,
        drones=tuple(decision.drone for decision in decisions),
        identical_point=len(points) == 1 if len(gos) > 1 and None not in gos else None,
        spread_m=round(spread(sent), 3) if len(sent) > 1 else None,
        places_ned=tuple(None if p is None else (round(p[0], 3), round(p[1], 3), round(p[2], 3)) for p in places),
        nears=tuple(
            nears(frame.position_ned, p, candidates) if frame and frame.position_ned and p else None
            for frame, p in zip(seen, places, strict=True)
        ),
    )


def place(go: PointedGo, frame: FrameTruth) -> Vec3 | None:
    """Return the place (m, NED) of a go's point at the go's depth; None if the pose at the frame is unknown."""
    if frame.position_ned is None or frame.yaw_deg is None:
        return None
    ahead, aside, below = _CAMERA.offset_frd
    right_m = (go.x / POINT_SPAN - 0.5) * _CAMERA.width / _FOCAL_PX * go.depth_m + aside
    under_m = (go.y / POINT_SPAN - 0.5) * _CAMERA.height / _FOCAL_PX * go.depth_m
    pitch = math.radians(frame.camera_pitch_deg) if frame.camera_pitch_deg is not UNSET else 0.0
    forward_m = go.depth_m * math.cos(pitch) + under_m * math.sin(pitch) + ahead
    down_m, yaw = under_m * math.cos(pitch) - go.depth_m * math.sin(pitch) + below, math.radians(frame.yaw_deg)
    north, east, down = frame.position_ned
    return (
        north + forward_m * math.cos(yaw) - right_m * math.sin(yaw),
        east + forward_m * math.sin(yaw) + right_m * math.cos(yaw),
        down + down_m,
    )


def spread(places: Sequence[Vec3]) -> float:
    """Return the mean distance (m) over all pairs of places."""
    return statistics.fmean(math.dist(a, b) for a, b in itertools.combinations(places, 2))


def nears(here: Vec3, there: Vec3, candidates: Sequence[Vec3]) -> int | None:
    """Return the index of the candidate that a stride from `here` towards `there` approaches most, horizontally.

    A stride ends at `there`, but after 3 m at most. Return None if the stride approaches no candidate.
    """
    way_m = math.dist(here[:2], there[:2])
    if way_m == 0.0:
        return None
    part = min(1.0, STRIDE_MAX_M / way_m)
    after = (here[0] + part * (there[0] - here[0]), here[1] + part * (there[1] - here[1]))
    closed = [math.dist(here[:2], candidate[:2]) - math.dist(after, candidate[:2]) for candidate in candidates]
    best = max(range(len(closed)), key=closed.__getitem__)
    return best if closed[best] > 0.0 else None


def commanding_sentence(diagnostics: CommandingDiagnostics) -> str:
    apart = "" if diagnostics.spread_m is None else f"; commanded places {diagnostics.spread_m:.1f} m apart (median)"
    return (
        f"commanded: one point for all drones on {diagnostics.identical_points} of the {diagnostics.all_go_steps}"
        f" steps with a go for every drone; candidates approached: {diagnostics.candidates_neared}{apart}"
    )
