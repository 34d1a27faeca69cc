"""Calibrates a camera's lens from pictures of a chessboard, and corrects pictures as if a pinhole camera took them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from foundation.camera import CameraModel
from foundation.errors import UsageError
from foundation.typed_file import BYTES_MAX

SIDE_PX = (16, 16384)  # px, smallest and largest width or height of a picture
COEFFICIENTS = (4, 5, 8, 12, 14)  # possible numbers of coefficients in OpenCV's standard distortion model


@dataclass(frozen=True, slots=True)
class Calibration:
    """A camera's intrinsics at one picture size."""

    width: int  # px
    height: int  # px
    matrix: tuple[tuple[float, float, float], ...]  # 3 × 3, px: ((fx, 0, cx), (0, fy, cy), (0, 0, 1))
    distortion: tuple[float, ...]  # k1, k2, p1, p2[, k3, …]; of a fisheye k1 … k4
    fisheye: bool = False
    error_px: float | None = None  # root mean square reprojection error of the calibration


def load(path: Path) -> Calibration:
    """Return the calibration in a file. Raises UsageError with the file and the fault."""
    try:
        if path.stat().st_size > BYTES_MAX:
            raise UsageError(f"calibration file '{path}' is too large for a calibration")
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
            f"calibration file '{path}' is not a file of OpenCV. Use one that cv2.FileStorage or `dronecats camera"
            " calibrate` has written"
        ) from None
    return _checked(values, path)


def _checked(values: dict[str, Any], path: Path) -> Calibration:
    def fail(name: str, problem: str) -> UsageError:
        return UsageError(f"calibration file '{path}': field '{name}' {problem}")

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
        raise fail("camera_matrix", f"does not fit a camera with {width}×{height} px")
    fisheye = bool(values["fisheye_model"])
    allowed = (4,) if fisheye else COEFFICIENTS
    if not isinstance(distortion, np.ndarray) or distortion.size not in allowed or not np.all(np.isfinite(distortion)):
        raise fail("distortion_coefficients", f"does not have {' or '.join(map(str, allowed))} numbers")
    return Calibration(width, height, _rows(matrix), tuple(map(float, distortion.ravel())), fisheye, values["error_px"])


def save(calibration: Calibration, path: Path) -> None:
    """Write a calibration to a file, whose ending (.yml, .yaml, .xml or .json) sets the format. Raises UsageError."""
    if path.suffix not in (".yml", ".yaml", ".xml", ".json"):
        raise UsageError(f"calibration file '{path}' must end in .yml, .yaml, .xml or .json")
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


HFOV_DEG = 90.0  # °, assumed for an uncalibrated camera, as in the pilot's prompt and the paper
HFOV_MIN_DEG, HFOV_MAX_DEG = 5.0, 150.0  # °, accepted fields of view of a corrected picture


class Lens:
    """Corrects pictures as if a pinhole camera with square pixels and a central principal point took them.

    Without a calibration pictures stay unchanged, and their field of view is assumed to be HFOV_DEG.
    """

    def __init__(self, calibration: Calibration | None = None) -> None:
        """Raises UsageError for a lens that cannot be corrected."""
        self.calibration = calibration
        self.model: CameraModel | None = None  # None until the first picture if there is no calibration
        self._maps: tuple[Any, Any] | None = None
        if calibration:
            self._maps, focal_px = straightening(calibration)
            hfov_deg = math.degrees(2.0 * math.atan(calibration.width / (2.0 * focal_px)))
            self.model = CameraModel(calibration.width, calibration.height, hfov_deg)

    def straightened(self, picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Return the corrected picture, in the same size.

        Raises UsageError for a picture of another size than the calibration's.
        """
        height, width = picture.shape[:2]
        if self._maps is None or self.calibration is None:
            if self.model is None or (self.model.width, self.model.height) != (width, height):
                self.model = CameraModel(width, height, HFOV_DEG)
            return picture
        if (width, height) != (self.calibration.width, self.calibration.height):
            raise UsageError(
                f"the camera gives {width}×{height} px, but its calibration is for"
                f" {self.calibration.width}×{self.calibration.height} px. Calibrate it at the size that"
                " it has in flight"
            )
        straight: NDArray[np.uint8] = cv2.remap(picture, *self._maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return straight


def straightening(calibration: Calibration) -> tuple[tuple[Any, Any], float]:
    """Return cv2.remap's two maps, and the focal length (px) of the widest pinhole view without empty corners.

    Raises UsageError if there is no such view.
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
            "the distortion of this calibration cannot be corrected, because the picture would have empty"
            " corners. Calibrate again, with the board at the edges of the picture too"
        )
    return cv2.convertMaps(x, y, cv2.CV_16SC2), focal_px


def _focal_px(matrix: Any, distortion: Any, size: tuple[int, int], fisheye: bool) -> float:
    """Return the focal length (px) at which the corrected picture is completely inside the camera's picture."""
    if fisheye:
        best = cv2.fisheye.estimateNewCameraMatrixForUndistortRectify(matrix, distortion, size, np.eye(3), balance=0.0)
        # OpenCV's principal point may be off the centre, but the corrected picture has it at the centre. So the focal
        # length is raised until the side with the least room also fits.
        reach = [min(best[k, 2], size[k] - 1 - best[k, 2]) / ((size[k] - 1) / 2) for k in (0, 1)]
        return float(max(best[k, k] / reach[k] if reach[k] > 0 else math.nan for k in (0, 1)))
    best, _ = cv2.getOptimalNewCameraMatrix(matrix, distortion, size, 0.0, size, centerPrincipalPoint=True)
    return float(max(best[0, 0], best[1, 1]))  # square pixels: the longer focal length fits both axes


def _within(places: NDArray[np.float32], length: int) -> bool:
    return bool(np.all((places > -1.5) & (places < length + 0.5)))  # tolerance, because OpenCV checks few points only


def _unfolded(x: NDArray[np.float32], y: NDArray[np.float32]) -> bool:
    """Return whether no part of the picture appears twice. The polynomial may fold areas that were not calibrated."""
    x_down, x_right = np.gradient(x)
    y_down, y_right = np.gradient(y)
    return bool(np.all(x_right * y_down - x_down * y_right > 0.0))


VIEWS_MIN = 10
ERROR_MAX_PX = 1.0  # largest root mean square of the reprojection error
FOCAL_SIGMA_MAX = 0.01  # largest standard deviation of the focal length, as a share of it
# Least standard deviation of the boards' unit normals, across and down the picture. If all boards face the camera, any
# focal length fits, and the solver may report a small standard deviation for a wrong one.
TILT_MIN = 0.1
COVERAGE_MIN = 0.5  # share of the picture's area with corners; outside this area, the fit is unreliable
MOVED_MIN = 0.04  # mean shift of the corners above which a view is new, as a share of the picture's width

Corners = NDArray[np.float32]  # (N, 1, 2) px, row by row


@dataclass(frozen=True, slots=True)
class Board:
    """A chessboard."""

    columns: int  # inner corners along a row
    rows: int
    square_m: float

    @property
    def points(self) -> NDArray[np.float32]:
        """(N, 3) m, the inner corners on the board's own plane."""
        points = np.zeros((self.columns * self.rows, 3), np.float32)
        points[:, :2] = np.mgrid[0 : self.columns, 0 : self.rows].T.reshape(-1, 2) * self.square_m
        return points


@dataclass(frozen=True, slots=True)
class Fit:
    """A calibration and its quality."""

    calibration: Calibration
    views: int
    worst_px: float  # reprojection error (root mean square) of the worst view
    tilt: float  # see the function `tilt`
    focal_sigma: float  # standard deviation of the focal length, as a share of it
    coverage: float  # see the function `coverage`


def corners(picture: NDArray[np.uint8], board: Board) -> Corners | None:
    """Return the board's inner corners in a picture (BGR); None if part of the board is not in the picture."""
    grey = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
    size = (board.columns, board.rows)
    if not cv2.findChessboardCorners(grey, size, flags=cv2.CALIB_CB_FAST_CHECK | cv2.CALIB_CB_ADAPTIVE_THRESH)[0]:
        return None  # this quick check comes first, because the search below takes a second if there is no board
    has_board, places = cv2.findChessboardCornersSB(
        grey, size, flags=cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_ACCURACY
    )
    return places.reshape(-1, 1, 2) if has_board else None  # OpenCV 4 and 5 return different shapes


def is_new(places: Corners, before: Sequence[Corners], width: int) -> bool:
    """Return whether a view differs enough from the earlier ones."""
    return all(float(np.linalg.norm(places - view, axis=2).mean()) > MOVED_MIN * width for view in before)


def fit(views: Sequence[Corners], board: Board, width: int, height: int) -> Fit:
    """Return the calibration that fits the views best. Raises UsageError if its quality is too low."""
    if len(views) < VIEWS_MIN:
        raise UsageError(
            f"the chessboard with {board.columns}×{board.rows} inner corners is seen in {len(views)} different"
            f" picture{'' if len(views) == 1 else 's'}, but {VIEWS_MIN} are needed. Show the whole board, sharp"
            " and tilted, in all parts of the picture"
        )
    try:
        error_px, matrix, distortion, turns, _, sigma, _, errors = cv2.calibrateCameraExtended(
            [board.points] * len(views), list(views), (width, height), None, None
        )
    except cv2.error:
        error_px, errors, sigma = float("inf"), np.array([np.inf]), np.full(4, np.inf)
        matrix, distortion, turns = np.eye(3), np.zeros(5), ()
    worst = int(np.argmax(errors))
    worst_px = float(errors[worst, 0]) if np.isfinite(error_px) else float("inf")
    if not error_px <= ERROR_MAX_PX:
        raise UsageError(
            f"the reprojection error is {error_px:.2f} px, but at most {ERROR_MAX_PX:g} px is allowed. Check"
            f" --board, and that the board is flat. The worst picture is number {worst + 1} with {worst_px:.2f} px"
            if np.isfinite(error_px)
            else "no lens fits these views. Check --board, and that the board is flat"
        )
    result = Fit(
        Calibration(width, height, _rows(matrix), tuple(map(float, distortion.ravel())), error_px=float(error_px)),
        len(views),
        worst_px,
        tilt(turns),
        float(max(sigma[0, 0] / matrix[0, 0], sigma[1, 0] / matrix[1, 1])),
        coverage(views, width, height),
    )
    if result.tilt < TILT_MIN:
        raise UsageError(
            "the board was always shown at nearly the same angle, so the focal length is unknown. Tilt it by 30°"
            " to 45°, left and right, up and down"
        )
    if result.focal_sigma > FOCAL_SIGMA_MAX:
        raise UsageError(
            f"the focal length is known to {result.focal_sigma:.1%} only, but {FOCAL_SIGMA_MAX:.0%} is needed."
            " Take more and sharper pictures, with the board nearer and tilted more"
        )
    if result.coverage < COVERAGE_MIN:
        raise UsageError(
            f"the corners were seen in {result.coverage:.0%} of the picture only, but {COVERAGE_MIN:.0%} is"
            " needed. Bring the board to the edges of the picture, where the distortion is largest"
        )
    return result


def tilt(turns: Sequence[Any]) -> float:
    """Return the smaller standard deviation of the boards' unit normals: across or down. `turns`: Rodrigues vectors."""
    normals = np.array([cv2.Rodrigues(turn)[0][:, 2] for turn in turns])
    facing = normals * np.sign(normals[:, 2:])
    return float(facing[:, :2].std(axis=0).min())


def coverage(views: Sequence[Corners], width: int, height: int) -> float:
    """Return the share (0 … 1) of the picture's area that all corners together enclose."""
    hull = cv2.convexHull(np.concatenate([places.reshape(-1, 2) for places in views]))
    return float(cv2.contourArea(hull) / (width * height))


def board_of(size: str, square_m: float) -> Board:
    """Return the board of a size such as '9x6' with squares of `square_m`. Raises UsageError."""
    columns, _, rows = size.lower().partition("x")
    if not (columns.isdigit() and rows.isdigit() and 3 <= int(columns) <= 50 and 3 <= int(rows) <= 50):
        raise UsageError(
            f"--board must be inner corners, COLUMNSxROWS from 3x3 to 50x50, for example 9x6; got {size!r}"
        )
    if int(columns) == int(rows):
        raise UsageError("--board must not be square, because a square board has no unique orientation")
    if not 0.001 <= square_m <= 10.0:
        raise UsageError(f"--square must be the side of a square in metres, from 0.001 to 10; got {square_m:g}")
    return Board(int(columns), int(rows), square_m)


def _rows(matrix: Any) -> tuple[tuple[float, float, float], ...]:
    return tuple((float(a), float(b), float(c)) for a, b, c in matrix)
