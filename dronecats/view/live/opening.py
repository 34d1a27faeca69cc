"""Opens the live page in a child process while a command flies. The command does not wait for the page."""

import contextlib
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from dronecats.flight.processes.supervisor import ChildKind, ChildProcess
from dronecats.view.live.config import ViewerConfig, WatchedWires
from dronecats.view.scene.page_hosts import reach
from foundation.errors import DronecatsError

VIEWER = ChildKind("viewer", "dronecats.view.live.viewer_process:FlightViewer", ViewerConfig)


@dataclass(frozen=True, slots=True, kw_only=True)
class WantedPage:
    port: int
    hosts: tuple[str, ...] = ()  # host names that the page's address may have, besides loopback names
    stays: bool = False  # whether the page stays open after the flight, until Ctrl-C


@contextmanager
def opened(
    view: WantedPage | None, source: Path | WatchedWires, title: str, report: Callable[[str], None]
) -> Iterator[None]:
    """Show the flights of a folder or of a simulator on a live page while the body runs. `view` None: show no page.

    `report` is called with the page's address, or with the error if the page cannot be opened. The body runs in both
    cases.
    """
    if view is None:
        yield
        return
    with tempfile.TemporaryDirectory(prefix="dronecats-view-") as logs:
        config = ViewerConfig(port=view.port, hosts=view.hosts, title=title)
        config = replace(config, root=str(source)) if isinstance(source, Path) else replace(config, wires=source)
        child = ChildProcess(VIEWER, config, Path(logs) / "log")
        closing, url = threading.Event(), ""

        def announce() -> None:
            nonlocal url
            try:
                url = str(child.ready()["url"])
                report(f"live page: {url} ({reach(view.hosts)})")
            except (DronecatsError, OSError, ValueError) as error:
                if not closing.is_set():
                    report(f"the live page could not be opened; the flight continues without it: {error}")

        thread = threading.Thread(target=announce, daemon=True, name="viewer-address")
        thread.start()
        try:
            yield
            if view.stays and url:
                report(f"the page stays open at {url}; Ctrl-C ends it")
                with contextlib.suppress(KeyboardInterrupt):
                    threading.Event().wait()
        finally:
            closing.set()
            child.kill()  # not a clean stop: the viewer may hang, and has no state to save
            thread.join()
            child.close()
