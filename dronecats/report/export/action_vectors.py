"""What was known and what was decided as vectors of numbers, for training an action head.

The four-action form keeps the units of the log. The body velocity is what the paper's controller
(`dronecats/agent/controller.py`) makes of the action: the constant velocity along the axes of the heading at the
picture that ends, after as long, at the same place, and the constant yaw rate that ends at the same heading.
"""

import math

import numpy as np
from numpy.typing import NDArray

from dronecats.agent.action import ActionError, Finished, Go, Rotate, Think, action_from
from dronecats.agent.controller import plan
from dronecats.report.export.tracks import FlownTrack
from foundation.camera import CameraModel
from foundation.frames import quat_to_euler
from foundation.run_folder.rows import Decision
from foundation.setpoints import Turn, Velocity

STATE = ("north_m", "east_m", "down_m", "forward_m_s", "right_m_s", "down_m_s", "roll_rad", "pitch_rad", "yaw_rad")
ACTION = ("go", "rotate", "think", "finished", "point_x", "point_y", "depth_m", "angle_deg")
BODY_VELOCITY = ("forward_m_s", "right_m_s", "down_m_s", "yaw_rate_rad_s", "duration_s")

Vector = NDArray[np.float32]


def state(track: FlownTrack, t_s: float, first_s: float) -> Vector:
    """Return what an autopilot thought at a time (9,): place since `first_s`, velocity along its heading, attitude."""
    now, first = track.at(t_s), track.at(first_s)
    w, x, y, z = (float(value) for value in track.attitude[now])
    roll, pitch, yaw = quat_to_euler((w, x, y, z))
    vn, ve, vd = (float(value) for value in track.velocity_ned[now])
    forward, right = vn * math.cos(yaw) + ve * math.sin(yaw), ve * math.cos(yaw) - vn * math.sin(yaw)
    moved = track.position_ned[now] - track.position_ned[first]
    return np.array([*moved, forward, right, vd, roll, pitch, yaw], np.float32)


def four_action(decision: Decision) -> Vector:
    """Return a decision as (8,): which of the four actions, none where the reply held none, and its numbers or 0."""
    vector = np.zeros(len(ACTION), np.float32)
    match _action(decision):
        case Go(x, y, depth_m):
            vector[[0, 4, 5, 6]] = (1.0, x, y, depth_m)
        case Rotate(angle_deg):
            vector[[1, 7]] = (1.0, angle_deg)
        case Think():
            vector[2] = 1.0
        case Finished():
            vector[3] = 1.0
    return vector


def body_velocity(decision: Decision, camera: CameraModel) -> Vector:
    """Return what a decision has the drone fly (5,): forward, right, down in m/s, yaw rate in rad/s, for how long."""
    segments = plan(_action(decision), camera)
    duration_s = sum(segment.duration_s for segment in segments)
    ahead = right = down = turned = 0.0
    for segment in segments:
        match segment.setpoint:
            case Turn(_, angle):
                turned = angle or 0.0
            case Velocity(forward, up, bearing):
                turned = bearing or 0.0
                ahead += forward * math.cos(turned) * segment.duration_s
                right += forward * math.sin(turned) * segment.duration_s
                down -= (up or 0.0) * segment.duration_s
    flown = np.array([ahead, right, down, turned]) / duration_s
    return np.array([*flown, duration_s], np.float32)


def _action(decision: Decision) -> Go | Rotate | Think | Finished | None:
    try:
        return action_from(decision.action)
    except ActionError:
        return None
