"""What a camera's lens does to straight lines, and the pinhole that is left when it has been undone."""

import math
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from foundation.camera import CameraModel
from foundation.errors import UsageError
from hil.cameras.calibration import Calibration

HFOV_DEG = 90.0  # of a camera that nobody has calibrated: what the prompt and the paper assume
HFOV_MIN_DEG, HFOV_MAX_DEG = 5.0, 150.0  # ° that a pinhole's picture can have and still be a picture


class Lens:
    """Makes a camera's pictures those of a pinhole with square pixels and its principal point at the centre.

    Without a calibration pictures stay as they are, and their field of view is taken on trust.
    """

    def __init__(self, calibration: Calibration | None = None, hfov_deg: float = HFOV_DEG) -> None:
        """Raises UsageError for a lens that cannot be undone."""
        self.calibration = calibration
        self.model: CameraModel | None = None  # without calibration unknown until a picture says how large it is
        self._hfov_deg = hfov_deg
        self._maps: tuple[Any, Any] | None = None
        if calibration:
            self._maps, focal_px = straightening(calibration)
            hfov_deg = math.degrees(2.0 * math.atan(calibration.width / (2.0 * focal_px)))
            self.model = CameraModel(calibration.width, calibration.height, hfov_deg)

    def straightened(self, picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Return the picture as the pinhole would have taken it, of the same size.

        Raises UsageError for a picture of another size than the calibration's.
        """
        height, width = picture.shape[:2]
        if self._maps is None or self.calibration is None:
            if self.model is None or (self.model.width, self.model.height) != (width, height):
                self.model = CameraModel(width, height, self._hfov_deg)
            return picture
        if (width, height) != (self.calibration.width, self.calibration.height):
            raise UsageError(
                f"the camera gives {width}×{height} px, and its calibration is of {self.calibration.width}×"
                f"{self.calibration.height} px: calibrate it at the size that is flown"
            )
        straight: NDArray[np.uint8] = cv2.remap(picture, *self._maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return straight


def straightening(calibration: Calibration) -> tuple[tuple[Any, Any], float]:
    """Return cv2.remap's two maps and the focal length (px) of the widest pinhole without an empty corner.

    Raises UsageError when there is none.
    """
    size = (calibration.width, calibration.height)
    matrix, distortion = np.array(calibration.matrix), np.array(calibration.distortion)
    try:
        focal_px = _focal_px(matrix, distortion, size, calibration.fisheye)
        # OpenCV counts from the middle of the first pixel, so the centre of W pixels is (W − 1) / 2
        ideal = np.array([[focal_px, 0, (size[0] - 1) / 2], [0, focal_px, (size[1] - 1) / 2], [0, 0, 1.0]])
        undo = cv2.fisheye.initUndistortRectifyMap if calibration.fisheye else cv2.initUndistortRectifyMap
        x, y = undo(matrix, distortion, np.eye(3), ideal, size, cv2.CV_32FC1)
    except cv2.error:
        x = y = np.full(size[::-1], np.nan, np.float32)
        focal_px = math.nan
    hfov_deg = math.degrees(2.0 * math.atan(size[0] / (2.0 * focal_px)))
    if not (_within(x, size[0]) and _within(y, size[1]) and _unfolded(x, y)) or not (
        HFOV_MIN_DEG < hfov_deg < HFOV_MAX_DEG
    ):
        raise UsageError(
            "the calibration's lens cannot be undone: its distortion leaves no straight picture without empty corners;"
            " calibrate again, with the board brought to the edges of the picture"
        )
    return cv2.convertMaps(x, y, cv2.CV_16SC2), focal_px


def _focal_px(matrix: Any, distortion: Any, size: tuple[int, int], fisheye: bool) -> float:
    """Return the focal length (px) at which the whole straight picture lies inside the one the camera took."""
    if fisheye:
        best = cv2.fisheye.estimateNewCameraMatrixForUndistortRectify(matrix, distortion, size, np.eye(3), balance=0.0)
        # its principal point is not the centre: what is missing on the nearer side is made up by a longer focal length
        reach = [min(best[k, 2], size[k] - 1 - best[k, 2]) / ((size[k] - 1) / 2) for k in (0, 1)]
        return float(max(best[k, k] / reach[k] if reach[k] > 0 else math.nan for k in (0, 1)))
    best, _ = cv2.getOptimalNewCameraMatrix(matrix, distortion, size, 0.0, size, centerPrincipalPoint=True)
    return float(max(best[0, 0], best[1, 1]))  # square pixels: the narrower of the two fields


def _within(places: NDArray[np.float32], length: int) -> bool:
    return bool(np.all((places > -1.5) & (places < length + 0.5)))  # OpenCV looks for the edges at a few places only


def _unfolded(x: NDArray[np.float32], y: NDArray[np.float32]) -> bool:
    """Return whether no part of the picture is shown twice, as a polynomial beyond its calibrated reach does."""
    x_down, x_right = np.gradient(x)
    y_down, y_right = np.gradient(y)
    return bool(np.all(x_right * y_down - x_down * y_right > 0.0))
