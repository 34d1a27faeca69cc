"""The inverse of `seen_place`: the go that names a place."""

from dronecats.agent.action import Go
from foundation.camera import CameraModel, camera_pose
from foundation.frames import Vec3, quat_from_euler, rotate_inverse
from foundation.protocol import POINT_SPAN
from foundation.setpoints import PicturePose


def point_of(place_ned: Vec3, sight: PicturePose, camera: CameraModel) -> Go:
    """Return the go that names a place (m, local frame) in front of the lens, in a picture taken at `sight`."""
    attitude = quat_from_euler(sight.roll, sight.pitch, sight.heading)
    pose = camera_pose(sight.position_ned, attitude, camera.at_pitch(sight.gimbal_pitch))
    north, east, down = (a - b for a, b in zip(place_ned, pose.position_ned, strict=True))
    forward, right, below = rotate_inverse(pose.attitude, (north, east, down))
    x = camera.width / 2.0 + camera.focal_px * right / forward
    y = camera.height / 2.0 + camera.focal_px * below / forward
    return Go(x * POINT_SPAN / camera.width, y * POINT_SPAN / camera.height, forward)
