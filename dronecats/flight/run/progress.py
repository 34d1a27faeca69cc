"""Prints the progress lines of a flight, and writes safety.jsonl."""

import contextlib
from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from msgspec import UNSET

from dronecats.agent.action import action_from
from dronecats.agent.models.model import ending_reason
from foundation.errors import UnreadableError
from foundation.protocol import FINISHED
from foundation.run_folder.rows import ActiveLimits, Decision, EnvelopeRow, drone_label
from foundation.run_folder.writing import LineLog
from hil.link.link import Link

UNREADABLE = 10  # replies in a row without an action, after which a flight warns


class StepLines:
    """Prints a line for each decision, and one warning if many replies in a row have no action."""

    def __init__(
        self,
        notify: Callable[[str], None],
        drones: int = 1,
        spent: Callable[[], str] = lambda: "",
        stop_unreadable: int | None = None,
    ) -> None:
        """`spent` returns the cost of the model so far, or an empty string.

        `stop_unreadable`: the flight ends after this number of replies in a row without an action; None: never.
        """
        self._notify, self._drones, self._spent, self._stop = notify, drones, spent, stop_unreadable
        self._unreadable: Counter[int] = Counter()  # replies in a row without an action, by drone
        self._has_warned = False

    def __call__(self, decision: Decision) -> None:
        """Print a decision. Raises UnreadableError if too many replies in a row have no action."""
        text = action_from(decision.action).line if decision.action else f"! {unreadable(decision)}"
        text += " (a report)" if decision.report is True and decision.kind == FINISHED else ""
        text += " (confirmed)" if decision.confirmed_by is not UNSET else ""
        drone = f" {drone_label(decision.drone)}" if self._drones > 1 else ""
        line = f"{decision.step:4d}  t={decision.t_decided:6.1f} s{drone}  {text:34} ({decision.latency_s:.2f} s)"
        self._notify(f"{line}  {cost}" if (cost := self._spent()) else line)
        self._unreadable[decision.drone] = 0 if decision.action else self._unreadable[decision.drone] + 1
        if self._unreadable[decision.drone] == self._stop:
            reason = f"{self._stop} replies in a row have no action" if self._stop > 1 else "a reply has no action"
            raise UnreadableError(f"{reason}: {unreadable(decision)} (--stop-unreadable {self._stop})")
        if self._unreadable[decision.drone] == UNREADABLE and not self._has_warned:
            self._has_warned = True
            self._notify(
                f"WARNING: {UNREADABLE} replies in a row have no action, so the drone hovers. Check the model"
                f" with: dronecats models check. {unreadable(decision)}"
            )


def unreadable(decision: Decision) -> str:
    """Return why a decision has no action: the server's reason for the end of the reply, else the parser's error."""
    return ending_reason(decision.finish, decision.tokens_out) or str(decision.error)


class SafetyLog:
    """Writes to safety.jsonl which limits act on a drone's setpoints, at every change; prints limits and link notices.

    A limit is printed when it first acts on a drone. It may act at every step, so later times are only counted, and
    `sum_up` prints the counts. The file is created when the first limit acts.
    """

    def __init__(self, path: Path, links: Sequence[Link], notify: Callable[[str], None]) -> None:
        self._path, self._notify, self._active = path, notify, ActiveLimits()
        self._times = [Counter[str]() for _ in links]  # how often each limit began to act, by drone
        for drone, link in enumerate(links):
            link.on_limit = self._listener(drone, link)
            link.on_notice = partial(self._report, "link", drone)

    def sum_up(self) -> None:
        """Print how often each limit acted on each drone, if a limit acted more than once."""
        for drone, times in enumerate(self._times):
            if times and max(times.values()) > 1:
                counts = ", ".join(f"by {name} {_times(count)}" for name, count in times.most_common())
                self._report("envelope", drone, f"limited {counts} during the flight; see {self._path}")

    def _listener(self, drone: int, link: Link) -> Callable[[tuple[str, ...]], None]:
        times = self._times[drone]

        def listen(names: tuple[str, ...]) -> None:
            row = EnvelopeRow(time_us=link.time_us, drone=drone, limits=names)
            begun = self._active.begun(row)
            first = [name for name in begun if name not in times]
            times.update(begun)
            with contextlib.suppress(OSError), contextlib.closing(LineLog(self._path)) as log:
                log.write(row)
            if first:
                self._report("envelope", drone, f"limited by {', '.join(first)}")

        return listen

    def _report(self, source: str, drone: int, text: str) -> None:
        name = f"{drone_label(drone)} " if len(self._times) > 1 else ""
        with contextlib.suppress(OSError, ValueError):  # a closed terminal must not stop setpoints or a landing
            self._notify(f"      {source}: {name}{text}")


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"
