"""Encodes the inputs of the head as arrays: the picture, the instruction's words and the drone's last actions.

All inputs come from the prompt and the picture, so the head has the same information as any other model. The words are
hashed, so that an instruction outside the training data has a vector too.
"""

import re
import zlib
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from dronecats.agent.action import Action, Go, Rotate
from dronecats.pilots.actions import LEVEL_PX, PastAction
from foundation.camera import CameraModel
from foundation.errors import UsageError
from foundation.protocol import FINISHED, GO, HISTORY_LENGTH, POINT_SPAN, ROTATE, THINK

KINDS = (GO, ROTATE, THINK, FINISHED)  # in the order of the dataset's `action`
WIDTH, HEIGHT = 256, 144  # px, size of the head's input picture
WORDS = 512  # number of hash buckets for words
RECENT = 3  # number of past actions that are encoded one by one
PAST = RECENT * (len(KINDS) + 2) + 2  # length of the vector of the history
_REFERRING = {"nearest", "left", "right", "front", "behind", "between"}  # words after one of these name a landmark
_SWAPPED = {"left": "right", "right": "left"}
_FULL_TURN_DEG = 360.0


def picture(jpeg: bytes) -> NDArray[np.uint8]:
    """Return the picture of a JPEG or PNG as RGB (3, HEIGHT, WIDTH). Raises UsageError if it cannot be decoded."""
    shown = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR_RGB) if jpeg else None
    if shown is None:
        raise UsageError("The picture cannot be read. Send a JPEG or a PNG.")
    small = cv2.resize(shown, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)
    return np.ascontiguousarray(small.transpose(2, 0, 1), np.uint8)


def words(instruction: str, *, mirrored: bool = False) -> NDArray[np.float32]:
    """Return the words and word pairs of an instruction as a unit vector (WORDS,); zeros if it has no words.

    Words after a relation ("nearest Darwin Hall") are hashed differently from words before it. `mirrored` exchanges
    left and right, as a mirrored picture does.
    """
    vector = np.zeros(WORDS, np.float32)
    before, behind = "", ""
    for word in re.findall(r"[a-z0-9]+", instruction.lower()):
        word = _SWAPPED.get(word, word) if mirrored else word
        for token in (behind + word, f"{behind}{before} {word}"):
            vector[zlib.crc32(token.encode()) % WORDS] = 1.0
        behind, before = "of " if word in _REFERRING else behind, word
    return vector / max(float(np.linalg.norm(vector)), 1.0)


def history(past: Sequence[PastAction], *, mirrored: bool = False) -> NDArray[np.float32]:
    """Return the history as a vector (PAST,).

    It has the last three actions (newest first), the turn since the last go, and the number of actions. The depths of
    past gos are omitted: they are exact in the training flights, but only estimates in the head's own flights.
    """
    sign, width = -1.0 if mirrored else 1.0, float(CameraModel().width)
    vector = np.zeros(PAST, np.float32)
    for place, action in enumerate(list(past)[: -RECENT - 1 : -1]):
        at = place * (len(KINDS) + 2)
        vector[at + KINDS.index(action.kind)] = 1.0
        if action.kind == GO:
            vector[at + 4] = sign * (action.x_px / width - 0.5)
        vector[at + 5] = sign * action.angle_deg / 90.0
    turned = [0.0]
    for action in reversed(past):
        if action.kind == GO:
            break
        turned.append(action.angle_deg)
    vector[-2] = sign * sum(turned) / _FULL_TURN_DEG
    vector[-1] = len(past) / HISTORY_LENGTH
    return vector


def as_past(action: Action) -> PastAction:
    """Return an action as the next prompt's history shows it."""
    match action:
        case Go(x, y, depth_m):
            camera = CameraModel()
            return PastAction(GO, x * camera.width / POINT_SPAN, y * camera.height / POINT_SPAN, depth_m)
        case Rotate(angle_deg):
            return PastAction(ROTATE, y_px=LEVEL_PX, angle_deg=angle_deg)
        case _:
            return PastAction(action.as_json()["action"])
