"""Draws each decision, and the setpoints that follow from it, into the camera frame that the pilot saw."""

import math
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from dronecats.agent.action import Go, action_from
from dronecats.agent.controller import Segment, plan
from foundation.camera import CameraModel
from foundation.protocol import POINT_SPAN
from foundation.run_folder import layout
from foundation.run_folder.reading import rows
from foundation.run_folder.rows import Decision
from foundation.setpoints import Turn, Velocity

INK, SHADE = (80, 255, 255), (0, 0, 0)  # BGR: marks, and the box behind text


def draw(folder: Path, camera: CameraModel) -> int:
    """Draw every decision whose frame exists into intent/ of the episode folder. Return the number of drawings."""
    drawn = 0
    for decision in rows(folder / layout.DECISIONS, Decision):
        frame = folder / layout.FRAMES / layout.frame_name(decision.frame_id, decision.drone)
        picture = cv2.imread(str(frame))
        if picture is None:
            continue
        (folder / layout.INTENT).mkdir(exist_ok=True)
        name = folder / layout.INTENT / layout.intent_name(decision.step, decision.drone)
        drawn += bool(cv2.imwrite(str(name), _marked(np.asarray(picture, np.uint8), decision, camera)))
    return drawn


def _marked(picture: NDArray[np.uint8], decision: Decision, camera: CameraModel) -> NDArray[np.uint8]:
    height, width = picture.shape[:2]
    words = [f"step {decision.step}  t={decision.t_decided:.1f} s"]
    if decision.action is None:
        words.append(f"unreadable: {decision.error}")
    else:
        action = action_from(decision.action)
        words.append(action.line)
        words += [_describe_segment(segment) for segment in plan(action, camera)]
        if isinstance(action, Go):
            at = (round(action.x * width / POINT_SPAN), round(action.y * height / POINT_SPAN))
            cv2.arrowedLine(picture, (width // 2, height - 1), at, INK, 2, cv2.LINE_AA, tipLength=0.04)
            cv2.circle(picture, at, max(8, width // 60), INK, 2, cv2.LINE_AA)
    size, row = 0.8 * width / 1000, 0
    for word in words:
        (long, high), below = cv2.getTextSize(word, cv2.FONT_HERSHEY_SIMPLEX, size, 1)
        row += high + below + 4
        cv2.rectangle(picture, (0, row - high - 4), (long + 8, row + below), SHADE, cv2.FILLED)
        cv2.putText(picture, word, (4, row), cv2.FONT_HERSHEY_SIMPLEX, size, INK, 1, cv2.LINE_AA)
    return picture


def _describe_segment(segment: Segment) -> str:
    match segment.setpoint:
        case Turn(yaw_rate):
            return f"would turn {math.degrees(yaw_rate):+.0f} deg/s for {segment.duration_s:.2f} s"
        case Velocity(forward, up):
            climb = "constant height" if up is None else f"{up:+.2f} m/s up"
            return f"would fly {forward:.2f} m/s ahead, {climb}, for {segment.duration_s:.2f} s"
    return f"would hold for {segment.duration_s:.2f} s"
