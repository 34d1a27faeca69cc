"""Opens the page beside a command that flies, and closes it with that: the command never waits for it."""

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

VIEWER = ChildKind("viewer", "dronecats.view.live.viewer_process", ViewerConfig)


@dataclass(frozen=True, slots=True, kw_only=True)
class WantedPage:
    """That a page is wanted, and where."""

    port: int
    hosts: tuple[str, ...] = ()  # host names beside the loopback ones under which it opens
    stays: bool = False  # until it is interrupted, when the flight is over


@contextmanager
def opened(
    view: WantedPage | None, what: Path | WatchedWires, title: str, say: Callable[[str], None]
) -> Iterator[None]:
    """Have the flights below a folder, or on a simulator's wires, shown meanwhile; None: no page is wanted.

    What becomes of the page is nothing to the body: one that cannot be opened is told of, and that is all.
    """
    if view is None:
        yield
        return
    with tempfile.TemporaryDirectory(prefix="dronecats-view-") as logs:
        config = ViewerConfig(port=view.port, hosts=view.hosts, title=title)
        config = replace(config, root=str(what)) if isinstance(what, Path) else replace(config, wires=what)
        child = ChildProcess(VIEWER, config, Path(logs) / "log")
        closing, address = threading.Event(), _Address()

        def announce() -> None:
            try:
                address.url = str(child.ready()["url"])
                say(f"watch it at {address.url} ({reach(view.hosts)})")
            except (DronecatsError, OSError, ValueError) as error:
                if not closing.is_set():
                    say(f"there is no page to watch, and the flight goes on: {error}")

        thread = threading.Thread(target=announce, daemon=True, name="viewer-address")
        thread.start()
        try:
            yield
            if view.stays and address.url:
                say(f"the page stays at {address.url} · Ctrl-C ends it")
                with contextlib.suppress(KeyboardInterrupt):
                    threading.Event().wait()
        finally:
            closing.set()
            child.kill()  # it has nothing to lose, and may hang
            thread.join()  # which hears of it
            child.close()


@dataclass(slots=True)
class _Address:
    url: str = ""
