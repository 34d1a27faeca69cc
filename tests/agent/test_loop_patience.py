"""A hanging camera does not keep a vehicle in the air for longer than the pilot's patience (`patience_s`)."""

import threading

import pytest

from dronecats.agent.cockpit import Cockpit
from dronecats.agent.latency import LatencyPolicy
from dronecats.agent.loop import PaperAgent, Questions
from dronecats.agent.models.model import Reply
from dronecats.agent.prompt import Prompt
from foundation.camera import CameraModel
from foundation.errors import CameraError
from foundation.run_folder.writing import LineLog
from foundation.threads import DaemonExecutor
from tests.agent.flown_wire import Clock


class StuckCamera:
    def __init__(self):
        self.free = threading.Event()

    def newest(self, drone=0):
        self.free.wait()
        raise CameraError("the camera was let go")

    def close(self):
        self.free.set()


class Model:
    name = "never asked"

    def check(self):
        pass

    def ask(self, request):
        return Reply("", 0.0)

    def close(self):
        pass


def test_a_camera_that_hangs_ends_the_flight(tmp_path):
    camera = StuckCamera()
    cockpit = Cockpit(
        aircraft=[Clock()], camera=camera, camera_model=CameraModel(), log=LineLog(tmp_path / "d.jsonl"),
        frames_dir=tmp_path, executor=DaemonExecutor(), t0_us=0,
    )  # fmt: skip
    agent = PaperAgent(
        Questions(Model(), Prompt.load(None), "go", LatencyPolicy.parse("real"), patience_s=5.0), cockpit
    )
    with pytest.raises(CameraError, match="5 s"):
        agent.fly(300.0)
    assert agent.now_s < 6.0
    camera.free.set()
