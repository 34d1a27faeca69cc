"""The page beside a command: a failure of the page never affects the flight."""

import os
import signal
import threading
import time

import pytest

from dronecats.flight.processes import supervisor
from dronecats.flight.processes.supervisor import ChildKind, ChildProcess
from dronecats.view.live import opening
from dronecats.view.live.config import ViewerConfig
from dronecats.view.live.opening import WantedPage, opened

PATIENCE_S = 60.0


class Notices:
    """Collects the notices, and can wait for one of them."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self._came = threading.Condition()

    def __call__(self, line: str) -> None:
        with self._came:
            self.lines.append(line)
            self._came.notify_all()

    def wait(self, words: str) -> None:
        with self._came:
            assert self._came.wait_for(lambda: any(words in line for line in self.lines), PATIENCE_S), self.lines


@pytest.fixture
def children(monkeypatch):
    """Return the started processes."""
    made: list[ChildProcess] = []

    def start(*arguments):
        made.append(ChildProcess(*arguments))
        return made[-1]

    monkeypatch.setattr(opening, "ChildProcess", start)
    return made


def gone(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    return False


def test_without_a_page_no_process_starts(tmp_path, children):
    with opened(None, tmp_path, "", Notices()):
        pass
    assert children == []


def test_the_address_is_printed_and_the_page_ends_with_the_command(tmp_path, children, port):
    log = Notices()
    with opened(WantedPage(port=port), tmp_path, "vision", log):
        log.wait(f"http://127.0.0.1:{port}")
    assert gone(children[0].pid)
    assert len(log.lines) == 1


class HangingViewer:
    """A page that never becomes ready."""

    def __init__(self, config):
        threading.Event().wait()


def test_a_hanging_page_does_not_delay_the_command(tmp_path, children, port, monkeypatch):
    monkeypatch.setattr(opening, "VIEWER", ChildKind("viewer", f"{__name__}:HangingViewer", ViewerConfig))
    monkeypatch.setattr(supervisor, "CLOSE_S", 600.0)
    log, began_s = Notices(), time.monotonic()
    with opened(WantedPage(port=port, stays=True), tmp_path, "", log):
        os.kill(children[0].pid, signal.SIGSTOP)
    assert time.monotonic() - began_s < supervisor.CLOSE_S / 2
    assert gone(children[0].pid)
    assert log.lines == []


def test_a_page_that_cannot_be_opened_is_only_reported(tmp_path, monkeypatch, port):
    monkeypatch.setattr(opening, "VIEWER", ChildKind("viewer", "dronecats.view.live.nowhere:Nobody", ViewerConfig))
    log, has_flown = Notices(), False
    with opened(WantedPage(port=port), tmp_path, "", log):
        log.wait("")
        has_flown = True
    assert has_flown


def test_exceptions_of_the_flight_pass_through(tmp_path, children, port):
    with pytest.raises(KeyboardInterrupt), opened(WantedPage(port=port), tmp_path, "", Notices()):
        raise KeyboardInterrupt
    assert gone(children[0].pid)
