"""The last five actions, in the compact form of the prompt and the logs.

Apart from `action.py`, since a camera imports numpy, and a list of models needs only the order of a point.
"""

from collections import deque

from dronecats.agent.action import Action, Go
from foundation.camera import CameraModel
from foundation.protocol import HISTORY_LENGTH, POINT_SPAN

NONE_YET = "(none yet — this is the first step)"


def compact(action: Action, camera: CameraModel | None = None) -> str:
    """Return the action on one line.

    The coordinates of a GO are pixels with a camera, as in the history of the paper's prompt, and 0–1000 without, as in
    a reply.
    """
    if camera is None or not isinstance(action, Go):
        return action.line
    x_px, y_px = action.x * camera.width / POINT_SPAN, action.y * camera.height / POINT_SPAN
    return f"GO x={x_px:.0f} y={y_px:.0f} depth={action.depth_m:.4g}m"


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
