"""A head is served like a model. The tests send real requests over HTTP."""

import base64
import json

import httpx
import numpy as np
import pytest

from dronecats.agent.action import Finished, Go
from dronecats.agent.prompt import History, Prompt
from dronecats.agent.reply.strict import parse, parse_fleet
from dronecats.cli.main import main
from dronecats.pilots.server import PilotServer
from examples.action_head import serve
from examples.action_head.pilot import COLUMNS, ROWS, TURNS_DEG, Outlook, pilot
from foundation.camera import CameraModel, encode
from foundation.errors import UsageError
from tests.needs import needs


def reddest(picture, words, past):
    """A head without training: it goes to the reddest place of the picture."""
    red = picture[0].astype(int) - picture[1:].max(0)
    cells = red.reshape(ROWS, 8, COLUMNS, 8).mean((1, 3))
    heat = (cells == cells.max()).astype(np.float32)
    arrived = 0.9 * float(past[1])  # it declares on the first picture after a turn
    return Outlook(
        np.array([0.95 - arrived, 0.0, 0.0, arrived], np.float32), heat, 6.0, np.zeros(len(TURNS_DEG), np.float32)
    )


@pytest.fixture
def served():
    with PilotServer(pilot(reddest, 0.5), serve.NAME) as server:
        yield server


def disc(x, y):
    shown = np.full((720, 1280, 3), 128, np.uint8)
    shown[y - 40 : y + 40, x - 40 : x + 40] = (230, 20, 20)
    return encode(shown)


def post_question(server, pictures, past=None):
    drones = max(1, len(pictures))
    history = past or "\n".join(f"Drone {k + 1}:\n{History(CameraModel()).render()}" for k in range(drones))
    prompt = Prompt.load().render("go to the red disc", history, 5, drones=drones)
    parts: list[dict[str, object]] = [{"type": "text", "text": prompt}]
    for jpeg in pictures:
        url = "data:image/jpeg;base64," + base64.b64encode(jpeg).decode()
        parts.append({"type": "image_url", "image_url": {"url": url}})
    body = {"model": serve.NAME, "messages": [{"role": "user", "content": parts}]}
    return httpx.post(f"{server.base_url}/chat/completions", json=body, timeout=30.0)


def test_a_go_points_at_the_object_in_the_picture(served):
    action = parse(post_question(served, [disc(960, 180)]).json()["choices"][0]["message"]["content"])
    assert isinstance(action, Go)
    assert action.x == pytest.approx(750, abs=32)
    assert action.y == pytest.approx(250, abs=56)


def test_each_drone_of_a_fleet_gets_an_action_for_its_own_picture(served):
    text = post_question(served, [disc(320, 360), disc(960, 360)]).json()["choices"][0]["message"]["content"]
    left, right = parse_fleet(text, 2)
    assert isinstance(left, Go)
    assert isinstance(right, Go)
    assert left.x == pytest.approx(250, abs=32)
    assert right.x == pytest.approx(750, abs=32)


def test_each_drone_of_a_fleet_has_its_own_history(served):
    past = "Drone 1:\n(none yet — this is the first step)\nDrone 2:\n1. ROTATE angle=90deg  <- latest"
    text = post_question(served, [disc(320, 360)] * 2, past).json()["choices"][0]["message"]["content"]
    went, turned = parse_fleet(text, 2)
    assert isinstance(went, Go)
    assert turned == Finished()


def test_a_request_without_a_picture_is_rejected(served):
    response = post_question(served, [])
    assert response.status_code == 400
    assert "picture" in response.json()["error"]["message"]


def test_models_check_accepts_the_served_head(served, capsys):
    assert main(["models", "check", f"local/{serve.NAME}", "--base-url", served.base_url, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)


@needs("torch")
def test_a_saved_head_is_served(tmp_path):
    """The head is untrained, because the code path is the same for any weights."""
    from examples.action_head.network import ActionHead, save
    from examples.action_head.settings import Shape

    file = tmp_path / "head.pt"
    save(file, ActionHead(Shape(16, 4, 8)), 0.0, {})
    with serve.server(file, 0, 1) as server:
        text = post_question(server, [disc(640, 360)]).json()["choices"][0]["message"]["content"]
    assert parse(text) == Finished()  # the threshold is 0, so any probability declares


def test_invalid_ports_and_thread_counts_are_rejected():
    for words in (["--port", "65536"], ["--threads", "0"]):
        with pytest.raises(UsageError, match=words[0]):
            serve.main(["head.pt", *words])
