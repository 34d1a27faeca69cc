"""What a camera's lens does to straight lines, and the pinhole that is left when it has been undone."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from foundation.camera import CameraModel
from foundation.errors import UsageError

BYTES_MAX = 1_000_000
SIDE_PX = (16, 16384)  # px, of a picture
COEFFICIENTS = (4, 5, 8, 12, 14)  # how many OpenCV's plain model may have


@dataclass(frozen=True, slots=True)
class Calibration:
    """A camera's intrinsics at one picture size."""

    width: int  # px
    height: int  # px
    matrix: tuple[tuple[float, float, float], ...]  # 3 × 3, px: ((fx, 0, cx), (0, fy, cy), (0, 0, 1))
    distortion: tuple[float, ...]  # k1, k2, p1, p2[, k3, …]; of a fisheye k1 … k4
    fisheye: bool = False
    error_px: float | None = None  # root mean square of the reprojection, when it was calibrated


def load(path: Path) -> Calibration:
    """Return the calibration in a file. Raises UsageError naming the file and what is wrong with it."""
    try:
        if path.stat().st_size > BYTES_MAX:
            raise UsageError(f"calibration file '{path}' is larger than a calibration can be")
        text = path.read_text(encoding="utf-8")
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or "it is not text"
        raise UsageError(f"calibration file '{path}' cannot be read: {why}") from None
    values: dict[str, Any] = {}
    try:
        storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
        for name in ("image_width", "image_height", "camera_matrix", "distortion_coefficients", "fisheye_model"):
            node = storage.getNode(name)
            values[name] = node.mat() if node.isMap() else node.real() if node.isReal() or node.isInt() else None
        error_px = storage.getNode("avg_reprojection_error")
        values["error_px"] = error_px.real() if error_px.isReal() else None
    except (cv2.error, SystemError):
        raise UsageError(
            f"calibration file '{path}' is not OpenCV's: it wants a file that cv2.FileStorage or"
            " `dronecats camera calibrate` has written"
        ) from None
    return _checked(values, path)


def _checked(values: dict[str, Any], path: Path) -> Calibration:
    def fail(name: str, what: str) -> UsageError:
        return UsageError(f"calibration file '{path}': field '{name}' {what}")

    for name in ("image_width", "image_height", "camera_matrix", "distortion_coefficients"):
        if values[name] is None:
            raise fail(name, "is missing")
    for name in ("image_width", "image_height"):
        if not isinstance(values[name], float) or not SIDE_PX[0] <= values[name] <= SIDE_PX[1]:
            raise fail(name, "is not the width or height of a picture in pixels")
    width, height = int(values["image_width"]), int(values["image_height"])
    matrix, distortion = values["camera_matrix"], values["distortion_coefficients"]
    if not isinstance(matrix, np.ndarray) or matrix.shape != (3, 3) or not np.all(np.isfinite(matrix)):
        raise fail("camera_matrix", "is not a matrix of 3 × 3 numbers")
    plausible = 0 < matrix[0, 2] < width and 0 < matrix[1, 2] < height and min(matrix[0, 0], matrix[1, 1]) > width / 100
    if not plausible or not np.allclose(matrix[[0, 1, 2, 2, 2], [1, 0, 0, 1, 2]], [0, 0, 0, 0, 1]):
        raise fail("camera_matrix", f"is not that of a camera with {width}×{height} px")
    fisheye = bool(values["fisheye_model"])
    allowed = (4,) if fisheye else COEFFICIENTS
    if not isinstance(distortion, np.ndarray) or distortion.size not in allowed or not np.all(np.isfinite(distortion)):
        raise fail("distortion_coefficients", f"does not hold {' or '.join(map(str, allowed))} numbers")
    rows = tuple((float(row[0]), float(row[1]), float(row[2])) for row in matrix)
    return Calibration(width, height, rows, tuple(map(float, distortion.ravel())), fisheye, values["error_px"])


def save(calibration: Calibration, path: Path) -> None:
    """Write the file; its ending (.yml, .yaml, .xml or .json) says in which form. Raises UsageError."""
    if path.suffix not in (".yml", ".yaml", ".xml", ".json"):
        raise UsageError(f"calibration file '{path}' should end in .yml, .yaml, .xml or .json")
    try:
        storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
        opened = storage.isOpened()
    except (cv2.error, SystemError):
        opened = False
    if not opened:
        raise UsageError(f"calibration file '{path}' cannot be written")
    storage.write("image_width", calibration.width)
    storage.write("image_height", calibration.height)
    storage.write("camera_matrix", np.array(calibration.matrix))
    storage.write("distortion_coefficients", np.array([calibration.distortion]))
    storage.write("fisheye_model", int(calibration.fisheye))
    if calibration.error_px is not None and math.isfinite(calibration.error_px):
        storage.write("avg_reprojection_error", float(calibration.error_px))
    storage.release()


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
