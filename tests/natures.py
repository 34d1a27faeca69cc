"""Marks each test with its nature (what it needs), and fails a test that needs more than its nature allows.

The natures are ordered; each includes those before it.
"""

import sys
import threading
from importlib import import_module
from typing import Any

import pytest

NATURES = {
    "unit": "runs in this process: no flight, rendering, process, socket or browser",
    "flight": "flies or renders pictures, in this process",
    "process": "starts a process or opens a socket",
    "browser": "drives a real browser",
}
ORDER = list(NATURES)

# A test without its own marker gets the nature of the longest matching path here, or `unit` if no path matches.
PATHS = {
    "tests/agent/models": "process",
    "tests/agent/test_wiring.py": "process",
    "tests/architecture": "process",
    "tests/autopilot/logging": "flight",
    "tests/autopilot/test_accuracy.py": "flight",
    "tests/benchmarks": "process",
    "tests/bench/harnesses": "process",
    "tests/bench": "process",
    "tests/cli": "process",
    "tests/view/editor": "process",
    "tests/episodes": "flight",
    "tests/episodes/maps/test_same_map.py": "process",
    "tests/episodes/test_processes.py": "process",
    "tests/episodes/test_target_motion.py": "process",
    "tests/examples": "process",
    "tests/report/export": "flight",
    "tests/view/film": "process",
    "tests/flight/picture": "flight",
    "tests/flight/spec/test_spec.py": "flight",
    "tests/hil": "process",
    "tests/judge/metrics/test_judging.py": "process",
    "tests/pilots": "flight",
    "tests/pilots/fitting": "process",
    "tests/pilots/scripted/test_recorded.py": "process",
    "tests/pilots/test_server.py": "process",
    "tests/view/replay": "process",
    "tests/flight/processes": "process",
    "tests/report": "process",
    "tests/flight/run": "process",
    "tests/foundation/run_folder/test_flown_folder.py": "flight",
    "tests/flight/sitl": "process",
    "tests/study/loop": "process",
    "tests/study/report": "process",
    "tests/study/test_load.py": "process",
    "tests/system": "process",
    "tests/view/live": "process",
}
# A test that uses one of these fixtures has at least their nature.
FIXTURES = {"browser": "browser", "driver": "browser"}

# The calls that need a nature: audit events of Python (PEP 578), and classes of this project by module.
EVENTS = {
    "subprocess.Popen": "process",
    "os.fork": "process",
    "os.posix_spawn": "process",
    "os.system": "process",
    "socket.bind": "process",
    "socket.connect": "process",
    "socket.sendto": "process",
}
ENGINES = {
    "episodes.camera.renderer.renderer": ("Renderer", "flight"),
    "dronecats.flight.sitl.fused": ("Fused", "flight"),
}


COMPILER = "dronecats.flight.sitl.compile_ahead"


class NatureError(AssertionError):
    """A test does what its nature does not allow."""


class Guard:
    """Checks the calls of the running test against its nature."""

    def __init__(self) -> None:
        self.item: pytest.Item | None = None
        self.patched: set[str] = set()
        self.thread = threading.get_ident()
        sys.addaudithook(self.audit)

    def audit(self, event: str, arguments: tuple[Any, ...]) -> None:
        """Check an audit event. Ignores other threads, because an earlier test may have left them running."""
        if event == "subprocess.Popen" and COMPILER in arguments[1]:
            return  # the first flight of an installation compiles its kernels in several processes
        if event in EVENTS and threading.get_ident() == self.thread:
            browser = event == "subprocess.Popen" and str(arguments[0]).endswith("chromedriver")
            self.check("browser" if browser else EVENTS[event], event)

    def check(self, needed: str, what: str) -> None:
        """Raise NatureError when the running test's nature does not allow `needed`."""
        if self.item is None:
            return
        nature = nature_of(self.item)
        if ORDER.index(nature) < ORDER.index(needed):
            raise NatureError(f"{what} needs the nature {needed}, this test has {nature}: see PATHS in {__name__}")

    def watch_engines(self) -> None:
        """Make the engines' constructors check the nature, once their modules are loaded."""
        for module, (name, needed) in ENGINES.items():
            if module in sys.modules and module not in self.patched:
                self.patched.add(module)
                _checked(self, getattr(import_module(module), name), needed)


def _checked(guard: Guard, engine: type[Any], needed: str) -> None:
    construct = engine.__init__

    def checked(self: Any, *arguments: Any, **options: Any) -> None:
        guard.check(needed, engine.__name__)
        construct(self, *arguments, **options)

    engine.__init__ = checked


def mark(item: pytest.Item) -> None:
    """Mark a test with its nature, unless it already has one."""
    if not any(item.get_closest_marker(nature) for nature in ORDER):
        item.add_marker(_required(item))


def nature_of(item: pytest.Item) -> str:
    """Return the nature that a test is marked with."""
    return next(nature for nature in ORDER if item.get_closest_marker(nature))


def of_path(path: str) -> str:
    """Return the nature of the tests in a file, by its path from the root."""
    matches = [known for known in PATHS if path == known or path.startswith(f"{known}/")]
    return PATHS[max(matches, key=len)] if matches else "unit"


def _required(item: pytest.Item) -> str:
    """Return the nature that a test's path and fixtures require. Slow tests need `process`: they run commands."""
    needed = [of_path(item.nodeid.partition("::")[0])]
    needed += [FIXTURES[fixture] for fixture in getattr(item, "fixturenames", ()) if fixture in FIXTURES]
    if item.get_closest_marker("slow"):
        needed.append("process")
    return max(needed, key=ORDER.index)
