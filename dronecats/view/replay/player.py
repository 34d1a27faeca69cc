"""The clock of a replay, and the thread that shows its time: as often as a page needs it, and only when it is new.

The clock is pure: whoever plays brings the wall's along.
"""

import math
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

from foundation.errors import UsageError

RATE_HZ = 25.0  # times shown in a second of the wall while it plays
SPEEDS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0)  # seconds of flight in one of the wall, that + and - go through


@dataclass(frozen=True, slots=True)
class PlaybackClock:
    """The time of the episode that is shown, as a function of the wall's. Every order makes another clock."""

    end_s: float  # s since the episode began, where it stops
    t_s: float = 0.0  # s since the episode began, that was shown at `wall_s`
    wall_s: float = 0.0  # s of a clock that never runs backwards
    speed: float = 1.0  # seconds of flight in one of the wall
    playing: bool = False

    def at(self, wall_s: float) -> float:
        """Return the time of the episode that is shown, s, within 0 … `end_s`."""
        gone = (wall_s - self.wall_s) * self.speed if self.playing else 0.0
        return min(max(self.t_s + gone, 0.0), self.end_s)

    def settled(self, wall_s: float) -> "PlaybackClock":
        """Return the clock that stands still once the end is shown."""
        return self.scrubbed(self.end_s, wall_s) if self.playing and self.at(wall_s) >= self.end_s else self

    def toggled(self, wall_s: float) -> "PlaybackClock":
        """Return the clock that plays where this one stands, and the other way round; at the end it begins anew."""
        t_s = self.at(wall_s)
        begins = not self.playing and t_s >= self.end_s
        return replace(self, t_s=0.0 if begins else t_s, wall_s=wall_s, playing=not self.playing)

    def scrubbed(self, t_s: float, wall_s: float) -> "PlaybackClock":
        """Return the clock that stands at a time of the episode."""
        t_s = min(max(t_s, 0.0), self.end_s) if math.isfinite(t_s) else self.at(wall_s)
        return replace(self, t_s=t_s, wall_s=wall_s, playing=False)

    def stepped(self, by_s: float, wall_s: float) -> "PlaybackClock":
        """Return the clock that stands so much later, or earlier."""
        return self.scrubbed(self.at(wall_s) + by_s, wall_s)

    def at_speed(self, speed: float, wall_s: float) -> "PlaybackClock":
        """Return the clock that goes on at another speed. Raises UsageError for one that it has not."""
        check_speed(speed)
        return replace(self, t_s=self.at(wall_s), wall_s=wall_s, speed=speed)

    def faster(self, wall_s: float) -> "PlaybackClock":
        """Return the clock at the next higher speed, at the highest itself."""
        return self.at_speed(next((speed for speed in SPEEDS if speed > self.speed), SPEEDS[-1]), wall_s)

    def slower(self, wall_s: float) -> "PlaybackClock":
        """Return the clock at the next lower speed, at the lowest itself."""
        return self.at_speed(next((speed for speed in reversed(SPEEDS) if speed < self.speed), SPEEDS[0]), wall_s)


def check_speed(speed: float) -> None:
    """Raise UsageError for a speed at which nothing is played."""
    if not SPEEDS[0] <= speed <= SPEEDS[-1]:
        raise UsageError(f"--speed wants a factor from {SPEEDS[0]:g} to {SPEEDS[-1]:g}, got {speed:g}")


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
