"""A camera's lens from pictures of a chessboard (Zhang 2000, as OpenCV computes it), and why a result is no good."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from foundation.errors import UsageError
from hil.cameras.lens import Calibration

VIEWS_MIN = 10
ERROR_MAX_PX = 1.0  # root mean square
FOCAL_SIGMA_MAX = 0.01  # of the focal length
# Boards that all face the camera fit any focal length perfectly, and the solver is then sure of a wrong one. So the way
# they face has to vary: standard deviation of their normals' parts across and down the picture.
TILT_MIN = 0.1
COVERAGE_MIN = 0.5  # of the picture's area that corners were seen in: beyond them the lens is a guess
MOVED_MIN = 0.04  # of the picture's width, mean of the corners, that makes a view another view

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
    """A calibration, and how far it can be trusted."""

    calibration: Calibration
    views: int
    worst_view: int  # whose error is largest, counted from 0
    worst_px: float
    tilt: float  # standard deviation of the way that the boards face, in the direction in which it varies less
    focal_sigma: float  # standard deviation of the focal length, as a part of it
    coverage: float  # 0 … 1 of the picture's area


def corners(picture: NDArray[np.uint8], board: Board) -> Corners | None:
    """Return the board's inner corners in a picture (blue first), None when it is not wholly in it."""
    grey = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
    size = (board.columns, board.rows)
    if not cv2.findChessboardCorners(grey, size, flags=cv2.CALIB_CB_FAST_CHECK | cv2.CALIB_CB_ADAPTIVE_THRESH)[0]:
        return None  # a quick look: the thorough search below takes a second where there is no board
    found, places = cv2.findChessboardCornersSB(grey, size, flags=cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_ACCURACY)
    return places.reshape(-1, 1, 2) if found else None  # OpenCV 4 and 5 differ here


def is_new(places: Corners, before: Sequence[Corners], width: int) -> bool:
    """Return whether a view differs enough from those before to say something new."""
    return all(float(np.linalg.norm(places - other, axis=2).mean()) > MOVED_MIN * width for other in before)


def fit(views: Sequence[Corners], board: Board, width: int, height: int) -> Fit:
    """Return the calibration that explains the views best. Raises UsageError for one that should not be used."""
    if len(views) < VIEWS_MIN:
        raise UsageError(
            f"the chessboard with {board.columns}×{board.rows} inner corners is seen in {len(views)} different "
            f"picture{'' if len(views) == 1 else 's'}, and {VIEWS_MIN} are wanted: show the whole board, sharp, "
            "in all parts of the picture and tilted"
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
            f"the reprojection error is {error_px:.2f} px, and more than {ERROR_MAX_PX:g} is no calibration: is "
            f"--board right and the board flat? The worst picture is number {worst + 1} with {worst_px:.2f} px"
            if np.isfinite(error_px)
            else "no lens explains these views: is --board right and the board flat?"
        )
    result = Fit(
        Calibration(width, height, _rows(matrix), tuple(map(float, distortion.ravel())), error_px=float(error_px)),
        len(views),
        worst,
        worst_px,
        tilt(turns),
        float(max(sigma[0, 0] / matrix[0, 0], sigma[1, 0] / matrix[1, 1])),
        coverage(views, width, height),
    )
    if result.tilt < TILT_MIN:
        raise UsageError(
            "the board was always shown at nearly the same angle, which leaves the focal length open: tilt it by 30° "
            "to 45°, left and right, up and down"
        )
    if result.focal_sigma > FOCAL_SIGMA_MAX:
        raise UsageError(
            f"the focal length is known to {result.focal_sigma:.1%} only, and {FOCAL_SIGMA_MAX:.0%} is wanted: "
            "take sharper pictures, more of them, with the board nearer and tilted more"
        )
    if result.coverage < COVERAGE_MIN:
        raise UsageError(
            f"the corners were seen in {result.coverage:.0%} of the picture, and {COVERAGE_MIN:.0%} is wanted: "
            "bring the board to the edges of the picture, where the lens bends most"
        )
    return result


def tilt(turns: Sequence[Any]) -> float:
    """Return how much the boards' normals vary, across or down, whichever is less. `turns` are Rodrigues'."""
    normals = np.array([cv2.Rodrigues(turn)[0][:, 2] for turn in turns])
    facing = normals * np.sign(normals[:, 2:])
    return float(facing[:, :2].std(axis=0).min())


def coverage(views: Sequence[Corners], width: int, height: int) -> float:
    """Return the part (0 … 1) of the picture's area that all corners together enclose."""
    hull = cv2.convexHull(np.concatenate([places.reshape(-1, 2) for places in views]))
    return float(cv2.contourArea(hull) / (width * height))


def board_of(size: str, square_m: float) -> Board:
    """Return the board of '9x6' with squares of `square_m`. Raises UsageError."""
    columns, _, rows = size.lower().partition("x")
    if not (columns.isdigit() and rows.isdigit() and 3 <= int(columns) <= 50 and 3 <= int(rows) <= 50):
        raise UsageError(f"--board wants inner corners, COLUMNSxROWS from 3x3 to 50x50, for example 9x6, not {size!r}")
    if int(columns) == int(rows):
        raise UsageError("--board wants a board that is not square: of a square one nobody can tell which way is up")
    if not 0.001 <= square_m <= 10.0:
        raise UsageError(f"--square wants the side of a square in metres, from 0.001 to 10, not {square_m:g}")
    return Board(int(columns), int(rows), square_m)


def _rows(matrix: Any) -> tuple[tuple[float, float, float], ...]:
    return tuple((float(a), float(b), float(c)) for a, b, c in matrix)
