"""The four actions as text, for harnesses whose actions are numbers."""

import json
from collections.abc import Sequence

from foundation.protocol import FINISHED, GO, ROTATE, THINK

KINDS = (GO, ROTATE, THINK, FINISHED)  # an action's number is its place here


def reply(kind: int, point: Sequence[float], depth_m: float, angle_deg: float) -> str:
    """Return the JSON reply of an action. `point`: (x, y), 0 … 1000 from the picture's upper left corner.

    What the kind does not need is left out. Raises ValueError for a kind that is none.
    """
    if kind not in range(len(KINDS)):
        raise ValueError(f"the kind of an action is 0 … {len(KINDS) - 1}, got {kind}")
    name = KINDS[kind]
    told: dict[str, object] = {"action": name}
    if name == GO:
        told |= {"point": [float(point[0]), float(point[1])], "depth_m": float(depth_m)}
    elif name == ROTATE:
        told |= {"angle_deg": float(angle_deg)}
    return json.dumps(told)
