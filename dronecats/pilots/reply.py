"""The four actions as the text a model would answer with: one JSON object (paper, section "Action Space")."""

import json

from foundation.protocol import FINISHED, GO, POINT_SPAN, ROTATE, THINK


def go(u: float, v: float, depth_m: float) -> str:
    """Return a `go` at the point (u, v), 0–1000 from the top-left on both axes, clipped, with its depth in metres."""
    point = [round(min(max(u, 0.0), POINT_SPAN)), round(min(max(v, 0.0), POINT_SPAN))]
    return json.dumps({"action": GO, "point": point, "depth_m": round(depth_m, 2)})


def rotate(angle_deg: float) -> str:
    """Return a `rotate`, degrees, positive to the right."""
    return json.dumps({"action": ROTATE, "angle_deg": round(angle_deg, 1)})


def think() -> str:
    """Return a `think`."""
    return json.dumps({"action": THINK})


def finished() -> str:
    """Return a `finished`: a declaration of arrival."""
    return json.dumps({"action": FINISHED})


def fleet(replies: list[str]) -> str:
    """Return one drone's object as it is, several drones' objects as a JSON array in picture order."""
    return replies[0] if len(replies) == 1 else "[" + ", ".join(replies) + "]"
