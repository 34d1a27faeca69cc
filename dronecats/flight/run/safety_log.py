"""safety.jsonl: when the safety envelope limited what, one line at each change."""

import contextlib
import json
from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from foundation.run_folder.rows import drone_label
from hil.link.link import Link


class SafetyLog:
    """Writes every change of the links' envelopes to the file. Says the links' notices, and a limit when it first acts.

    A limit may act at every step, so the other times are counted, and `sum_up` says them. The file begins with the
    first limit that acts.
    """

    def __init__(self, path: Path, links: Sequence[Link], say: Callable[[str], None]) -> None:
        self._path, self._say = path, say
        self._times = [Counter[str]() for _ in links]  # how often each limit began to act, by drone
        for drone, link in enumerate(links):
            link.on_limit = self._listener(drone, link)
            link.on_notice = partial(self._tell, "link", drone)

    def sum_up(self) -> None:
        """Say how often each limit acted on each drone, if any did so more than once."""
        for drone, times in enumerate(self._times):
            if times and max(times.values()) > 1:
                counts = ", ".join(f"by {name} {_times(count)}" for name, count in times.most_common())
                self._tell("envelope", drone, f"limited in the whole flight {counts}; {self._path} has each")

    def _listener(self, drone: int, link: Link) -> Callable[[tuple[str, ...]], None]:
        acting: frozenset[str] = frozenset()
        times = self._times[drone]

        def listen(names: tuple[str, ...]) -> None:
            nonlocal acting
            begun, acting = [name for name in names if name not in acting], frozenset(names)
            first = [name for name in begun if name not in times]
            times.update(begun)
            line = {"time_us": link.time_us, "drone": drone, "limits": list(names)}
            with contextlib.suppress(OSError), self._path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(line) + "\n")
            if first:
                self._tell("envelope", drone, f"limited by {', '.join(first)}")

        return listen

    def _tell(self, source: str, drone: int, what: str) -> None:
        name = f"{drone_label(drone)} " if len(self._times) > 1 else ""
        with contextlib.suppress(OSError, ValueError):  # a closed terminal stops no setpoint and no landing
            self._say(f"      {source}: {name}{what}")


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"
