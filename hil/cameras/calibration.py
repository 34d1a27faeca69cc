"""OpenCV's calibration file: what is known of a camera's lens. YAML, XML or JSON, as cv2.FileStorage writes it."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

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
