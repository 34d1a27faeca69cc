"""The forward camera: geometry, frames, and their encoding for the language model. Paper, appendix "Execution"."""

import math
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from foundation.camera_mount import CameraMount
from foundation.frames import Quat, Vec3, quat_from_euler, quat_multiply, quat_yaw, rotate


@dataclass(frozen=True, slots=True)
class CameraModel:
    """A pinhole camera with square pixels. Its principal point is at the exact centre of the image."""

    width: int = 1280  # px
    height: int = 720  # px
    hfov_deg: float = 90.0
    offset_frd: Vec3 = (0.5, 0.0, 0.1)  # m from the body origin
    pitch_deg: float = 0.0  # up from body forward; with a gimbal, up from the horizon
    gimballed: bool = False  # whether a gimbal holds the camera level in roll and changes its pitch in flight

    @property
    def focal_px(self) -> float:
        """Focal length (px): W / (2 tan(φ/2))."""
        return self.width / (2.0 * math.tan(math.radians(self.hfov_deg) / 2.0))

    def at_pitch(self, gimbal_pitch: float | None) -> "CameraModel":
        """Return the camera with this gimbal pitch (rad, up from the horizon); None: the camera unchanged."""
        return self if gimbal_pitch is None else replace(self, pitch_deg=math.degrees(gimbal_pitch))


def camera_on(mount: CameraMount) -> CameraModel:
    """Return the forward camera on a mount."""
    return CameraModel(pitch_deg=mount.pitch_deg, gimballed=mount.gimbal is not None)


@dataclass(frozen=True, slots=True)
class CameraPose:
    """The pose of a camera when it took a frame."""

    position_ned: Vec3  # m, optical centre
    attitude: Quat  # camera axes (forward, right, down) → NED


def camera_pose(position_ned: Vec3, attitude: Quat, camera: CameraModel) -> CameraPose:
    """Return the pose of a vehicle's camera.

    `position_ned` (m) is the body origin and `attitude` rotates body FRD into NED. The camera is at `camera.offset_frd`
    and looks along body forward, raised by `pitch_deg`. On a gimbal, it is level in roll, and `pitch_deg` counts from
    the horizon.
    """
    offset = rotate(attitude, camera.offset_frd)
    position = (position_ned[0] + offset[0], position_ned[1] + offset[1], position_ned[2] + offset[2])
    return CameraPose(position_ned=position, attitude=camera_attitude(attitude, camera))


def camera_attitude(attitude: Quat, camera: CameraModel) -> Quat:
    """Return the attitude of a camera (camera axes → NED) on a body with this attitude (FRD → NED)."""
    if camera.gimballed:
        return quat_from_euler(0.0, math.radians(camera.pitch_deg), quat_yaw(attitude))
    if not camera.pitch_deg:
        return attitude
    return quat_multiply(attitude, quat_from_euler(0.0, math.radians(camera.pitch_deg), 0.0))


@dataclass(frozen=True, slots=True)
class Frame:
    """One camera image and the time of its capture."""

    frame_id: int
    drone: int
    time_us: int  # µs, vehicle clock at capture
    image_rgb: NDArray[np.uint8]  # (H, W, 3)
    depth_mm: NDArray[np.uint16] | None = None  # (H, W) mm along the optical axis, at pixel centres; 0: unknown


class Camera(Protocol):
    """A source of camera frames."""

    def newest(self, drone: int = 0) -> Frame:
        """Return the newest frame. Raises CameraError when there is none."""
        ...

    def close(self) -> None: ...


WIDTH_MAX = 640  # px, largest width of the model's pictures. Paper, "API Request Format"
QUALITY = 85  # JPEG quality


def reduced_size(width: int, height: int) -> tuple[int, int]:
    """Return the size (width, height) in px to which a picture is reduced for the model. It keeps the aspect ratio."""
    return (WIDTH_MAX, round(height * WIDTH_MAX / width)) if width > WIDTH_MAX else (width, height)


def reduced(image_rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return an (H, W, 3) RGB image, reduced to the size for the model."""
    import cv2  # slow to import, and not needed for the geometry

    height, width = image_rgb.shape[:2]
    if width <= WIDTH_MAX:
        return image_rgb
    size = reduced_size(width, height)
    return np.asarray(cv2.resize(image_rgb, size, interpolation=cv2.INTER_AREA), np.uint8)  # keeps small text legible


DEPTH_MAX_M = 65.535  # largest depth that a depth picture can store: 16 bits of millimetres


def in_millimetres(depth_m: NDArray[np.float32]) -> NDArray[np.uint16]:
    """Return depths (m) as millimetres; 0 beyond DEPTH_MAX_M and for the sky."""
    near = depth_m <= DEPTH_MAX_M
    return np.where(near, np.rint(1000.0 * np.where(near, depth_m, 0.0)), 0.0).astype(np.uint16)


def encode_depth(depth_mm: NDArray[np.uint16]) -> bytes:
    """Return an (H, W) depth picture as a 16-bit PNG, in millimetres."""
    import cv2

    return cv2.imencode(".png", depth_mm)[1].tobytes()


def decode_depth(data: bytes) -> NDArray[np.uint16] | None:
    """Return the (H, W) depth picture in a 16-bit PNG; None if `data` is no such PNG."""
    import cv2

    try:
        picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) if data else None
    except cv2.error:  # the header has an impossible size
        return None
    return np.asarray(picture) if picture is not None and picture.dtype == np.uint16 and picture.ndim == 2 else None


def encode(image_rgb: NDArray[np.uint8]) -> bytes:
    """Return an (H, W, 3) RGB image as the JPEG for the model, reduced in size. Raises ValueError if that fails."""
    import cv2

    picture = cv2.cvtColor(reduced(image_rgb), cv2.COLOR_RGB2BGR)
    ok, data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    if not ok:
        raise ValueError(f"an image of shape {image_rgb.shape} cannot be written as JPEG")
    return data.tobytes()
