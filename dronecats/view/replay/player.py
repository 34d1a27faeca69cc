"""Plays: one thread that shows the clock's time, as often as a page needs it and only when there is something new."""

import sys
import threading
import time
from collections.abc import Callable

from dronecats.view.replay.clock import PlaybackClock

RATE_HZ = 25.0  # times shown in a second of the wall while it plays

ClockOrder = Callable[[PlaybackClock, float], PlaybackClock]  # of clock and wall's time, s: the clock then


class Player:
    """Calls `show` with the time of the episode and the clock, from a thread of its own, never twice at a time."""

    def __init__(self, clock: PlaybackClock, show: Callable[[float, PlaybackClock], None]) -> None:
        """Start the thread. What `show` raises goes to the threading module's hook and ends nothing."""
        self._clock, self._show = clock, show
        self._news = threading.Condition()
        self._stale, self._busy, self._open = True, False, True
        self._thread = threading.Thread(target=self._run, name="replay", daemon=True)
        self._thread.start()

    @property
    def clock(self) -> PlaybackClock:
        """The clock as it is."""
        with self._news:
            return self._clock

    @property
    def t_s(self) -> float:
        """The time of the episode that is to be shown now, s."""
        with self._news:
            return self._clock.at(time.monotonic())

    def order(self, order: ClockOrder) -> None:
        """Make another clock of this one, and show its time."""
        with self._news:
            self._clock, self._stale = order(self._clock, time.monotonic()), True
            self._news.notify_all()

    def again(self) -> None:
        """Show the same time again: what belongs to it has changed."""
        self.order(lambda clock, _: clock)

    def idle(self, timeout_s: float) -> bool:
        """Wait until it stands still and everything is shown; return whether that came to pass within the time."""
        with self._news:
            return self._news.wait_for(lambda: not (self._stale or self._busy or self._clock.playing), timeout_s)

    def close(self) -> None:
        """End the thread once what is being shown is shown."""
        with self._news:
            self._open = False
            self._news.notify_all()
        self._thread.join(timeout=30.0)

    def _run(self) -> None:
        due = time.monotonic()
        while (now := self._next(due)) is not None:
            due = now[0] + 1.0 / RATE_HZ
            try:
                self._show(now[1].at(now[0]), now[1])
            except Exception:
                threading.excepthook(threading.ExceptHookArgs((*sys.exc_info(), self._thread)))

    def _next(self, due: float) -> tuple[float, PlaybackClock] | None:
        """Wait for what is to be shown next, no earlier than `due` while it plays; None: nothing any more."""
        with self._news:
            self._busy = False
            self._news.notify_all()
            while self._open and not self._stale:
                left = due - time.monotonic()
                if self._clock.playing and left <= 0.0:
                    break
                self._news.wait(left if self._clock.playing else None)
            if not self._open:
                return None
            wall = time.monotonic()
            self._clock = self._clock.settled(wall)
            self._stale, self._busy = False, True
            return wall, self._clock
