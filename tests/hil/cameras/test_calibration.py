"""Chessboard calibration and undistortion, tested with images rendered through a known lens."""

import json
import math
import re
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from foundation.camera import CameraModel
from foundation.errors import UsageError
from hil.cameras.lens import Board, Calibration, Lens, board_of, corners, fit, is_new, load, save
from tests.hil.cameras.board_views import BOARD, LENS, POSES, corners_of, placed, views
from tests.support.refusal import refusal

FISHEYE = Calibration(
    640, 480, ((280.0, 0.0, 322.0), (0.0, 280.0, 237.0), (0.0, 0.0, 1.0)), (0.02, -0.006, 0.002, -4e-4), True
)


def model_of(lens: Lens) -> CameraModel:
    """Return the pinhole model of the undistorted images of a lens."""
    assert lens.model is not None
    return lens.model


@pytest.fixture(scope="module")
def seen():
    """Return the detected corners of the board in every pose."""
    corner_sets = [corners(picture, BOARD) for picture in views()]
    assert all(places is not None for places in corner_sets)
    return corner_sets


def bent(lens, points):
    """Project directions (x/z, y/z) through the lens and return the image points (px)."""
    if lens.fisheye:
        return cv2.fisheye.distortPoints(points.reshape(-1, 1, 2), np.array(lens.matrix), np.array(lens.distortion))
    rays3 = np.concatenate([points, np.ones((len(points), 1))], axis=1)
    return cv2.projectPoints(rays3, np.zeros(3), np.zeros(3), np.array(lens.matrix), np.array(lens.distortion))[0]


def test_calibration_recovers_a_known_lens(seen):
    fitted = fit(seen, BOARD, LENS.width, LENS.height)
    for k in (0, 1):
        assert fitted.calibration.matrix[k][k] == pytest.approx(LENS.matrix[k][k], rel=0.01)
        assert fitted.calibration.matrix[k][2] == pytest.approx(LENS.matrix[k][2], abs=3.0)
    assert fitted.calibration.distortion[0] == pytest.approx(LENS.distortion[0], abs=0.02)
    directions = np.stack(np.meshgrid(np.linspace(-0.5, 0.5, 11), np.linspace(-0.35, 0.35, 9)), -1).reshape(-1, 2)
    off_px = np.linalg.norm(bent(fitted.calibration, directions) - bent(LENS, directions), axis=2)
    assert off_px.max() < 1.5
    assert fitted.calibration.error_px is not None
    assert fitted.calibration.error_px < 0.3
    assert abs(fitted.calibration.matrix[0][0] / LENS.matrix[0][0] - 1.0) < 5.0 * fitted.focal_sigma
    assert model_of(Lens(fitted.calibration)).hfov_deg == pytest.approx(model_of(Lens(LENS)).hfov_deg, abs=0.3)


def test_an_undistorted_image_matches_the_pinhole_model():
    """The corners appear where a centred pinhole camera with that width and field of view sees them."""
    lens = Lens(LENS)
    model = model_of(lens)
    for pose, picture in zip(POSES[:6], views(), strict=False):
        places = corners(lens.straightened(picture), BOARD)
        assert places is not None
        turn, middle = placed(pose)
        grid = BOARD.points - BOARD.points.mean(axis=0)
        ahead = grid @ turn.T + middle
        centre = np.array([model.width / 2 - 0.5, model.height / 2 - 0.5])  # pixel 0 is at 0.5 px
        wanted = ahead[:, :2] / ahead[:, 2:] * model.focal_px + centre
        measured = places.reshape(-1, 2)
        off = min((measured - wanted, measured - wanted[::-1]), key=lambda apart: np.abs(apart).max())
        assert np.abs(off).max() < 0.6
        assert np.abs(off.mean(axis=0)).max() < 0.15  # another pixel convention would shift the mean by 0.5 px


@pytest.mark.parametrize("lens", [LENS, FISHEYE])
def test_an_undistorted_image_has_the_widest_view_without_empty_corners(lens):
    """All rays along the edge lie in the camera's image, and at least one lies on the border of that image."""
    focal_px, size = model_of(Lens(lens)).focal_px, np.array([lens.width, lens.height])
    steps = np.linspace(-1.0, 1.0, 41)
    edge = [(a, b) for s in (-1.0, 1.0) for a, b in [*((s, t) for t in steps), *((t, s) for t in steps)]]
    places = bent(lens, np.array(edge) * (size - 1) / 2 / focal_px).reshape(-1, 2)
    room = np.minimum(places, size - 1 - places).min(axis=1)
    assert -1.5 < room.min() < 1.5


def test_a_fisheye_image_is_undistorted_to_a_pinhole_image():
    """A straight line in the world is a straight line in the undistorted image."""
    model = model_of(Lens(FISHEYE))
    assert 90.0 < model.hfov_deg < 120.0
    picture = np.zeros((480, 640, 3), np.uint8)
    line = np.array([[x, 0.45, 1.0] for x in np.linspace(-1.0, 1.0, 300)])
    matrix, bend = np.array(FISHEYE.matrix), np.array(FISHEYE.distortion)
    places = cv2.fisheye.distortPoints((line[:, :2] / line[:, 2:]).reshape(-1, 1, 2), matrix, bend).reshape(-1, 2)
    cv2.polylines(picture, [np.round(places * 16).astype(np.int32)], False, (255, 255, 255), 2, cv2.LINE_AA, 4)
    straight = Lens(FISHEYE).straightened(picture)[:, :, 1].astype(float)
    rows = np.arange(480)
    heights = [float((rows * straight[:, x]).sum() / straight[:, x].sum()) for x in range(120, 520, 40)]
    assert np.ptp(heights) < 0.5
    assert heights[0] == pytest.approx(0.45 * model.focal_px + 239.5, abs=0.5)


def test_without_a_calibration_the_image_is_unchanged_and_its_field_of_view_is_assumed():
    lens, picture = Lens(), np.random.default_rng(1).integers(0, 255, (90, 160, 3)).astype(np.uint8)
    assert lens.model is None
    assert lens.straightened(picture) is picture
    model = model_of(lens)
    assert (model.width, model.height, model.hfov_deg) == (160, 90, 90.0)


def test_an_image_of_another_size_than_the_calibration_is_rejected():
    with pytest.raises(UsageError, match=r"160×90.*640×480"):
        Lens(LENS).straightened(np.zeros((90, 160, 3), np.uint8))


@pytest.mark.parametrize("bend", [(-3.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.9, 0.9), (50.0, -900.0, 0.0, 0.0)])
def test_a_lens_with_non_invertible_distortion_is_rejected(bend):
    with pytest.raises(UsageError, match="distortion"):
        Lens(Calibration(640, 480, LENS.matrix, bend))


# -- invalid calibrations ----------------------------------------------------------------------------------------


def test_too_few_views_are_rejected(seen):
    with pytest.raises(UsageError, match=r"9×6.* 9 .* 10 "):
        fit(seen[:9], BOARD, 640, 480)


def test_a_wrong_board_size_is_rejected(seen):
    """A 6×9 board has as many corners as a 9×6 board, but the fit has a large error."""
    with pytest.raises(UsageError, match=r"\d+\.\d\d px.* 1 "):
        fit(seen, Board(6, 9, 0.025), 640, 480)


def test_views_without_a_tilted_board_are_rejected():
    """The fit looks perfect: the solver reports 0.01 % uncertainty, but the focal length is a third too short."""
    flat = [(0, 0, 2.0 * k, 0.5 * math.cos(k), 0.5 * math.sin(k), 0.33) for k in range(10)]
    with pytest.raises(UsageError, match="angle"):
        fit([corners_of(pose, 0.1) for pose in flat], BOARD, 640, 480)


def test_an_uncertain_focal_length_is_rejected():
    little = [
        (9 * math.cos(k), 9 * math.sin(k), 0.0, 0.5 * math.cos(2.4 * k), 0.5 * math.sin(2.4 * k), 0.33)
        for k in range(10)
    ]
    with pytest.raises(UsageError, match=r"\d+\.\d%.* 1%"):
        fit([corners_of(pose, 0.6) for pose in little], BOARD, 640, 480)


def test_views_only_in_the_image_centre_are_rejected():
    middle = [(30 * math.cos(k), 30 * math.sin(k), 9 * k, 0.0, 0.0, 0.42) for k in range(12)]
    with pytest.raises(UsageError, match=r"\d+%.* 50%"):
        fit([corners_of(pose, 0.1) for pose in middle], BOARD, 640, 480)


def test_an_image_without_the_board_has_no_corners():
    assert corners(np.full((480, 640, 3), 128, np.uint8), BOARD) is None
    assert corners(views()[0], Board(8, 7, 0.025)) is None


def test_a_view_is_new_if_the_board_has_moved(seen):
    assert not is_new(seen[0] + 3.0, seen[:1], 640)
    assert is_new(seen[1], seen[:1], 640)


def test_invalid_boards_are_rejected():
    for size in ["9", "9x", "axb", "2x9", "60x9", "6x6", "", "-9x6"]:
        assert "--board" in refusal(board_of, size, 0.025)


def test_a_square_size_that_is_implausible_in_metres_is_rejected():
    with pytest.raises(UsageError, match=r"--square.*0\.001.*10.*25"):
        board_of("9x6", 25.0)


# -- the file ------------------------------------------------------------------------------------------------------


def test_a_written_calibration_is_read_back(tmp_path):
    for ending in [".yml", ".yaml", ".json", ".xml"]:
        for lens in [LENS, FISHEYE]:
            save(lens, tmp_path / f"camera{ending}")
            assert load(tmp_path / f"camera{ending}") == lens, (ending, lens)


def test_a_file_written_by_opencv_is_read(tmp_path):
    """The file has the fields of OpenCV's calibration sample, with whole numbers among the coefficients."""
    path = tmp_path / "camera.yml"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("calibration_time", "some day")
    storage.write("image_width", 640)
    storage.write("image_height", 480)
    storage.write("camera_matrix", np.array(LENS.matrix))
    storage.write("distortion_coefficients", np.array([[-0.28], [0.09], [0.0], [0.0], [0.0]]))
    storage.write("avg_reprojection_error", 0.21)
    storage.release()
    assert load(path) == Calibration(640, 480, LENS.matrix, (-0.28, 0.09, 0.0, 0.0, 0.0), False, 0.21)


def matrix(rows, cols, data):
    return {"type_id": "opencv-matrix", "rows": rows, "cols": cols, "dt": "d", "data": data}


GOOD = {
    "image_width": 640,
    "image_height": 480,
    "camera_matrix": matrix(3, 3, [520.0, 0.0, 326.0, 0.0, 518.0, 236.0, 0.0, 0.0, 1.0]),
    "distortion_coefficients": matrix(1, 4, [-0.28, 0.09, 0.0, 0.0]),
}


def test_errors_in_a_file_are_named(tmp_path):
    changes: list[tuple[dict[str, Any], str]] = [
        ({"image_width": None}, "'image_width'"),
        ({"image_height": "tall"}, "'image_height'"),
        ({"image_width": -640}, "'image_width'"),
        ({"camera_matrix": None}, "'camera_matrix'"),
        ({"camera_matrix": matrix(2, 2, [1.0, 0.0, 0.0, 1.0])}, "'camera_matrix'.*3 × 3"),
        ({"camera_matrix": matrix(3, 3, [0.0] * 9)}, "'camera_matrix'.*640×480"),
        ({"image_width": 320}, "'camera_matrix'.*320×480"),
        ({"distortion_coefficients": matrix(1, 3, [0.0] * 3)}, "'distortion_coefficients'.* 4 or 5 or 8"),
        ({"fisheye_model": 1, "distortion_coefficients": matrix(1, 5, [0.0] * 5)}, "'distortion_coefficients'.* 4 "),
    ]
    for change, words in changes:
        path = tmp_path / "camera.json"
        path.write_text(json.dumps({name: value for name, value in {**GOOD, **change}.items() if value is not None}))
        assert re.search(words, refusal(load, path)), change


def test_unreadable_and_unwritable_files_are_reported(tmp_path):
    path = tmp_path / "camera.yml"
    for content in (b"", b"%YAML:1.0\n---\n: : [", b"camera_matrix:\n  rows: 3\n  cols: 3\n", b"\xff\xfe\x00", b"{"):
        path.write_bytes(content)
        with pytest.raises(UsageError, match=r"camera\.yml'"):
            load(path)
    with pytest.raises(UsageError, match=r"none\.yml"):
        load(tmp_path / "none.yml")
    with pytest.raises(UsageError, match=r"camera\.txt"):
        save(LENS, tmp_path / "camera.txt")
    with pytest.raises(UsageError, match=r"camera\.yml"):
        save(LENS, tmp_path / "no" / "camera.yml")


@given(st.text(max_size=200) | st.binary(max_size=200).map(lambda b: b.decode("latin-1")))
def test_random_file_contents_raise_a_usage_error(tmp_path_factory, text):
    path = tmp_path_factory.getbasetemp() / "nonsense.yml"
    path.write_text(f"%YAML:1.0\n---\n{text}", encoding="utf-8", errors="replace")
    with pytest.raises(UsageError, match=r"nonsense\.yml"):
        load(path)
