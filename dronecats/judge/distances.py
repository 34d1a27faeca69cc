"""What can be said of a flight whose truth nobody measured: how near it came, give or take. Never whether it succeeded.

A success wants the target in view, and nobody measured that. What is within the radius is so by two standard deviations
of the distance, or it is open.
"""

from collections.abc import Sequence
from itertools import pairwise

from msgspec import UNSET

from dronecats.judge.diagnostics import GAP_S
from dronecats.judge.verdict import finished
from foundation.protocol import CAP_S, RADIUS_M
from foundation.run_folder.reading import Estimate, Logs
from foundation.run_folder.results import DecidedNear, Distances, Nearness
from foundation.run_folder.rows import Decision, EstimatedFrame, EstimatedPose

SURE = 2.0  # standard deviations


def distances(logs: Logs, delta_m: float = RADIUS_M, cap_s: float = CAP_S) -> Distances | None:
    """Return the distances of an estimated flight to its surveyed target, None when there is no such estimate."""
    estimate = logs.estimate
    if estimate is None or estimate.head.target is None:
        return None
    told = [(p.distance_m, p) for p in estimate.poses if p.t <= cap_s and p.distance_m is not None]
    told.sort(key=lambda each: each[1].t)
    acted = [d for d in logs.decisions if d.t_decided <= cap_s]
    nearest = min(told, key=lambda each: each[0], default=None)
    return Distances(
        source=None if estimate.head.source is UNSET else estimate.head.source,
        target=estimate.head.target,
        closest=_told(nearest[1], delta_m) if nearest else None,
        last_action=_declared(acted[-1], estimate, delta_m) if acted else None,
        declarations=tuple(_declared(d, estimate, delta_m) for d in finished(logs) if d.t_decided <= cap_s),
        dwell_s=round(_dwell([(p.t, distance_m) for distance_m, p in told], delta_m), 3),
    )


def _dwell(told: Sequence[tuple[float, float]], delta_m: float) -> float:
    """Return the seconds within the radius, in view or not, of (t, distance) in the order of their times."""
    near = [after - t for (t, distance_m), (after, _) in pairwise(told) if distance_m <= delta_m]
    return sum(seconds for seconds in near if seconds <= GAP_S)


def _declared(decision: Decision, estimate: Estimate, delta_m: float) -> DecidedNear:
    """Return what is known of a decision at its own frame."""
    frame = estimate.frames.get((decision.drone, decision.frame_id))
    near = _told(frame, delta_m) if frame else Nearness(t=None, distance_m=None, std_m=None, within=None)
    return DecidedNear(
        step=decision.step,
        drone=decision.drone,
        t=decision.t_decided,
        distance_m=near.distance_m,
        std_m=near.std_m,
        within=near.within,
    )


def _told(row: EstimatedPose | EstimatedFrame, delta_m: float) -> Nearness:
    """Return distance, standard deviation and whether it is within the radius: True, False, or None, which is open."""
    distance_m, std_m = row.distance_m, row.distance_std_m
    within = None
    if distance_m is not None and std_m is not None:
        within = (
            True if distance_m + SURE * std_m <= delta_m else False if distance_m - SURE * std_m > delta_m else None
        )
    return Nearness(t=row.t, distance_m=distance_m, std_m=std_m, within=within)


def sentence(distances: Distances, delta_m: float) -> str:
    """Return the distances for a person; it never says success."""
    parts = []
    if distances.closest:
        parts.append(f"closest {_metres(distances.closest)} at {distances.closest.t:.1f} s")
    declared = distances.declarations
    parts.append(f"declared {_at(declared[0], delta_m)}" if declared else "never declared")
    measured = [(d.distance_m, d) for d in declared if d.distance_m is not None]
    nearest = min(measured, key=lambda each: each[0], default=None)
    if len(declared) > 1:
        closest = f", the nearest {_at(nearest[1], delta_m)}" if nearest else ""
        parts.append(f"{len(declared)} declarations{closest}")
    plane = "; horizontally, since the target has no altitude" if distances.target.get("altitude_m") is None else ""
    return f"DISTANCE ONLY: {'; '.join(parts)}{plane}; whether the target was in view nobody measured"


def _at(declared: DecidedNear, delta_m: float) -> str:
    within = {True: f"within {delta_m:g} m", False: f"not within {delta_m:g} m", None: f"within {delta_m:g} m or not"}
    return f"at {declared.t:.1f} s, {_metres(declared)} away, {within[declared.within]}"


def _metres(told: Nearness) -> str:
    if told.distance_m is None:
        return "an unknown distance"
    give_or_take = "?" if told.std_m is None else f"{told.std_m:.2f}"
    return f"{told.distance_m:.2f} ± {give_or_take} m"
