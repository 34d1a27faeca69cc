"""Video files and image folders, played at their recorded rate, and invalid camera sources."""

import threading
import time

import cv2
import numpy as np
import pytest

from foundation.errors import CameraError, UsageError
from hil.cameras.open import open_camera
from hil.cameras.stream import FolderSource, decoded, size_of
from tests.hil.cameras import picture_code
from tests.hil.cameras.host_clock import host_us
from tests.hil.cameras.http_cameras import jpeg
from tests.support.refusal import refusal

RATE_HZ = 20.0


def shown(camera):
    """Return all frames of a recording, up to the error at its end."""
    seen = [camera.newest()]

    def to_the_end():
        while True:
            seen.append(camera.following(seen[-1].frame_id))

    with pytest.raises(CameraError, match=r"\d\.\d s"):
        to_the_end()
    return seen


@pytest.fixture
def video(tmp_path):
    """Return the path of a 1 s video with numbered images."""
    path = tmp_path / "flight.mp4"
    size = (picture_code.WIDTH, picture_code.HEIGHT)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), RATE_HZ, size)
    for number in range(20):
        writer.write(np.frombuffer(picture_code.drawn(number), np.uint8).reshape(size[1], size[0], 3))
    writer.release()
    return path


@pytest.mark.parametrize("form", ["{}", "file://{}"])
def test_a_video_plays_at_its_own_rate_and_ends_with_an_error(video, form):
    camera = open_camera(form.format(video), host_us)
    first, *_ = seen = shown(camera)
    assert picture_code.read(first.image_rgb) == 0
    numbers = [picture_code.read(frame.image_rgb) for frame in seen]
    assert numbers == sorted(set(numbers))
    assert numbers[-1] >= 15  # a busy computer skips images, but does not lag
    seconds = (seen[-1].time_us - first.time_us) / 1e6
    assert seconds == pytest.approx((numbers[-1] - numbers[0]) / RATE_HZ, abs=0.25)
    camera.close()


def test_the_last_image_of_a_video_expires(video):
    camera = open_camera(str(video), host_us, max_age_s=0.3)
    shown(camera)
    threading.Event().wait(0.4)
    with pytest.raises(CameraError, match=r"0\.\d s"):
        camera.newest()
    camera.close()


def test_a_folder_plays_in_name_order_at_the_requested_rate(tmp_path):
    for number in range(6):
        (tmp_path / f"{number:03d}.jpg").write_bytes(jpeg(number))
    (tmp_path / "notes.txt").write_text("no picture")
    camera = open_camera(f"{tmp_path}?fps=5", host_us)
    seen = shown(camera)
    numbers = [picture_code.read(frame.image_rgb) for frame in seen]
    assert numbers == sorted(set(numbers))
    assert len(numbers) >= 4
    assert (seen[-1].time_us - seen[0].time_us) / 1e6 == pytest.approx((numbers[-1] - numbers[0]) / 5.0, abs=0.25)
    camera.close()


def test_a_fast_folder_starts_with_its_first_image(tmp_path):
    (tmp_path / "0.jpg").write_bytes(jpeg(7))
    source = FolderSource(str(tmp_path), 1000.0)
    source.open()
    time.sleep(0.01)  # ten images of this rate
    _, data = source.shoot(threading.Event())
    assert data == jpeg(7)


def test_a_recording_has_a_camera_for_drone_0_only(tmp_path):
    (tmp_path / "a.jpg").write_bytes(jpeg(1))
    camera = open_camera(str(tmp_path), host_us)
    with pytest.raises(CameraError, match="drone 2"):
        camera.newest(1)
    camera.close()


def test_invalid_cameras_are_reported_at_once(tmp_path):
    words = tmp_path / "words.mp4"
    words.write_text("not a video")
    empty = tmp_path / "empty"
    empty.mkdir()
    for url, error, word in [
        ("ftp://cam/1", UsageError, "http://"),
        ("no-such-file.mp4", UsageError, "http://"),
        ("v4l2:cam", UsageError, "v4l2:0"),
        ("v4l2:/dev/video97", CameraError, "v4l2:/dev/video97"),
        ("v4l2:97?size=big", UsageError, "WIDTHxHEIGHT"),
        ("v4l2:97?fps=30", UsageError, "'fps'"),
        (f"{empty}?fps=0", UsageError, "fps"),
        (str(empty), CameraError, str(empty)),
        (str(words), CameraError, "FFmpeg"),
        ("http://", UsageError, "'http://'"),
        ("http://192.168..1/x.jpg", UsageError, "192.168..1"),
        ("http://:80/x", UsageError, "http://:80/x"),
        ("\0", UsageError, "camera"),
        ("x" * 5000, UsageError, "xxx"),
    ]:
        assert word in refusal(open_camera, url, host_us, error=error)


@pytest.mark.parametrize(("url", "size"), [("v4l2:0", (1280, 720)), ("v4l2:0?size=640x480", (640, 480))])
def test_a_local_camera_is_asked_for_the_benchmarks_size_or_the_given_one(monkeypatch, url, size):
    asked: dict[int, float] = {}

    class Device:
        isOpened = staticmethod(lambda: True)  # noqa: N815
        set = staticmethod(asked.__setitem__)
        read = staticmethod(lambda: (False, None))
        release = staticmethod(lambda: None)

    monkeypatch.setattr(cv2, "VideoCapture", lambda *arguments: Device())
    open_camera(url, host_us).close()
    assert (asked[cv2.CAP_PROP_FRAME_WIDTH], asked[cv2.CAP_PROP_FRAME_HEIGHT]) == size


@pytest.mark.skip(reason="Video4Linux has not been run: it wants a camera, or the kernel module v4l2loopback")
def test_a_local_v4l2_camera_returns_an_image():
    camera = open_camera("v4l2:0", host_us)
    assert camera.newest().image_rgb.ndim == 3
    camera.close()


def test_size_option_is_parsed_as_width_and_height():
    assert size_of("1280x720") == size_of("1280X720") == (1280, 720)
    assert size_of(None) is None


def test_a_jpeg_with_an_impossible_size_is_not_decoded():
    data = bytearray(jpeg(1))
    header = data.index(b"\xff\xc0")  # start of the frame header; height and width follow 5 bytes later
    data[header + 5 : header + 9] = b"\xff\x00\xff\x00"
    assert decoded(bytes(data)) is None
