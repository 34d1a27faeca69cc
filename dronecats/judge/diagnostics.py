"""What the trace says beside the verdict. None of it enters the verdict. Paper, "Metrics"."""

import math
from itertools import pairwise
from typing import Any

from dronecats.judge.files import Logs
from dronecats.judge.verdict import CAP_S, DELTA_M


def diagnostics(logs: Logs, delta_m: float = DELTA_M) -> dict[str, Any]:
    """Return minimum distance, approach ratio, oracle success, and for the view: acquisition, dwell, longest loss."""
    poses = [p for p in logs.poses if p["t"] <= CAP_S and p.get("distance_m") is not None]
    if not poses:
        return {}
    nearest = min(p["distance_m"] for p in poses)
    start = min(p["distance_m"] for p in poses if p["t"] == min(q["t"] for q in poses if q["drone"] == p["drone"]))
    seen = [p["t"] for p in poses if p["visible"]]
    return {
        "min_distance_m": nearest,
        "start_distance_m": start,
        "approach_ratio": round(1.0 - nearest / start, 4) if start else None,
        "oracle_success": nearest <= delta_m,
        "first_seen_s": min(seen, default=None),
        "dwell_s": round(_dwell(poses, delta_m), 3),
        "longest_loss_s": round(max((b - a for a, b in pairwise(sorted(set(seen)))), default=0.0), 3),
        "path_m": round(_path(poses), 3),
        "flown_s": max(p["t"] for p in poses),
    }


def _dwell(poses: list[dict[str, Any]], delta_m: float) -> float:
    """Seconds spent within delta with the target in view, drones added up."""
    return sum(
        float(b["t"] - a["t"])
        for drone in {p["drone"] for p in poses}
        for a, b in pairwise([p for p in poses if p["drone"] == drone])
        if a["visible"] and a["distance_m"] <= delta_m
    )


def _path(poses: list[dict[str, Any]]) -> float:
    return sum(
        math.dist(a["position_ned"], b["position_ned"])
        for drone in {p["drone"] for p in poses}
        for a, b in pairwise([p for p in poses if p["drone"] == drone])
    )
