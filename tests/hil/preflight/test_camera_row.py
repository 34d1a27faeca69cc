"""The camera row of the preflight check, measured with a fake camera."""

import time
import weakref

import numpy as np
import pytest

import hil.cameras.open as cameras
from foundation.camera import Frame
from hil.preflight import ground_side


def now_us():
    return time.monotonic_ns() // 1000


class FakeCamera:
    """Returns each image twice, and counts the images that are in memory."""

    def __init__(self):
        self.reads, self.images_now, self.images_most = 0, 0, 0

    def newest(self):
        if self.reads % 2 == 0:
            image = np.zeros((90, 160, 3), np.uint8)
            self.frame = Frame(frame_id=self.reads, drone=0, time_us=now_us(), image_rgb=image)
            self.images_now += 1
            self.images_most = max(self.images_most, self.images_now)
            weakref.finalize(image, self.forget_image)
        self.reads += 1
        return self.frame

    def forget_image(self):
        self.images_now -= 1

    def close(self):
        pass


def test_the_camera_row_counts_new_frames_and_keeps_only_the_newest_in_memory(monkeypatch):
    camera = FakeCamera()
    monkeypatch.setattr(cameras, "open_camera", lambda url, now_us: camera)
    began_us = now_us()
    row = ground_side.camera_row("fake:", now_us, lambda: time.sleep(0.01), 0.5)
    took_s = (now_us() - began_us) / 1e6
    assert row.passed is True
    size, rate = row.why.split()[:2]
    assert size == "160×90,"
    assert float(rate) * took_s == pytest.approx(camera.reads / 2, rel=0.2)
    assert camera.images_most <= 3
