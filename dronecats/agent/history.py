"""The last five actions, in the compact form of the prompt and the logs.

Apart from `action.py`, since a camera imports numpy, and a list of models needs only the order of a point.
"""

from collections import deque

from dronecats.agent.action import Action, Finished, Go, Rotate, Think
from foundation.camera import CameraModel
from foundation.protocol import HISTORY_LENGTH, POINT_SPAN

NONE_YET = "(none yet — this is the first step)"


def compact(action: Action, camera: CameraModel | None = None) -> str:
    """Return the action on one line.

    The coordinates of a GO are pixels with a camera, as in the history of the paper's prompt, and 0–1000 without, as in
    a reply.
    """
    match action:
        case Go(x, y, depth_m):
            point = f"point=[{x:.0f}, {y:.0f}]"
            if camera is not None:
                point = f"x={x * camera.width / POINT_SPAN:.0f} y={y * camera.height / POINT_SPAN:.0f}"
            return f"GO {point} depth={depth_m:.4g}m"
        case Rotate(angle_deg):
            return f"ROTATE angle={angle_deg:.4g}deg"
        case Think():
            return "THINK"
        case Finished():
            return "FINISHED"


class History:
    """The last actions of one drone."""

    def __init__(self, camera: CameraModel, length: int = HISTORY_LENGTH) -> None:
        self.camera = camera
        self.length = length
        self._actions: deque[Action] = deque(maxlen=length)

    def append(self, action: Action) -> None:
        self._actions.append(action)

    @property
    def actions(self) -> tuple[Action, ...]:
        """Oldest first."""
        return tuple(self._actions)

    def render(self) -> str:
        """Return the numbered lines, oldest first, the newest tagged; or the sentence for the first step."""
        if not self._actions:
            return NONE_YET
        lines = [f"{i}. {compact(action, self.camera)}" for i, action in enumerate(self._actions, 1)]
        lines[-1] += "  <- latest"
        return "\n".join(lines)
