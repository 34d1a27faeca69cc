"""The command `dronecats camera`."""

import itertools
import json
import re
import subprocess
import sys
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from dronecats.cli import camera
from dronecats.cli.main import main
from hil.cameras.lens import load, save
from tests import pictures
from tests.hil.cameras.board_views import LENS, views
from tests.hil.cameras.http_cameras import HttpServer, MjpegServer, jpeg, reply


@pytest.fixture
def mjpeg():
    server = MjpegServer(20.0)
    yield server
    server.close()


def test_check_reports_the_rate_and_age_of_frames(mjpeg, tmp_path, capsys):
    saved = tmp_path / "frame.png"
    assert main(["camera", "check", mjpeg.url(), "--seconds", "1", "--save", str(saved), "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert (report["model"]["width"], report["model"]["height"]) == (256, 144)
    assert report["calibrated"] is False
    assert report["rate_hz"] == pytest.approx(20.0, abs=2.0)
    assert report["interval_ms"] == pytest.approx(50.0, abs=10.0)
    assert 0.0 <= report["age_ms"] < 50.0
    assert report["repeated"] == 0
    assert pictures.read(saved).shape == (144, 256, 3)


def test_check_counts_repeated_frames(tmp_path, capsys):
    """A recording of 1.5 s at 20 Hz in which every second image repeats the first."""
    for number in range(30):
        (tmp_path / f"{number:03d}.jpg").write_bytes(jpeg(number // 2))
    assert main(["camera", "check", f"{tmp_path}?fps=20", "--seconds", "10", "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["frames"] == pytest.approx(30, abs=2)
    assert report["repeated"] == pytest.approx(15, abs=2)


def test_check_prints_text_without_the_password(mjpeg, capsys):
    assert main(["camera", "check", mjpeg.url(user="pilot:hush"), "--seconds", "0.5"]) == 0
    output = capsys.readouterr().out
    assert re.search("256×144 px, 90.0°", output)
    assert "hush" not in output


def test_check_marks_a_snapshot_url_as_polled(capsys):
    server = HttpServer(lambda handler: reply(handler, 200, jpeg(1)))
    assert main(["camera", "check", server.url(), "--seconds", "0.5", "--json"]) == 0
    server.close()
    report = json.loads(capsys.readouterr().out)
    assert report["asked"] is True
    assert report["repeated"] == report["frames"] - 1


def test_check_reports_no_age_for_frames_with_vehicle_timestamps(capsys):
    """A simulated camera stamps its frames. The host's clock can be hours ahead of the vehicle's."""
    stamps = {"X_Frame_Id": "7", "X_Frame_Time_Us": "1000"}
    server = HttpServer(lambda handler: reply(handler, 200, jpeg(1), **stamps))
    assert main(["camera", "check", server.url(), "--seconds", "0.5", "--json"]) == 0
    server.close()
    assert json.loads(capsys.readouterr().out)["age_ms"] is None


def test_check_uses_the_result_of_calibrate(tmp_path, capsys):
    out = tmp_path / "camera.yml"
    boards = tmp_path / "boards"
    boards.mkdir()
    for number, picture in enumerate(views()):
        cv2.imwrite(str(boards / f"{number:02d}.png"), picture)
    command = ["camera", "calibrate", str(boards), "--board", "9x6", "--square", "0.025", "--out", str(out)]
    assert main(command) == 0
    output = capsys.readouterr().out
    assert re.search(r"\b14\b", output)
    assert load(out).matrix[0][0] == pytest.approx(LENS.matrix[0][0], rel=0.01)
    assert main(["camera", "check", str(boards), "--calibration", str(out), "--seconds", "1", "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["calibrated"] is True
    assert report["model"]["hfov_deg"] == pytest.approx(65.8, abs=0.5)


@pytest.mark.slow
def test_live_calibration_uses_each_view_once(tmp_path, capsys, monkeypatch):
    """The camera shows each board several times. The clock of the command counts the pictures."""
    out = tmp_path / "camera.json"
    shown = [cv2.imencode(".png", picture)[1].tobytes() for picture in views()]
    requests = itertools.count()
    clock = SimpleNamespace(now_s=0.0)
    clock.monotonic = lambda: clock.now_s
    monkeypatch.setattr(camera, "time", clock)

    def show(handler):
        clock.now_s = float(next(requests))
        reply(handler, 200, shown[min(int(clock.now_s) // 2, len(shown) - 1)])

    server = HttpServer(show)
    command = ["camera", "calibrate", server.url(), "--square", "0.025", "--out", str(out), "--seconds", "40", "--json"]
    assert main(command) == 0
    server.close()
    report = json.loads(capsys.readouterr().out)
    assert report["views"] == len(shown)
    assert load(out).matrix[0][0] == pytest.approx(LENS.matrix[0][0], rel=0.01)


def test_errors_name_the_cause_and_set_the_exit_status(tmp_path, capsys, mjpeg):
    empty, other, words = tmp_path / "empty", tmp_path / "other.yml", tmp_path / "words.yml"
    empty.mkdir()
    save(LENS, other)
    words.write_text("not a calibration")
    board = ["--square", "0.025", "--out", str(tmp_path / "camera.yml")]
    for arguments, status, expected in [
        (["check", "http://pilot:hush@127.0.0.1:1/x"], 3, "***@127.0.0.1:1/x"),
        (["check", "nowhere"], 2, "nowhere"),
        (["check", mjpeg.url(), "--seconds", "0"], 2, "--seconds"),
        (["check", mjpeg.url(), "--save", "frame.words"], 2, ".jpg"),
        (["check", mjpeg.url(), "--seconds", "0.1", "--save", "/no/such/frame.png"], 2, "/no/such/frame.png"),
        (["check", mjpeg.url(), "--calibration", str(other)], 2, "640×480"),
        (["check", mjpeg.url(), "--calibration", str(words)], 2, str(words)),
        (["calibrate", str(empty), *board], 2, " 10 "),
        (["calibrate", str(empty), "--board", "9", *board], 2, "--board"),
        (["calibrate", str(empty), "--square", "0.025", "--out", "camera.txt"], 2, "camera.txt"),
    ]:
        assert main(["camera", *arguments]) == status, arguments
        error = capsys.readouterr().err
        assert expected in error, arguments
        assert "hush" not in error


def test_calibration_images_of_different_sizes_are_rejected(tmp_path, capsys):
    for number, size in enumerate([(480, 640, 3), (240, 320, 3)]):
        cv2.imwrite(str(tmp_path / f"{number}.png"), np.zeros(size, np.uint8))
    assert main(["camera", "calibrate", str(tmp_path), "--square", "0.1", "--out", str(tmp_path / "x.yml")]) == 2
    assert "1.png" in capsys.readouterr().err


def test_the_command_module_imports_no_heavy_packages():
    code = "import sys, dronecats.cli.camera; sys.exit(any(m in sys.modules for m in ('cv2', 'numpy', 'httpx')))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
