"""Renders images of a chessboard through a known lens. The ray of every pixel is traced back to the board."""

import math
from functools import cache

import cv2
import numpy as np

from hil.cameras.lens import Board, Calibration

SAMPLES = 2  # per pixel and axis: edges become grey, as in a real image
BOARD = Board(9, 6, 0.025)
LENS = Calibration(
    640, 480, ((520.0, 0.0, 326.0), (0.0, 518.0, 236.0), (0.0, 0.0, 1.0)), (-0.28, 0.09, 8e-4, -6e-4, 0.0)
)
POSES = [  # roll, pitch, yaw of the board (°); its centre in the image (x, y: −1 … 1); its distance (m)
    (0, 0, 0, 0.0, 0.0, 0.30), (0, 35, 0, -0.45, -0.4, 0.34), (0, -35, 5, 0.45, -0.4, 0.34),
    (35, 0, 0, 0.45, 0.45, 0.34), (-35, 0, 10, -0.45, 0.45, 0.34), (20, 30, -8, 0.0, -0.35, 0.32),
    (-20, -30, 12, 0.1, 0.35, 0.32), (30, -20, 90, -0.5, 0.0, 0.36), (-30, 20, 45, 0.5, 0.0, 0.38),
    (10, 40, 20, -0.2, 0.2, 0.40), (-40, 10, -30, 0.2, -0.2, 0.40), (15, 15, 0, 0.35, 0.3, 0.30),
    (-15, 15, 0, -0.35, -0.3, 0.30), (0, 45, 0, 0.3, 0.0, 0.40),
]  # fmt: skip


def rays(lens: Calibration) -> np.ndarray:
    """Return x/z and y/z of the ray through each sample of each pixel, as an array (H·S, W·S, 2)."""
    xs, ys = ((np.arange(n * SAMPLES) + 0.5) / SAMPLES - 0.5 for n in (lens.width, lens.height))
    points = np.stack(np.meshgrid(xs, ys), axis=-1).reshape(-1, 1, 2)
    done = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 60, 1e-10)
    straight: np.ndarray = cv2.undistortPoints(points, np.array(lens.matrix), np.array(lens.distortion), criteria=done)
    return straight.reshape(len(ys), len(xs), 2).astype(np.float32)


def placed(pose: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Return the axes of the board as columns, and its centre (m). Camera frame: x right, y down, z forward."""
    roll, pitch, yaw, across, down, distance = pose
    turn = np.eye(3)
    for axis, angle in zip(np.eye(3), (roll, pitch, yaw), strict=True):
        turn = cv2.Rodrigues(axis * math.radians(angle))[0] @ turn
    return turn, np.array([0.55 * across * distance, 0.42 * down * distance, distance])


def corners_of(pose: tuple[float, ...], noise_px: float) -> np.ndarray:
    """Return the image points (px) of the board's corners, as (N, 1, 2), with Gaussian noise of noise_px."""
    turn, middle = placed(pose)
    ahead = (BOARD.points - BOARD.points.mean(axis=0)) @ turn.T + middle
    places: np.ndarray = cv2.projectPoints(
        ahead, np.zeros(3), np.zeros(3), np.array(LENS.matrix), np.array(LENS.distortion)
    )[0]
    noise = np.random.default_rng(round(1e6 * abs(sum(pose)))).normal(0.0, noise_px, places.shape)
    moved: np.ndarray = places + noise
    return moved.reshape(-1, 1, 2).astype(np.float32)


def view(directions: np.ndarray, pose: tuple[float, ...], board: Board = BOARD) -> np.ndarray:
    """Return the (H, W, 3) image of the board: black squares on a white card, on a grey background."""
    turn, middle = placed(pose)
    right, down, normal = turn.T
    to_board = [normal @ middle * axis - axis @ middle * normal for axis in (right, down)]
    u, v = cv2.split(cv2.perspectiveTransform(directions, np.array([*to_board, board.square_m * normal])))
    columns, rows = (board.columns + 1) / 2, (board.rows + 1) / 2
    odd = (np.floor(u + columns) + np.floor(v + rows)) % 2 == 0
    light = np.where((abs(u) < columns) & (abs(v) < rows) & odd, 25.0, 230.0)
    light = np.where((abs(u) < columns + 1) & (abs(v) < rows + 1), light, 120.0)
    height, width = light.shape[0] // SAMPLES, light.shape[1] // SAMPLES
    grey = light.reshape(height, SAMPLES, width, SAMPLES).mean(axis=(1, 3))
    noisy = grey + np.random.default_rng(7).normal(0.0, 2.0, grey.shape)
    picture: np.ndarray = cv2.cvtColor(np.clip(noisy, 0, 255).astype(np.uint8), cv2.COLOR_GRAY2BGR)
    return picture


@cache
def views() -> tuple[np.ndarray, ...]:
    """Return the images of the board in all poses. They are rendered once."""
    directions = rays(LENS)
    return tuple(view(directions, pose) for pose in POSES)
