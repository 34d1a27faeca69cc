"""What a flight says and checks at each decision: a line per step and drone, and replies that are no actions."""

from collections import Counter
from collections.abc import Callable

from msgspec import UNSET

from dronecats.agent.action import action_from
from dronecats.agent.history import compact
from dronecats.agent.models.model import ending_reason
from foundation.errors import UnreadableError
from foundation.protocol import FINISHED
from foundation.run_folder.rows import Decision, drone_label

UNREADABLE = 10  # replies in a row that are no action, after which a flight warns


class StepLines:
    """Prints a line for each decision, and once a warning when replies in a row are no actions."""

    def __init__(
        self,
        say: Callable[[str], None],
        drones: int = 1,
        spent: Callable[[], str] = lambda: "",
        stop_unreadable: int | None = None,
    ) -> None:
        """`spent` returns what the model has cost so far, or an empty string.

        `stop_unreadable`: so many replies in a row that are no actions end the flight; None: they never do.
        """
        self._say, self._drones, self._spent, self._stop = say, drones, spent, stop_unreadable
        self._unreadable: Counter[int] = Counter()  # replies in a row, by drone
        self._has_warned = False

    def __call__(self, decision: Decision) -> None:
        """Print a decision. Raises UnreadableError when too many replies in a row are no actions."""
        what = compact(action_from(decision.action)) if decision.action else f"! {unreadable(decision)}"
        what += " (a report)" if decision.report is True and decision.kind == FINISHED else ""
        what += " (confirmed)" if decision.confirmed_by is not UNSET else ""
        drone = f" {drone_label(decision.drone)}" if self._drones > 1 else ""
        line = f"{decision.step:4d}  t={decision.t_decided:6.1f} s{drone}  {what:34} ({decision.latency_s:.2f} s)"
        self._say(f"{line}  {cost}" if (cost := self._spent()) else line)
        self._unreadable[decision.drone] = 0 if decision.action else self._unreadable[decision.drone] + 1
        if self._unreadable[decision.drone] == self._stop:
            told = f"{self._stop} replies in a row are no actions" if self._stop > 1 else "a reply is no action"
            raise UnreadableError(f"{told}: {unreadable(decision)} (--stop-unreadable {self._stop})")
        if self._unreadable[decision.drone] == UNREADABLE and not self._has_warned:
            self._has_warned = True
            self._say(f"WARNING: {UNREADABLE} replies in a row are no actions: the drone holds. {unreadable(decision)}")


def unreadable(decision: Decision) -> str:
    """Return why a decision has no action: the server's reason for the end of the reply, else the parser's."""
    return ending_reason(decision.finish, decision.tokens_out) or str(decision.error)
