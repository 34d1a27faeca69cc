"""safety.jsonl: when the safety envelope limited what, one line at each change."""

import contextlib
import json
from collections.abc import Callable, Sequence
from pathlib import Path

from hil.link.link import Link


class SafetyLog:
    """Hears the links' envelopes, writes and says what they do, and says the links' notices.

    The file begins with the first limit that acts.
    """

    def __init__(self, path: Path, links: Sequence[Link], say: Callable[[str], None]) -> None:
        self._path, self._say = path, say
        for drone, link in enumerate(links):
            link.on_limit = self._hearing(drone, link)
            link.on_notice = self._noticing(drone)

    def _noticing(self, drone: int) -> Callable[[str], None]:
        def notice(line: str) -> None:
            with contextlib.suppress(OSError):
                self._say(f"      link: drone {drone + 1}: {line}")

        return notice

    def _hearing(self, drone: int, link: Link) -> Callable[[tuple[str, ...]], None]:
        def hear(names: tuple[str, ...]) -> None:
            line = {"time_us": link.time_us, "drone": drone, "limits": list(names)}
            what = f"limited by {', '.join(names)}" if names else "within its limits again"
            with contextlib.suppress(OSError):  # a full disk or a closed terminal stops no setpoint and no landing
                with self._path.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(line) + "\n")
                self._say(f"      envelope: drone {drone} {what}")

        return hear
