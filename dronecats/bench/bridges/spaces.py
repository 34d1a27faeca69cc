"""What `DroneCATS-v0` shows and takes: of one drone a picture and an action, of a fleet one for each drone."""

import json
from collections.abc import Sequence
from typing import Any

import cv2
import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict, Discrete, Text, Tuple
from numpy.typing import NDArray

from foundation.camera import CameraModel
from foundation.picture import WIDTH_MAX
from foundation.protocol import FINISHED, GO, POINT_SPAN, ROTATE, THINK

_CAMERA = CameraModel()
PICTURE_SHAPE = (_CAMERA.height * WIDTH_MAX // _CAMERA.width, WIDTH_MAX, 3)  # as models get it: height, width, RGB


def picture(jpeg: bytes) -> NDArray[np.uint8]:
    """Return a JPEG as (height, width, 3) RGB."""
    decoded = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    return np.asarray(cv2.cvtColor(decoded, cv2.COLOR_BGR2RGB), np.uint8)


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


DEPTH_MAX_M = 300.0
ANGLE_MAX_DEG = 90.0
CHARACTERS = frozenset(map(chr, range(32, 0x2100)))  # of instructions

Seen = dict[str, Any]  # {"frame": (360, 640, 3) uint8 RGB, "instruction": str}; of n drones "frames": (n, 360, 640, 3)
Acted = dict[str, Any] | tuple[dict[str, Any], ...]  # of a fleet an action for each drone
# an action: {"kind": 0 … 3, "point": (2,) 0 … 1000, "depth_m": (1,) m, "angle_deg": (1,) °}


class Instruction(Text):
    """A space of texts that prints how many characters it has, and not all of them."""

    def __repr__(self) -> str:
        return f"Instruction({self.min_length}, {self.max_length}, charset of {len(self.character_set):,} characters)"


def observation_space(drones: int) -> Dict:
    """Return the space of what is seen."""
    pictures = Box(0, 255, frames_shape(drones), np.uint8)
    instruction = Instruction(max_length=1000, charset=CHARACTERS)
    return Dict({"frame" if drones == 1 else "frames": pictures, "instruction": instruction})


def action_space(drones: int) -> gymnasium.Space[Any]:
    """Return the space of an action, or of a tuple of so many."""
    return _action() if drones == 1 else Tuple([_action() for _ in range(drones)])


def _action() -> Dict:
    return Dict(
        {
            "kind": Discrete(len(KINDS)),
            "point": Box(0.0, POINT_SPAN, (2,), np.float32),
            "depth_m": Box(0.1, DEPTH_MAX_M, (1,), np.float32),
            "angle_deg": Box(-ANGLE_MAX_DEG, ANGLE_MAX_DEG, (1,), np.float32),
        }
    )


def joint_reply(action: Acted, drones: int) -> str:
    """Return the reply that says so. Raises ValueError for another number of actions than drones."""
    if isinstance(action, dict):
        action = (action,)
    if len(action) != drones:
        raise ValueError(f"an action for each of {drones} drones is wanted, got {len(action)}")
    told = [
        reply(int(one["kind"]), one["point"], float(np.ravel(one["depth_m"])[0]), float(np.ravel(one["angle_deg"])[0]))
        for one in action
    ]
    return told[0] if drones == 1 else f"[{', '.join(told)}]"


def frames_shape(drones: int) -> tuple[int, ...]:
    """Return the shape of the pictures together: (360, 640, 3), or (n, 360, 640, 3) of a fleet."""
    return PICTURE_SHAPE if drones == 1 else (drones, *PICTURE_SHAPE)


def frames(images_jpeg: Sequence[bytes]) -> NDArray[np.uint8]:
    """Return the pictures of a question, one per drone, in `frames_shape`."""
    each = [picture(jpeg) for jpeg in images_jpeg]
    return each[0] if len(each) == 1 else np.stack(each)


def seen(pictures: NDArray[np.uint8], instruction: str) -> Seen:
    """Return the observation of pictures in `frames_shape`."""
    return {"frame" if pictures.ndim == len(PICTURE_SHAPE) else "frames": pictures, "instruction": instruction}
