"""Video files and folders of pictures, at the pace at which they were taken; what is no camera at all."""

import threading

import cv2
import numpy as np
import pytest

from foundation.errors import CameraError, UsageError
from hil.cameras.open import open_camera
from tests.hil.cameras import picture_code
from tests.hil.cameras.host_clock import host_us
from tests.hil.cameras.http_cameras import jpeg

RATE_HZ = 20.0


def shown(camera, end):
    """Return every frame of a recording; `end` is how it says that it is over."""
    seen = [camera.newest()]

    def to_the_end():
        while True:
            seen.append(camera.following(seen[-1].frame_id))

    with pytest.raises(CameraError, match=rf"gives no frame: the last one is \d\.\d s old; {end}"):
        to_the_end()
    return seen


@pytest.fixture
def video(tmp_path):
    """Return the path of a video of two seconds, its pictures numbered."""
    path = tmp_path / "flight.mp4"
    size = (picture_code.WIDTH, picture_code.HEIGHT)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), RATE_HZ, size)
    for number in range(40):
        writer.write(np.frombuffer(picture_code.drawn(number), np.uint8).reshape(size[1], size[0], 3))
    writer.release()
    return path


@pytest.mark.parametrize("form", ["{}", "file://{}"])
def test_a_video_is_shown_at_its_own_pace_and_then_it_is_over(video, form):
    camera = open_camera(form.format(video), host_us)
    first, *_ = seen = shown(camera, "the video is over")
    assert picture_code.read(first.image_rgb) == 0
    numbers = [picture_code.read(frame.image_rgb) for frame in seen]
    assert numbers == sorted(set(numbers))
    assert numbers[-1] >= 35  # a busy computer misses some; it is never behind
    seconds = (seen[-1].time_us - first.time_us) / 1e6
    assert seconds == pytest.approx((numbers[-1] - numbers[0]) / RATE_HZ, abs=0.25)
    camera.close()


def test_the_last_picture_of_a_video_is_no_frame_for_ever(video):
    camera = open_camera(str(video), host_us, max_age_s=0.3)
    shown(camera, "the video is over")
    threading.Event().wait(0.4)
    with pytest.raises(CameraError, match=r"the last one is 0\.\d s old; the video is over"):
        camera.newest()
    camera.close()


def test_a_folder_is_shown_in_the_order_of_its_names_at_the_rate_asked_for(tmp_path):
    for number in range(6):
        (tmp_path / f"{number:03d}.jpg").write_bytes(jpeg(number))
    (tmp_path / "notes.txt").write_text("no picture")
    camera = open_camera(f"{tmp_path}?fps=5", host_us)
    seen = shown(camera, "the pictures of the folder are over")
    numbers = [picture_code.read(frame.image_rgb) for frame in seen]
    assert numbers == sorted(set(numbers))
    assert len(numbers) >= 4
    assert (seen[-1].time_us - seen[0].time_us) / 1e6 == pytest.approx((numbers[-1] - numbers[0]) / 5.0, abs=0.25)
    camera.close()


def test_a_camera_is_one_drones(tmp_path):
    (tmp_path / "a.jpg").write_bytes(jpeg(1))
    camera = open_camera(str(tmp_path), host_us)
    with pytest.raises(CameraError, match="of drone 1: it is one drone's camera"):
        camera.newest(1)
    camera.close()


def test_what_is_no_camera_is_said_at_once(tmp_path):
    words = tmp_path / "words.mp4"
    words.write_text("not a video")
    empty = tmp_path / "empty"
    empty.mkdir()
    for url, error, said in [
        ("ftp://cam/1", UsageError, "is no camera: use http://"),
        ("no-such-file.mp4", UsageError, "is no camera: use http://"),
        ("v4l2:cam", UsageError, "should read v4l2:0"),
        ("v4l2:/dev/video97", CameraError, "the device cannot be opened"),
        ("v4l2:97?size=big", UsageError, "WIDTHxHEIGHT"),
        ("v4l2:97?fps=30", UsageError, "option 'fps' is unknown for a v4l2 camera"),
        (f"{empty}?fps=0", UsageError, "fps wants a number"),
        (str(empty), CameraError, "holds no picture"),
        (str(words), CameraError, "no video file that FFmpeg can read"),
        ("http://", UsageError, "is no camera"),
        ("http://:80/x", UsageError, "is no http address"),
        ("\0", UsageError, "is no camera"),
        ("x" * 5000, UsageError, "is no camera"),
    ]:
        with pytest.raises(error, match=said):
            open_camera(url, host_us)


@pytest.mark.skip(reason="Video4Linux has not been run: it wants a camera, or the kernel module v4l2loopback")
def test_a_camera_of_this_computer():
    camera = open_camera("v4l2:0", host_us)
    assert camera.newest().image_rgb.ndim == 3
    camera.close()
