"""A flight with a live page writes the same bytes as one without, even if the page hangs or is killed."""

import contextlib
import os
import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from benchmarks.page_client import PageClient
from dronecats.agent.prompt import Prompt
from dronecats.flight.processes.supervisor import ChildProcess
from dronecats.flight.run.fly import fly
from dronecats.flight.spec.flight_spec import FlightSpec, Simulated
from dronecats.view.live.config import ViewerConfig
from dronecats.view.live.folder import load_world
from dronecats.view.live.follow import FlightFollower
from dronecats.view.live.opening import VIEWER
from foundation.run_folder import layout
from foundation.run_folder.reading import rows
from foundation.run_folder.rows import Decision, LoggedPrompt

pytestmark = pytest.mark.slow
EPISODE = "residential-approaching-03"
SPEC = FlightSpec(pilot="vision", episode=EPISODE, simulated=Simulated(speed=None), seconds=12.0)
COMPARED = (layout.TRUTH, layout.DECISIONS, layout.VERDICT, layout.TLOG, layout.EPISODE, layout.IDENTITY)
PATIENCE_S = 60.0


def contents(run: Path) -> dict[str, bytes]:
    folder = run / EPISODE
    frames = sorted((folder / layout.FRAMES).iterdir())
    assert frames
    return {path.name: path.read_bytes() for path in (*(folder / name for name in COMPARED), *frames)}


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """Return the run folder of a flight without a page, and the prompts to its pilot."""
    out, questions, render = tmp_path_factory.mktemp("alone"), [], Prompt.render

    def recording_render(*arguments, **named):
        questions.append(render(*arguments, **named))
        return questions[-1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Prompt, "render", recording_render)
        fly(SPEC, out, lambda line: None)
    return out, questions


class Watched:
    """A live page of a run folder, with an event at some steps of the flight."""

    def __init__(self, run: Path, scratch: Path) -> None:
        self.run, self.scratch = run, scratch
        self.viewers: list[ChildProcess] = []
        self.clients: list[PageClient] = []
        self.happened: list[str] = []
        self.url = self.open()

    def open(self) -> str:
        config = ViewerConfig(root=str(self.run), port=0)
        self.viewers.append(ChildProcess(VIEWER, config, self.scratch / f"viewer-{len(self.viewers)}.log"))
        return str(self.viewers[-1].ready()["url"])

    def look(self) -> None:
        """Connect, and check that the drone is on the page."""
        self.clients.append(PageClient(self.url))
        self.clients[-1].until(lambda sent: str(sent.get("name", "")).endswith("/drone-0"), PATIENCE_S)

    def at(self, step: int) -> None:
        """Trigger the event of a step, if there is one."""
        viewer = self.viewers[-1]
        todo: dict[int, tuple[str, Callable[[], None]]] = {
            0: ("looked at", self.look),
            1: ("hung, with somebody who looks", lambda: os.kill(viewer.pid, signal.SIGSTOP)),
            2: ("killed and opened again, with two who look", self._again),
        }
        if step in todo:
            words, act = todo[step]
            act()
            self.happened.append(words)

    def _again(self) -> None:
        self.viewers[-1].kill()
        self.url = self.open()
        self.look()
        self.look()

    def close(self) -> None:
        for client in self.clients:
            with contextlib.suppress(Exception):  # its page was killed
                client.close()
        for viewer in self.viewers:
            viewer.kill()


def test_a_page_that_hangs_and_restarts_does_not_change_the_run_folder(alone, tmp_path):
    out = tmp_path / "watched"
    steps: list[str] = []
    (tmp_path / "logs").mkdir()
    watched = Watched(out, tmp_path / "logs")

    def say(line: str) -> None:
        if line[:4].strip().isdigit() and "t=" in line:
            watched.at(len(steps))
            steps.append(line)

    try:
        fly(SPEC, out, say)
        assert len(watched.happened) == 3
        before, after = contents(alone[0]), contents(out)
        assert before.keys() == after.keys()
        assert [name for name in before if before[name] != after[name]] == []
        assert sorted(p.name for p in (out / EPISODE).iterdir()) == sorted(
            p.name for p in (alone[0] / EPISODE).iterdir()
        )
    finally:
        watched.close()


def test_the_page_shows_the_prompts_of_the_pilot(alone):
    out, questions = alone
    folder = out / EPISODE
    follower = FlightFollower(folder, load_world(folder), 1)
    decided = list(rows(folder / layout.DECISIONS, Decision))
    assert len(decided) > 2
    shown = []
    for prompt in rows(folder / layout.PROMPTS, LoggedPrompt):
        follower._take_prompt(prompt)
    for decision in decided:
        follower._take_decisions([decision])
        shown.append(follower._drone(0).prompt)
    assert shown == questions[: len(decided)]
