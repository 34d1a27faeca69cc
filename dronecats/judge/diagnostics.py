"""Computes the diagnostics of an episode: trace, contacts, estimator resets, delays, and estimated distances.

No diagnostic affects the verdict. Source: paper, "Metrics"; table in docs/run-folder.md. The logged poses and frames of
a drone are samples of the true state. A sample holds until the next sample. If the next sample is more than GAP_S
later, the time between both is a gap, for which no sample holds.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import pairwise
from operator import attrgetter
from typing import Any, NamedTuple, TypeVar

from msgspec import UNSET

from dronecats.judge.verdict import declaring_decisions
from foundation.protocol import CAP_S, POSE_PERIOD_S, RADIUS_M, ROTATE
from foundation.run_folder.reading import Estimate, Logs
from foundation.run_folder.results import Contacts, DecidedNear, Diagnostics, Distances, Nearness
from foundation.run_folder.rows import Clear, Decision, EstimatedFrame, EstimatedPose, FrameTruth, Hit, Pose, Reset
from foundation.run_folder.writing import as_json

GAP_S = 1.5 * POSE_PERIOD_S  # s; samples that are farther apart have a gap between them
TURN_MAX_DEG = 90.0  # largest rotation to either side that the prompt allows

Sample = Pose | FrameTruth
Kind = TypeVar("Kind", bound=Sample)


class Stretch(NamedTuple):
    """A time span for which a sample holds."""

    begins: float  # s
    ends: float  # s
    sample: Sample


def drone_diagnostics(logs: Logs, delta_m: float = RADIUS_M, cap_s: float = CAP_S) -> dict[int, Diagnostics]:
    """Return the diagnostics of every measured drone, by its number. `delta_m`: success radius."""
    samples, poses, ended_s = _samples(logs, cap_s)
    return {
        drone: _drone_diagnostics(_of(samples, drone), _of(poses, drone), ended_s, delta_m)
        for drone in sorted({row.drone for row in samples})
    }


def hold_s(logs: Logs, delta_m: float = RADIUS_M, cap_s: float = CAP_S) -> float | None:
    """Return the longest unbroken time (s) of a drone within `delta_m` of a visible target; None: not measured."""
    samples, _, ended_s = _samples(logs, cap_s)
    drones = {row.drone for row in samples}
    return max((longest_hold(stretches(_of(samples, drone), ended_s), delta_m) for drone in drones), default=None)


def _samples(logs: Logs, cap_s: float) -> tuple[list[Sample], list[Pose], float]:
    """Return the measured samples and the poses until the cap, and the end of the episode (s)."""
    acted = {(d.drone, d.frame_id) for d in logs.decisions if d.t_decided <= cap_s}
    frames = [row for key, row in logs.frames.items() if row.t <= cap_s or key in acted]
    poses = [pose for pose in logs.poses if pose.t <= cap_s]
    samples: list[Sample] = [*poses, *frames]  # poses first: at equal times the frame is last, so its values hold
    measured = [row for row in samples if row.distance_m is not None or row.visible is not None]
    last_s = max((row.t for row in measured), default=0.0)
    return measured, poses, min(cap_s, max(last_s, logs.end.t if logs.end else 0.0))


BEST_IF_SMALL = ("min_distance_m", "start_distance_m", "first_seen_s", "longest_loss_s")
BEST_IF_LARGE = ("approach_ratio", "oracle_success", "dwell_s")


def fleet_diagnostics(drones: Mapping[int, Diagnostics]) -> Diagnostics | None:
    """Return the diagnostics of an episode; None if nothing was measured.

    Each value is the best value of all drones, because one drone is enough for success. Exceptions: the paths are
    summed, and `flown_s` and `untraced_s` are the largest values of all drones.
    """
    if not drones:
        return None

    def known(name: str) -> list[Any]:
        return [value for d in drones.values() if (value := getattr(d, name)) is not None]

    return Diagnostics(
        **{name: min(known(name), default=None) for name in BEST_IF_SMALL},
        **{name: max(known(name), default=None) for name in BEST_IF_LARGE},
        path_m=round(sum(d.path_m for d in drones.values()), 3),
        flown_s=max(d.flown_s for d in drones.values()),
        untraced_s=max(d.untraced_s for d in drones.values()),
    )


def wide_rotations(decisions: Iterable[Decision], cap_s: float = CAP_S) -> int:
    """Return the number of rotations within the cap that exceed the ±90° of the prompt. Drones still fly them."""
    return sum(is_wide_rotation(d) is True for d in decisions if d.t_decided <= cap_s)


def is_wide_rotation(decision: Decision) -> bool | None:
    """Return whether a rotation is beyond the ±90° of the prompt; None for other actions."""
    if decision.kind != ROTATE or decision.action is None:
        return None
    angle_deg = decision.action.get("angle_deg")
    return abs(angle_deg) > TURN_MAX_DEG if isinstance(angle_deg, int | float) else None


def dwell(stretches: Iterable[Stretch], delta_m: float) -> float:
    """Return the seconds within `delta_m` of the target with the target in view."""
    return sum(s.ends - s.begins for s in stretches if s.sample.visible and _within(s.sample, delta_m))


def longest_hold(stretches: Iterable[Stretch], delta_m: float) -> float:
    """Return the longest unbroken time (s) that `dwell` counts. A gap between samples ends such a time."""
    return _longest(s for s in stretches if s.sample.visible and _within(s.sample, delta_m))


def longest_loss(stretches: Iterable[Stretch]) -> float:
    """Return the longest time (s) without the target in view. A gap between samples ends such a time."""
    return _longest(s for s in stretches if s.sample.visible is False)


def _longest(stretches: Iterable[Stretch]) -> float:
    """Return the longest time (s) of consecutive stretches."""
    longest, begins, ends = 0.0, 0.0, -1.0
    for stretch in stretches:
        begins = begins if stretch.begins == ends else stretch.begins
        ends = stretch.ends
        longest = max(longest, ends - begins)
    return longest


def path(poses: Sequence[Pose]) -> float:
    """Return the length (m) of the path along poses in the order of their times. Movements across gaps do not count."""
    return sum(math.dist(a.position_ned, b.position_ned) for a, b in pairwise(poses) if b.t - a.t <= GAP_S)


def stretches(samples: Sequence[Sample], ended_s: float) -> Iterator[Stretch]:
    """Yield the stretches from 0 to `ended_s`; gaps are left out. `samples`: at least one, in the order of time.

    The first sample also holds for the time before it, unless that time is longer than GAP_S.
    """
    first, last = samples[0], samples[-1]
    times = [(0.0, first.t, first), *((a.t, b.t, a) for a, b in pairwise(samples)), (last.t, ended_s, last)]
    for begins, ends, sample in times:
        begin, end = begins if begins > 0.0 else 0.0, ends if ends < ended_s else ended_s
        if ends - begins <= GAP_S and end > begin:
            yield Stretch(begin, end, sample)


def _drone_diagnostics(samples: Sequence[Sample], poses: Sequence[Pose], ended_s: float, delta_m: float) -> Diagnostics:
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
    """Return a drone's rows in the order of their times. Rows with equal times keep their order in `rows`."""
    return sorted((row for row in rows if row.drone == drone), key=attrgetter("t"))


def _within(sample: Sample, delta_m: float) -> bool:
    return sample.distance_m is not None and sample.distance_m <= delta_m


# s of wall time × speed; a step with a longer delay counts as delayed by the host (the flight's computer). The value is
# a tenth of a move (2.5 s), or five setpoints at 20 Hz. In this time a target at walking pace moves 0.35 m.
STALL_S = 0.25


def host_stalls(decisions: Iterable[Decision]) -> int:
    """Return the number of steps that the host delayed: the simulator fell behind, or a picture was late."""
    return len({decision.step for decision in decisions if delayed(decision)})


def delayed(decision: Decision) -> bool:
    """Return whether the host delayed the step of a decision; False without data of the host."""
    delays_s = (decision.host_lag_s, decision.frame_wait_s)
    return any(isinstance(delay_s, float) and delay_s > STALL_S for delay_s in delays_s)


def hits_of(logs: Logs, cap_s: float) -> list[Hit] | None:
    """Return the hits within the cap; None if hits were not logged."""
    written = logs.begin is not None and logs.begin.contacts is True
    return [hit for hit in logs.hits if hit.t <= cap_s] if written else None


def resets_of(logs: Logs, cap_s: float) -> list[Reset] | None:
    """Return the estimator resets within the cap; None if the autopilot did not send the counter."""
    written = logs.begin is not None and logs.begin.resets is True
    return [reset for reset in logs.resets if reset.t <= cap_s] if written else None


def contacts(logs: Logs, cap_s: float) -> Contacts | None:
    """Return the contacts of the drones; None if hits were not logged."""
    hits = hits_of(logs, cap_s)
    if hits is None:
        return None
    return Contacts(
        hits=len(hits),
        crashes=sum(hit.crash for hit in hits),
        hardest_hit_mps=max((hit.closing_speed for hit in hits if hit.closing_speed is not None), default=None),
        contact_s=_contact_s(logs, hits, cap_s),
    )


def estimator_resets(logs: Logs, cap_s: float) -> int | None:
    """Return the number of estimator resets of all drones; None if the autopilot did not send the counter."""
    resets = resets_of(logs, cap_s)
    return None if resets is None else sum(reset.count for reset in resets)


def _contact_s(logs: Logs, hits: list[Hit], cap_s: float) -> float:
    """Return the seconds in contact, summed over all drones. A contact without an end lasts until the episode ends."""
    total, open_since = 0.0, dict[int, float]()
    rows: list[Hit | Clear] = [*hits, *logs.clears]
    for row in sorted(rows, key=lambda row: row.t):
        if isinstance(row, Hit):
            open_since.setdefault(row.drone, row.t)
        elif (since := open_since.pop(row.drone, None)) is not None:
            total += min(row.contact_s, cap_s - since)
    end_s = min(cap_s, logs.end.t if logs.end else cap_s)
    return round(total + sum(max(end_s - since, 0.0) for since in open_since.values()), 2)


SURE = 2.0  # standard deviations; a larger margin to the radius counts as certain


def distances(logs: Logs, delta_m: float = RADIUS_M, cap_s: float = CAP_S) -> Distances | None:
    """Return the estimated distances to a surveyed target, for a flight without truth; None without estimate or target.

    The distances never show a success, because a success needs the target in view. `within` is known only if SURE
    standard deviations lie between the distance and the radius; otherwise `within` is None (open).
    """
    estimate = logs.estimate
    if estimate is None or estimate.head.target is None:
        return None
    by_distance = [(p.distance_m, p) for p in estimate.poses if p.t <= cap_s and p.distance_m is not None]
    by_distance.sort(key=lambda pair: pair[1].t)
    acted = [d for d in logs.decisions if d.t_decided <= cap_s]
    nearest = min(by_distance, key=lambda pair: pair[0], default=None)
    return Distances(
        source=None if estimate.head.source is UNSET else estimate.head.source,
        target=estimate.head.target,
        closest=_nearness(nearest[1], delta_m) if nearest else None,
        last_action=_decided_near(acted[-1], estimate, delta_m) if acted else None,
        declarations=tuple(
            _decided_near(d, estimate, delta_m) for d in declaring_decisions(logs) if d.t_decided <= cap_s
        ),
        dwell_s=round(_estimated_dwell([(p.t, distance_m) for distance_m, p in by_distance], delta_m), 3),
    )


def _estimated_dwell(trace: Sequence[tuple[float, float]], delta_m: float) -> float:
    """Return the seconds within the radius, in view or not. `trace`: (t in s, distance in m) in the order of time."""
    near = [after - t for (t, distance_m), (after, _) in pairwise(trace) if distance_m <= delta_m]
    return sum(seconds for seconds in near if seconds <= GAP_S)


def _decided_near(decision: Decision, estimate: Estimate, delta_m: float) -> DecidedNear:
    frame = estimate.frames.get((decision.drone, decision.frame_id))
    near = _nearness(frame, delta_m) if frame else Nearness(t=None, distance_m=None, std_m=None, within=None)
    return DecidedNear(step=decision.step, drone=decision.drone, **{**as_json(near), "t": decision.t_decided})


def _nearness(row: EstimatedPose | EstimatedFrame, delta_m: float) -> Nearness:
    """Return distance, standard deviation, and whether the distance is within the radius (None: open)."""
    distance_m, std_m = row.distance_m, row.distance_std_m
    within = None
    if distance_m is not None and std_m is not None:
        is_within, is_outside = distance_m + SURE * std_m <= delta_m, distance_m - SURE * std_m > delta_m
        within = True if is_within else False if is_outside else None
    return Nearness(t=row.t, distance_m=distance_m, std_m=std_m, within=within)


def distances_sentence(distances: Distances, delta_m: float) -> str:
    """Return the distances in a sentence, which never states a success."""
    clauses = []
    if distances.closest:
        clauses.append(f"closest {_distance_text(distances.closest)} at {distances.closest.t:.1f} s")
    declared = distances.declarations
    clauses.append(f"declared {_declaration_text(declared[0], delta_m)}" if declared else "never declared")
    measured = [(d.distance_m, d) for d in declared if d.distance_m is not None]
    nearest = min(measured, key=lambda pair: pair[0], default=None)
    if len(declared) > 1:
        closest = f", the nearest {_declaration_text(nearest[1], delta_m)}" if nearest else ""
        clauses.append(f"{len(declared)} declarations{closest}")
    plane = (
        "; horizontal distances, because the target has no altitude"
        if distances.target.get("altitude_m") is None
        else ""
    )
    return f"DISTANCE ONLY: {'; '.join(clauses)}{plane}; it was not measured whether the target was in view"


def _declaration_text(declared: DecidedNear, delta_m: float) -> str:
    within = {True: f"within {delta_m:g} m", False: f"not within {delta_m:g} m", None: f"within {delta_m:g} m or not"}
    return f"at {declared.t:.1f} s, {_distance_text(declared)} away, {within[declared.within]}"


def _distance_text(near: Nearness) -> str:
    if near.distance_m is None:
        return "an unknown distance"
    give_or_take = "?" if near.std_m is None else f"{near.std_m:.2f}"
    return f"{near.distance_m:.2f} ± {give_or_take} m"
