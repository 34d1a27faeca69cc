"""What can be said of a flight whose truth nobody measured: how near it came, give or take. Never whether it succeeded.

A success wants the target in view, and nobody measured that. What is within the radius is so by two standard deviations
of the distance, or it is open.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

from dronecats.judge.damage import Row
from dronecats.judge.diagnostics import GAP_S
from dronecats.judge.files import Estimate, Logs
from dronecats.judge.measured import finished
from dronecats.judge.verdict import CAP_S, DELTA_M

SURE = 2.0  # standard deviations


def distances(logs: Logs, delta_m: float = DELTA_M) -> dict[str, Any] | None:
    """Return the distances of an estimated flight to its surveyed target, None when there is no such estimate."""
    estimate = logs.estimate
    if estimate is None or estimate.head.get("target") is None:
        return None
    told = (p for p in estimate.poses if p["t"] <= CAP_S and p["distance_m"] is not None)
    poses = sorted(told, key=lambda p: float(p["t"]))
    acted = [d for d in logs.decisions if d["t_decided"] <= CAP_S]
    return {
        "source": estimate.head.get("source"),
        "target": estimate.head["target"],
        "visible": None,  # nobody measured it
        "closest": _told(min(poses, key=lambda p: p["distance_m"], default=None), delta_m),
        "last_action": _declared(acted[-1], estimate, delta_m) if acted else None,
        "declarations": [_declared(d, estimate, delta_m) for d in finished(logs) if d["t_decided"] <= CAP_S],
        "dwell_s": round(_dwell(poses, delta_m), 3),
    }


def _dwell(poses: Sequence[Row], delta_m: float) -> float:
    """Return the seconds within the radius, in view or not."""
    near = [float(b["t"] - a["t"]) for a, b in pairwise(poses) if a["distance_m"] <= delta_m]
    return sum(seconds for seconds in near if seconds <= GAP_S)


def _declared(decision: Row, estimate: Estimate, delta_m: float) -> dict[str, Any]:
    """Return what is known of a decision at its own frame."""
    frame = estimate.frames.get((decision["drone"], decision["frame_id"]))
    told = _told(frame, delta_m) or {"t": None, "distance_m": None, "std_m": None, "within": None}
    return {"step": decision["step"], "drone": decision["drone"], **told, "t": decision["t_decided"]}


def _told(row: Row | None, delta_m: float) -> dict[str, Any] | None:
    """Return distance, standard deviation and whether it is within the radius: True, False, or None, which is open."""
    if row is None:
        return None
    distance_m, std_m = row.get("distance_m"), row.get("distance_std_m")
    within = None
    if distance_m is not None and std_m is not None:
        within = (
            True if distance_m + SURE * std_m <= delta_m else False if distance_m - SURE * std_m > delta_m else None
        )
    return {"t": row["t"], "distance_m": distance_m, "std_m": std_m, "within": within}


def sentence(distances: dict[str, Any], delta_m: float) -> str:
    """Return the distances for a person; it never says success."""
    parts = []
    if distances["closest"]:
        parts.append(f"closest {_metres(distances['closest'])} at {distances['closest']['t']:.1f} s")
    declared = distances["declarations"]
    parts.append(f"declared {_at(declared[0], delta_m)}" if declared else "never declared")
    measured = [d for d in declared if d["distance_m"] is not None]
    nearest = min(measured, key=lambda d: d["distance_m"], default=None)
    if len(declared) > 1:
        parts.append(f"{len(declared)} declarations" + (f", the nearest {_at(nearest, delta_m)}" if nearest else ""))
    plane = "; horizontally, since the target has no altitude" if distances["target"].get("altitude_m") is None else ""
    return f"DISTANCE ONLY: {'; '.join(parts)}{plane}; whether the target was in view nobody measured"


def _at(declared: dict[str, Any], delta_m: float) -> str:
    within = {True: f"within {delta_m:g} m", False: f"not within {delta_m:g} m", None: f"within {delta_m:g} m or not"}
    return f"at {declared['t']:.1f} s, {_metres(declared)} away, {within[declared['within']]}"


def _metres(told: dict[str, Any]) -> str:
    if told["distance_m"] is None:
        return "an unknown distance"
    give_or_take = "?" if told["std_m"] is None else f"{told['std_m']:.2f}"
    return f"{told['distance_m']:.2f} ± {give_or_take} m"
