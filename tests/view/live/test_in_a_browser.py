"""`dronecats fly --view` in real use: the command, a real browser, and the run folder afterwards."""

import json
import re
import socket
import subprocess
import sys
import threading
import time
from typing import Any

import cv2
import numpy as np
import pytest

from benchmarks.page_client import PageClient
from dronecats.view.scene import display
from foundation.run_folder import layout
from foundation.run_folder.reading import rows, truth
from foundation.run_folder.rows import Decision, Pose
from tests.support.ports import free_port

pytestmark = pytest.mark.slow("flies in real time while a browser looks on")
EPISODE = "residential-approaching-03"
PATIENCE_S = 150.0  # a software renderer, a simulator and a camera on two cores
NODE = "/world/flight/drone-0"


class FlownCommand:
    """The command and its output lines."""

    def __init__(self, *words: str) -> None:
        self.lines: list[str] = []
        self.process = subprocess.Popen(
            [sys.executable, "-m", "dronecats.cli.main", *words], stdout=subprocess.PIPE, text=True, bufsize=1
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stdout
        for line in self.process.stdout:
            self.lines.append(line.rstrip())

    def wait_for_line(self, pattern: str) -> "re.Match[str]":
        """Wait for a printed line that matches, and return the match."""
        due_s = time.monotonic() + PATIENCE_S
        while True:
            if match := next((m for line in list(self.lines) if (m := re.search(pattern, line))), None):
                return match
            assert time.monotonic() < due_s, self.lines
            assert self.process.poll() is None, self.lines
            self._reader.join(0.1)

    def end(self) -> None:
        """End it as Ctrl-C does, and wait for it."""
        self.process.send_signal(2)
        self.process.wait(30.0)


class Listening:
    """Collects all messages from the page to a browser."""

    def __init__(self, url: str) -> None:
        self.messages: list[dict[str, Any]] = []
        self._client = PageClient(url)
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def _listen(self) -> None:
        while not self._ending.is_set():
            self.messages += self._client.receive(0.2)

    def send(self, message: dict[str, Any]) -> None:
        self._client.send(message)

    def end(self) -> None:
        self._ending.set()
        self._thread.join(10.0)
        self._client.close()


def until(condition):
    """Wait until a condition is true, and return its value."""
    due_s = time.monotonic() + PATIENCE_S
    while not (value := condition()):
        assert time.monotonic() < due_s
        threading.Event().wait(0.1)
    return value


def text(browser, selector: str) -> str:
    """Return the text of an element; empty if it does not exist or is just changing."""
    script = "const e = document.querySelector(arguments[0]); return e ? e.textContent : ''"
    return str(browser.execute_script(script, selector))


def clock_s(browser) -> float | None:
    """Return the flight time that the page shows, s; None if it shows none."""
    match = re.match(r"([\d.]+) s\b.*in the air", text(browser, ".state"))
    return float(match[1]) if match else None


def canvas(browser) -> Any:
    """Return the pixels of the middle of the page, (H, W, 3)."""
    page: Any = cv2.imdecode(np.frombuffer(browser.get_screenshot_as_png(), np.uint8), cv2.IMREAD_COLOR)
    height, width = page.shape[:2]
    return page[height // 4 : 3 * height // 4, width // 3 : 2 * width // 3].astype(int)


@pytest.fixture(scope="module")
def seen(browser, tmp_path_factory):
    """Fly with a live page; yield the episode folder and all that the browser showed and received.

    Slow replies stretch the flight to a minute with a go most of the time, because a software renderer is late.
    """
    run, port = tmp_path_factory.mktemp("live") / "run", free_port(socket.SOCK_STREAM)
    command = FlownCommand(
        "fly", "--sitl", "--speed", "1", "--pilot", "vision", "--episode", EPISODE, "--latency", "fixed:8",
        "--out", str(run), "--view", "--view-port", str(port), "--view-stay",
    )  # fmt: skip
    try:
        url = command.wait_for_line(r"http://127\.0\.0\.1:\S+")[0]
        listening = Listening(url)
        browser.get(url)
        observed: dict[str, Any] = {"clocks": [until(lambda: clock_s(browser))]}
        until(lambda: "go" in text(browser, ".action"))
        observed["canvases"] = [canvas(browser)]
        observed["reply"] = text(browser, ".reply")
        observed["step"] = until(
            lambda: browser.execute_script("return document.querySelector('.action')?.dataset.step")
        )
        until(lambda: browser.execute_script("return document.querySelector('svg.ring')?.dataset.x"))
        observed["ring"] = browser.execute_script(
            "const r = document.querySelector('svg.ring'), f = r.closest('.frame'), i = f.querySelector('img');"
            "return {x: r.dataset.x, y: r.dataset.y, frame: f.dataset.frame, wide: i.naturalWidth,"
            "high: i.naturalHeight, near: [r.getBoundingClientRect().width, i.getBoundingClientRect().width]}"
        )
        until(lambda: (clock_s(browser) or 0.0) > observed["clocks"][0] + 3.0)
        observed["canvases"].append(canvas(browser))
        command.wait_for_line(r"stays open")
        until(lambda: "over" in text(browser, ".state"))
        observed["before"] = list(listening.messages)
        box = next(m for m in observed["before"] if m["type"] == "GuiCheckboxMessage")
        observed["judge-before"] = text(browser, ".judge")
        listening.send({"type": "GuiUpdateMessage", "uuid": box["uuid"], "updates": {"value": True}})
        observed["judge-after"] = until(lambda: text(browser, ".judge"))
        until(lambda: any("/judge/ring" in str(m.get("name")) for m in list(listening.messages)))
        observed["after"] = list(listening.messages)[len(observed["before"]) :]
        listening.end()
        observed["errors"] = [e["message"] for e in browser.get_log("browser") if e["level"] == "SEVERE"]
        yield run / EPISODE, observed
    finally:
        command.end()


def test_the_drone_is_shown_at_its_true_positions_and_moves(seen):
    folder, observed = seen
    sent = [display.ned_of(m["position"]) for m in observed["before"]
            if m["type"] == "SetPositionMessage" and m["name"] == NODE]  # fmt: skip
    assert len(sent) > 100
    poses = [row for row in truth(folder) if isinstance(row, Pose)]
    # compared with the lines between the sent positions, because a busy machine sends fewer positions
    ends = np.array(sent)
    starts, steps = ends[:-1], np.diff(ends, axis=0)
    lengths = np.maximum((steps**2).sum(axis=1), 1e-12)
    off_m = []
    for pose in poses:
        along = np.clip(((pose.position_ned - starts) * steps).sum(axis=1) / lengths, 0.0, 1.0)
        off_m.append(np.linalg.norm(starts + along[:, None] * steps - pose.position_ned, axis=1).min())
    assert float(np.percentile(off_m, 95)) < 0.1
    before, after = observed["canvases"]
    assert (np.abs(before - after).max(axis=2) > 40).mean() > 0.001  # nothing else of the page moves


def test_the_reply_and_the_ringed_frame_equal_the_log(seen):
    folder, observed = seen
    decisions = {str(one.step): one for one in rows(folder / layout.DECISIONS, Decision)}
    shown = decisions[observed["step"]]
    assert json.loads(observed["reply"]) in [json.loads(str(one.reply)) for one in decisions.values()]
    ring = observed["ring"]
    assert shown.kind == "go"
    ringed = next(one for one in decisions.values() if str(one.frame_id) == ring["frame"])
    assert ringed.action is not None
    assert [float(ring["x"]), float(ring["y"])] == ringed.action["point"]
    picture: Any = cv2.imread(str(folder / layout.FRAMES / layout.frame_name(ringed.frame_id)))
    assert (ring["high"], ring["wide"]) == picture.shape[:2]
    assert ring["near"][0] == pytest.approx(ring["near"][1], abs=1.0)  # the drawing covers the picture


def test_judge_data_is_sent_only_on_demand(seen):
    folder, observed = seen
    sent_text = json.dumps(observed["before"], default=str)
    verdict = json.loads((folder / layout.VERDICT).read_text())
    assert verdict["success"] is True
    for word in ("judge/", "(judge)", "declares", "verdict", f"{verdict['ne_m']:.2f} m"):
        assert word not in sent_text
    assert observed["judge-before"] == ""
    assert "verdict: success" in observed["judge-after"]
    assert "(judge)" in json.dumps(observed["after"], default=str)


def test_the_page_has_no_errors(seen):
    assert seen[1]["errors"] == []
