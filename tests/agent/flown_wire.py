"""The agent's loop against a local HTTP endpoint. Records every request and gives scripted replies."""

import base64
import contextlib
import json
import threading
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import numpy as np

from dronecats.agent.cockpit import Cockpit
from dronecats.agent.latency import LatencyPolicy
from dronecats.agent.loop import PaperAgent, Questions
from dronecats.agent.models.spec import ModelSpec
from dronecats.agent.models.wire_formats import open_model
from dronecats.agent.prompt import Prompt
from foundation.camera import CameraModel, Frame
from foundation.run_folder.writing import LineLog
from foundation.setpoints import Hold, PicturePose
from foundation.threads import InlineExecutor
from tests.support.json_lines import rows

CAMERA = CameraModel()


class Clock:
    """A vehicle with only a clock."""

    def __init__(self):
        self.time_us = 0
        self.flown = []

    steady = True

    def sight(self, time_us):
        return PicturePose((0.0, 0.0, 0.0), 0.0)

    def fly(self, setpoint, seconds=None, seen=None):
        if not isinstance(setpoint, Hold):
            self.flown.append(setpoint)

    def listen(self):
        pass

    def tick(self):
        self.time_us += 50_000


class Views:
    """A camera with a different image for every frame and drone, wider than the images on the wire."""

    def __init__(self, height=720, width=1280):
        self.size = (height, width)
        self.taken = 0

    def picture(self, frame_id):
        coarse = np.random.default_rng(frame_id).integers(0, 255, (9, 16, 3), np.uint8)
        rows = np.linspace(0, 8.99, self.size[0]).astype(int)
        columns = np.linspace(0, 15.99, self.size[1]).astype(int)
        return np.ascontiguousarray(coarse[rows][:, columns])

    def close(self):
        pass

    def newest(self, drone=0):
        self.taken += 1
        return Frame(self.taken, drone, 0, self.picture(self.taken))


@dataclass
class Endpoint:
    """A chat completion server that records every request. It gives the replies in order and repeats the last."""

    replies: list[str]
    bodies: list[dict[str, Any]] = field(default_factory=list)

    def __enter__(self):
        endpoint = self

        class Handler(BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def do_POST(self):
                body = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
                text = endpoint.replies[min(len(endpoint.bodies), len(endpoint.replies) - 1)]
                endpoint.bodies.append(body)
                data = json.dumps({"choices": [{"message": {"content": text}}]}).encode()
                self.send_response(200)
                self.send_header("Content-Length", str(len(data)))
                self.end_headers()
                with contextlib.suppress(ConnectionError):
                    self.wfile.write(data)

            def log_message(self, *_):
                pass

        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        threading.Thread(target=self._server.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True).start()
        self.url = f"http://127.0.0.1:{self._server.server_port}/v1"
        return self

    def __exit__(self, *_):
        self._server.shutdown()
        self._server.server_close()

    @property
    def texts(self):
        return [body["messages"][0]["content"][0]["text"] for body in self.bodies]

    @property
    def jpegs(self):
        """The bytes of the images, per request."""
        parts = [body["messages"][0]["content"] for body in self.bodies]
        urls = [[part["image_url"]["url"] for part in several if "image_url" in part] for several in parts]
        return [[base64.b64decode(url.partition(",")[2], validate=True) for url in several] for several in urls]


def fly(endpoint, folder, *, steps, drones=1, provider="openrouter", views=None, axis_order="xy", prompt=None):
    """Fly steps with the production loop, history, image, prompt and client; return (decisions, camera, vehicles)."""
    folder.mkdir(exist_ok=True)
    views = views or Views()
    vehicles = [Clock() for _ in range(drones)]
    model = open_model(ModelSpec(provider=provider, name="maker/model-1", base_url=endpoint.url))
    log = LineLog(folder / "decisions.jsonl")
    questions = Questions(
        model, prompt or Prompt.load(None), "go to the cyan SUV", LatencyPolicy.parse("fixed:0"), axis_order=axis_order
    )
    cockpit = Cockpit(
        aircraft=vehicles, camera=views, camera_model=CAMERA, log=log,
        frames_dir=folder, executor=InlineExecutor(), t0_us=0,
    )  # fmt: skip
    agent = PaperAgent(questions, cockpit)
    agent.fly(stop=lambda decision: decision.step + 1 == steps and decision.drone + 1 == drones)
    log.close()
    model.close()
    decisions = rows(folder / "decisions.jsonl")
    return decisions, views, vehicles
