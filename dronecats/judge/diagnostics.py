"""What the logs say beside the verdict. None of it enters the verdict. Paper, "Metrics"; table in docs/run-folder.md.

Poses and frames of a drone are samples of the same truth. Each holds until the next, or tells nothing of what follows
when that is more than GAP_S later.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import pairwise
from operator import attrgetter
from typing import Any, NamedTuple, TypeVar

from foundation.protocol import CAP_S, POSE_PERIOD_S, RADIUS_M, ROTATE
from foundation.run_folder.reading import Logs
from foundation.run_folder.results import Diagnostics
from foundation.run_folder.rows import Decision, FrameTruth, Pose

GAP_S = 1.5 * POSE_PERIOD_S  # s between samples beyond which one of the trace is missing
ASKED_DEG = 90.0  # either way: no further is a pilot asked to turn in one step

Sample = Pose | FrameTruth
Kind = TypeVar("Kind", bound=Sample)


class Stretch(NamedTuple):
    """A time that a sample speaks for."""

    begins: float  # s
    ends: float  # s
    sample: Sample


def of_drones(logs: Logs, delta_m: float = RADIUS_M, cap_s: float = CAP_S) -> dict[int, Diagnostics]:
    """Return the diagnostics of every drone of which anything was measured, by its number."""
    samples, poses, ended_s = _samples(logs, cap_s)
    return {
        drone: _of_drone(_of(samples, drone), _of(poses, drone), ended_s, delta_m)
        for drone in sorted({row.drone for row in samples})
    }


def hold(logs: Logs, delta_m: float = RADIUS_M, cap_s: float = CAP_S) -> float | None:
    """Return the longest unbroken time (s) of a drone within delta with the target in view; None: not measured."""
    samples, _, ended_s = _samples(logs, cap_s)
    drones = {row.drone for row in samples}
    return max((longest_hold(stretches(_of(samples, drone), ended_s), delta_m) for drone in drones), default=None)


def _samples(logs: Logs, cap_s: float) -> tuple[list[Sample], list[Pose], float]:
    """Return all that something was measured at until the cap, the poses, and when the episode ended (s)."""
    acted = {(d.drone, d.frame_id) for d in logs.decisions if d.t_decided <= cap_s}
    frames = [row for key, row in logs.frames.items() if row.t <= cap_s or key in acted]
    poses = [pose for pose in logs.poses if pose.t <= cap_s]
    samples: list[Sample] = [*poses, *frames]  # in this order, which stays that of one instant
    told = [row for row in samples if row.distance_m is not None or row.visible is not None]
    last_s = max((row.t for row in told), default=0.0)
    return told, poses, min(cap_s, max(last_s, logs.end.t if logs.end else 0.0))


def of_fleet(drones: Mapping[int, Diagnostics]) -> Diagnostics | None:
    """Return the diagnostics of an episode: of each what the best drone did, and the paths added up.

    The criterion wants one drone to arrive, and so do these. None when nothing was measured.
    """
    if not drones:
        return None
    each = list(drones.values())
    return Diagnostics(
        min_distance_m=min(_known(d.min_distance_m for d in each), default=None),
        start_distance_m=min(_known(d.start_distance_m for d in each), default=None),
        approach_ratio=max(_known(d.approach_ratio for d in each), default=None),
        oracle_success=max(_known(d.oracle_success for d in each), default=None),
        first_seen_s=min(_known(d.first_seen_s for d in each), default=None),
        dwell_s=max(_known(d.dwell_s for d in each), default=None),
        longest_loss_s=min(_known(d.longest_loss_s for d in each), default=None),
        path_m=round(sum(d.path_m for d in each), 3),
        flown_s=max(d.flown_s for d in each),
        untraced_s=max(d.untraced_s for d in each),
    )


def wide_rotations(decisions: Iterable[Decision], cap_s: float = CAP_S) -> int:
    """Return how many turns within the cap were of more than the ±90° that the prompt asks for. They are flown."""
    turns = [d.action for d in decisions if d.action and d.kind == ROTATE and d.t_decided <= cap_s]
    angles = [turn.get("angle_deg") for turn in turns]
    return sum(isinstance(angle, int | float) and abs(angle) > ASKED_DEG for angle in angles)


def dwell(stretches: Iterable[Stretch], delta_m: float) -> float:
    """Return the seconds within delta with the target in view."""
    return sum(s.ends - s.begins for s in stretches if s.sample.visible and _within(s.sample, delta_m))


def longest_hold(stretches: Iterable[Stretch], delta_m: float) -> float:
    """Return the longest unbroken time in seconds within delta with the target in view; a gap in the trace ends it."""
    longest, begins, ends = 0.0, 0.0, -1.0
    for stretch in stretches:
        if not (stretch.sample.visible and _within(stretch.sample, delta_m)):
            ends = -1.0
            continue
        begins = begins if stretch.begins == ends else stretch.begins
        ends = stretch.ends
        longest = max(longest, ends - begins)
    return longest


def longest_loss(stretches: Iterable[Stretch]) -> float:
    """Return the longest time in seconds without the target in view; a gap in the trace ends it."""
    longest, begins, ends = 0.0, 0.0, -1.0
    for stretch in stretches:
        if stretch.sample.visible is not False:
            ends = -1.0
            continue
        begins = begins if stretch.begins == ends else stretch.begins
        ends = stretch.ends
        longest = max(longest, ends - begins)
    return longest


def path(poses: Sequence[Pose]) -> float:
    """Return the metres along poses in the order of their times, gaps left out."""
    return sum(math.dist(a.position_ned, b.position_ned) for a, b in pairwise(poses) if b.t - a.t <= GAP_S)


def stretches(samples: Sequence[Sample], ended_s: float) -> Iterator[Stretch]:
    """Yield what samples in the order of their times speak for, from 0 to `ended_s`, gaps left out.

    The first speaks for the time before it as well, where that is no gap.
    """
    first, last = samples[0], samples[-1]
    times = [(0.0, first.t, first), *((a.t, b.t, a) for a, b in pairwise(samples)), (last.t, ended_s, last)]
    for begins, ends, sample in times:
        begin, end = begins if begins > 0.0 else 0.0, ends if ends < ended_s else ended_s
        if ends - begins <= GAP_S and end > begin:
            yield Stretch(begin, end, sample)


def _of_drone(samples: Sequence[Sample], poses: Sequence[Pose], ended_s: float, delta_m: float) -> Diagnostics:
    distances = [s.distance_m for s in samples if s.distance_m is not None]
    seen = [s.t for s in samples if s.visible]
    looked = any(s.visible is not None for s in samples)
    spoken = list(stretches(samples, ended_s))
    nearest, start = min(distances, default=None), distances[0] if distances else None
    return Diagnostics(
        min_distance_m=nearest,
        start_distance_m=start,
        approach_ratio=round(1.0 - nearest / start, 4) if start and nearest is not None else None,
        oracle_success=None if nearest is None else nearest <= delta_m,
        first_seen_s=min(seen, default=None),
        dwell_s=round(dwell(spoken, delta_m), 3) if looked and distances else None,
        longest_loss_s=round(longest_loss(spoken), 3) if looked else None,
        path_m=round(path(poses), 3),
        flown_s=samples[-1].t,
        untraced_s=round(ended_s - sum(s.ends - s.begins for s in spoken), 3),
    )


def _of(rows: Iterable[Kind], drone: int) -> list[Kind]:
    """Return one drone's rows in the order of their times; at one instant the frame, which was judged, stays last."""
    return sorted((row for row in rows if row.drone == drone), key=attrgetter("t"))


def _within(sample: Sample, delta_m: float) -> bool:
    return sample.distance_m is not None and sample.distance_m <= delta_m


def _known(values: Iterable[Any]) -> list[Any]:
    return [value for value in values if value is not None]
