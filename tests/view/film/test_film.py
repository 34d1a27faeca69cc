"""A film file: the number and times of its pictures, resuming it, and its encoder."""

import json
import re
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from PIL import Image

from dronecats.cli.main import main
from dronecats.view.film import film as encoders
from dronecats.view.film.film import MANIFEST, draw_part, folder_beside, make, open_parts
from dronecats.view.film.plan import FilmPlan, filmable, plan
from foundation.errors import InfrastructureError, UsageError

SMALL = (320, 180)
# `dronecats film`; it stays in the middle of its second part until it is killed
ENDLESS = """
import sys, time
from dronecats.cli.main import main
from dronecats.view.film import film
pictures = film._pictures

def endless(plan, number):
    for count, picture in enumerate(pictures(plan, number)):
        while number and count == 10:
            time.sleep(1.0)
        yield picture

film._pictures = endless
sys.exit(main(["film", *sys.argv[1:]]))
"""


def wanted(folder, **options) -> FilmPlan:
    arguments = {"size": SMALL, "fps": 10, "speed": 1.0, "from_s": 1.0, "to_s": 2.0, "drone": None, **options}
    return plan(filmable(folder), **arguments)


def pictures(film):
    """Return the pictures of a film and its rate, by OpenCV's decoder."""
    reader = cv2.VideoCapture(str(film))
    frames: list[Any] = []
    rate = reader.get(cv2.CAP_PROP_FPS)
    while True:
        more, picture = reader.read()
        if not more:
            return frames, rate
        frames.append(picture)


def by_ffmpeg(film):
    """Return seconds, (width, height), rate and count of a film, by ffmpeg."""
    command = [str(encoders.ffmpeg()), "-hide_banner", "-i", str(film), "-f", "null", "-"]
    output = subprocess.run(command, capture_output=True, text=True, check=True).stderr
    length = re.search(r"Duration: (\d+):(\d+):([\d.]+)", output)
    video = re.search(r"Video: (\w+).*?, (\d+)x(\d+).*?, ([\d.]+) fps", output)
    assert length
    assert video
    hours, minutes, seconds = length.groups()
    count = int(re.findall(r"frame=\s*(\d+)", output)[-1])
    return {
        "codec": video[1], "seconds": 3600 * int(hours) + 60 * int(minutes) + float(seconds),
        "size": (int(video[2]), int(video[3])), "fps": float(video[4]), "count": count,
    }  # fmt: skip


def test_a_plan_has_the_requested_pictures_and_times(flight_folder):
    once = wanted(flight_folder)
    assert (once.pictures, once.closing, once.seconds) == (10, 0, 1.0)
    assert [once.time_of(k) for k in (0, 5, 9)] == pytest.approx([1.0, 1.5, 1.9])
    fast = wanted(flight_folder, speed=4.0, from_s=0.0, to_s=None, fps=30)
    assert fast.to_s == pytest.approx(6.0, abs=0.6)
    assert fast.moving == pytest.approx(fast.to_s / 4.0 * 30, abs=1)
    assert fast.closing == 75
    assert fast.time_of(fast.moving - 1) < fast.to_s == fast.time_of(fast.moving) == fast.time_of(fast.pictures - 1)
    assert [number for numbers in fast.part_ranges for number in numbers] == list(range(fast.pictures))


def test_impossible_options_are_rejected(flight_folder):
    for wrong in (
        {"size": (321, 180)}, {"size": (64, 36)}, {"size": (400, 720)}, {"fps": 0}, {"speed": 0.0},
        {"speed": float("nan")}, {"from_s": 2.0}, {"from_s": 99.0, "to_s": None}, {"from_s": float("nan")},
        {"drone": 3},
    ):  # fmt: skip
        with pytest.raises(UsageError):
            wanted(flight_folder, **wrong)


def test_drone_numbers_start_at_one(flight_folder, tmp_path, capsys):
    for number in ("0", "2"):
        assert main(["film", str(flight_folder), "--drone", number, "--out", str(tmp_path / "film.mp4")]) == 2
        assert re.search(rf"--drone {number} .*: 1 did", capsys.readouterr().err)


@pytest.fixture(scope="module")
def whole(pictured, composed, tmp_path_factory):
    """A one-second film in three parts, made in one run."""
    film = tmp_path_factory.mktemp("whole") / "film.mp4"
    assert make(replace(wanted(pictured), per_part=4), film, jobs=1) == "h264"
    return film


def test_the_decoded_film_has_the_right_size_rate_and_pictures(whole, composed):
    frames, rate = pictures(whole)
    assert (len(frames), rate, frames[0].shape) == (10, 10.0, (180, 320, 3))
    told_of = by_ffmpeg(whole)
    assert told_of == {
        "codec": "h264",
        "seconds": pytest.approx(1.0, abs=0.02),
        "size": SMALL,
        "fps": 10.0,
        "count": 10,
    }
    for number in (0, 5, 9):  # each picture shows exactly its own time
        t = 1.0 + number / 10
        off = {
            away: np.abs(frames[number] - composed.at(t + away)[..., ::-1].astype(int)).mean()
            for away in (-0.3, 0.0, 0.3)
        }
        assert off[0.0] < 6.0
        assert min(off, key=lambda away: off[away]) == 0.0
    assert not folder_beside(whole).exists()
    assert list(whole.parent.iterdir()) == [whole]


def test_existing_parts_are_not_drawn_again_and_the_film_is_the_same(pictured, composed, whole, tmp_path):
    film, of = tmp_path / "film.mp4", replace(wanted(pictured), per_part=4)
    with open_parts(film, of, "h264") as parts:
        draw_part(parts, 1)
        (parts.folder / "00002.making.mp4").write_bytes(b"torn by a kill")
        kept = parts.path(1).stat().st_mtime_ns
    with open_parts(film, of, "h264") as parts:
        assert parts.missing == [0, 2]
        assert parts.path(1).stat().st_mtime_ns == kept
        assert not (parts.folder / "00002.making.mp4").exists()
    already: list[int] = []

    def progress(done):
        already.append(done)
        return already.append

    make(of, film, jobs=1, progress=progress)
    assert already == [4, 4, 2]
    assert np.array_equal(pictures(film)[0], pictures(whole)[0])


def test_parts_of_another_film_are_discarded(pictured, composed, tmp_path):
    film, of = tmp_path / "film.mp4", replace(wanted(pictured), per_part=4)
    with open_parts(film, of, "h264") as parts:
        parts.path(0).write_bytes(b"an old one")
        with pytest.raises(UsageError, match=r"film\.mp4"), open_parts(film, of, "h264"):
            pass
    with open_parts(film, replace(of, speed=2.0), "h264") as parts:
        assert 0 in parts.missing
        assert json.loads((parts.folder / MANIFEST).read_text())["pictures"] == replace(of, speed=2.0).pictures


@pytest.mark.slow("draws a film in a process of its own")
def test_a_killed_film_resumes(pictured, composed, tmp_path):
    film = tmp_path / "film.mp4"
    options = ["--out", str(film), "--size", "320x180", "--to", "2.5", "--fps", "40", "--jobs", "1"]
    command = [sys.executable, "-c", ENDLESS, str(pictured), *options]
    process = subprocess.Popen(command, cwd=Path(__file__).parents[3])
    first = folder_beside(film) / "00000.mp4"
    while not first.exists():
        assert process.poll() is None, "it ended before it was killed"
        time.sleep(0.02)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert not film.exists()
    done: list[int] = []

    def progress(before):
        done.append(before)
        return lambda more: None

    make(wanted(pictured, from_s=0.0, to_s=2.5, fps=40), film, jobs=1, progress=progress)
    assert done[0] == 60  # one part
    assert (len(pictures(film)[0]), by_ffmpeg(film)["count"]) == (100, 100)
    assert not folder_beside(film).exists()


def test_without_ffmpeg_opencv_encodes_and_a_hint_is_printed(pictured, composed, tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    film = tmp_path / "film.mp4"
    options = ["--size", "320x180", "--from", "1", "--to", "2", "--fps", "10", "--jobs", "1"]
    assert main(["film", str(pictured), "--out", str(film), *options]) == 0
    assert "OpenCV" in (printed := capsys.readouterr().out)
    assert "dronecats[film]" in printed
    frames, rate = pictures(film)
    assert (len(frames), rate) == (10, 10.0)
    assert np.abs(frames[5] - composed.at(1.5)[..., ::-1].astype(int)).mean() < 6.0
    monkeypatch.undo()
    assert by_ffmpeg(film)["codec"] == "mpeg4"


def test_without_any_encoder_an_infrastructure_error_is_raised(pictured, composed, tmp_path, monkeypatch):
    monkeypatch.setattr(encoders, "ffmpeg", lambda: None)
    monkeypatch.setattr(cv2, "VideoWriter", _NoWriter)
    with pytest.raises(InfrastructureError):
        make(wanted(pictured), tmp_path / "film.mp4", jobs=1)


class _NoWriter:
    """An OpenCV without encoders."""

    fourcc = staticmethod(lambda *letters: 0)

    def __init__(self, *arguments):
        pass

    def isOpened(self):  # noqa: N802
        return False


def test_a_gif_has_all_frames_and_loops(pictured, composed, tmp_path):
    film = tmp_path / "small.gif"
    assert make(wanted(pictured, fps=5), film, jobs=1) == "gif"
    with Image.open(film) as gif:
        assert (getattr(gif, "n_frames", 1), gif.size, gif.info["loop"]) == (5, SMALL, 0)
        assert gif.info["duration"] == 200
        gif.seek(4)
        shown = np.asarray(gif.convert("RGB")).astype(int)
    assert np.abs(shown - composed.at(1.8)).mean() < 12.0


def test_a_gif_lasts_as_long_as_its_film(pictured, composed, tmp_path):
    """A GIF's times are hundredths of a second, and 30 pictures a second have none of equal length."""
    plan = wanted(pictured, fps=30)
    make(plan, tmp_path / "fast.gif", jobs=1)
    with Image.open(tmp_path / "fast.gif") as gif:
        lasted_ms = 0
        for number in range(getattr(gif, "n_frames", 1)):
            gif.seek(number)
            lasted_ms += gif.info["duration"]
    assert lasted_ms == pytest.approx(1e3 * plan.seconds, abs=10)


def test_parts_that_cannot_be_removed_are_a_usage_error(pictured, tmp_path):
    (folder_beside(tmp_path / "film.mp4") / "folder").mkdir(parents=True)
    with pytest.raises(UsageError, match=r"film\.mp4"), open_parts(tmp_path / "film.mp4", wanted(pictured), "h264"):
        pass


@pytest.mark.parametrize("name", ["", "truth.jsonl", "decisions.jsonl", "episode.json"])
def test_an_incomplete_episode_folder_is_a_one_line_error(pictured, tmp_path, capsys, name):
    folder = tmp_path / "run" / "episode"
    if name:
        folder.mkdir(parents=True)
        for each in ("truth.jsonl", "decisions.jsonl", "episode.json"):
            if each != name:
                (folder / each).write_bytes((pictured / each).read_bytes())
    assert main(["film", str(folder), "--out", str(tmp_path / "film.mp4")]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert not folder_beside(tmp_path / "film.mp4").exists()


@pytest.mark.parametrize("out", ["film.mkv", "", "a-file/film.mp4", "folder.mp4"])
def test_an_invalid_output_path_is_a_one_line_error(pictured, tmp_path, capsys, out):
    (tmp_path / "a-file").write_text("")
    (tmp_path / "folder.mp4").mkdir()
    assert main(["film", str(pictured), "--out", str(tmp_path / out)]) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1


def test_a_gif_with_an_mp4_name_is_rejected(pictured, tmp_path, capsys):
    assert main(["film", str(pictured), "--gif", "--out", str(tmp_path / "film.mp4")]) == 2
    assert ".gif" in capsys.readouterr().err


def test_a_gif_that_browsers_would_slow_down_is_rejected(pictured, tmp_path, capsys):
    film = tmp_path / "film.gif"
    assert main(["film", str(pictured), "--fps", "51", "--out", str(film)]) == 2
    assert "--fps of a GIF must be 50 or less, got 51" in capsys.readouterr().err
    assert not film.exists()
