"""The clock of a replay, and the thread that shows the clock's time.

The clock does not read the wall time: its methods get it as an argument.
"""

import math
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

from foundation.errors import UsageError

RATE_HZ = 25.0  # updates per wall s during playback
SPEEDS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0)  # s of flight per wall s, selected with + and -


@dataclass(frozen=True, slots=True)
class PlaybackClock:
    """The shown time of the episode as a function of the wall time. Immutable: its methods return a new clock."""

    end_s: float  # s since the episode began, when playback stops
    t_s: float = 0.0  # s since the episode began: the shown time at `wall_s`
    wall_s: float = 0.0  # s of a monotonic clock, when `t_s` is shown
    speed: float = 1.0  # s of flight per wall s
    playing: bool = False

    def at(self, wall_s: float) -> float:
        """Return the shown time of the episode at a wall time (s), in 0 … `end_s`."""
        gone = (wall_s - self.wall_s) * self.speed if self.playing else 0.0
        return min(max(self.t_s + gone, 0.0), self.end_s)

    def settled(self, wall_s: float) -> "PlaybackClock":
        """Return the clock, paused if it has reached the end."""
        return self.scrubbed(self.end_s, wall_s) if self.playing and self.at(wall_s) >= self.end_s else self

    def toggled(self, wall_s: float) -> "PlaybackClock":
        """Return the clock with playback started or paused. At the end, playback starts from the beginning."""
        t_s = self.at(wall_s)
        begins = not self.playing and t_s >= self.end_s
        return replace(self, t_s=0.0 if begins else t_s, wall_s=wall_s, playing=not self.playing)

    def scrubbed(self, t_s: float, wall_s: float) -> "PlaybackClock":
        """Return the clock, paused at a time of the episode."""
        t_s = min(max(t_s, 0.0), self.end_s) if math.isfinite(t_s) else self.at(wall_s)
        return replace(self, t_s=t_s, wall_s=wall_s, playing=False)

    def stepped(self, by_s: float, wall_s: float) -> "PlaybackClock":
        """Return the clock, paused `by_s` later (negative: earlier)."""
        return self.scrubbed(self.at(wall_s) + by_s, wall_s)

    def at_speed(self, speed: float, wall_s: float) -> "PlaybackClock":
        """Return the clock with another speed. Raises UsageError for a speed out of range."""
        check_speed(speed)
        return replace(self, t_s=self.at(wall_s), wall_s=wall_s, speed=speed)

    def faster(self, wall_s: float) -> "PlaybackClock":
        """Return the clock with the next higher speed, if any."""
        return self.at_speed(next((speed for speed in SPEEDS if speed > self.speed), SPEEDS[-1]), wall_s)

    def slower(self, wall_s: float) -> "PlaybackClock":
        """Return the clock with the next lower speed, if any."""
        return self.at_speed(next((speed for speed in reversed(SPEEDS) if speed < self.speed), SPEEDS[0]), wall_s)


def check_speed(speed: float) -> None:
    """Raise UsageError for a speed out of range."""
    if not SPEEDS[0] <= speed <= SPEEDS[-1]:
        raise UsageError(f"--speed must be a factor from {SPEEDS[0]:g} to {SPEEDS[-1]:g}, got {speed:g}")


class Player:
    """Calls `show` with the time of the episode and the clock, in its own thread, when the time or clock changes."""

    def __init__(self, clock: PlaybackClock, show: Callable[[float, PlaybackClock], None]) -> None:
        """Start the thread. Errors of `show` go to `threading.excepthook`, and playback continues."""
        self._clock, self._show = clock, show
        self._news = threading.Condition()
        self._stale, self._busy, self._open = True, False, True
        self._thread = threading.Thread(target=self._run, name="replay", daemon=True)
        self._thread.start()

    @property
    def clock(self) -> PlaybackClock:
        with self._news:
            return self._clock

    @property
    def t_s(self) -> float:
        """The current time of the episode, s."""
        with self._news:
            return self._clock.at(time.monotonic())

    def order(self, method: Callable[..., PlaybackClock], *arguments: float) -> None:
        """Replace the clock by `method(clock, *arguments, wall time in s)`, and show the new clock's time."""
        with self._news:
            self._clock, self._stale = method(self._clock, *arguments, time.monotonic()), True
            self._news.notify_all()

    def again(self) -> None:
        """Show the current time again, after a change of the page's state."""
        self.order(lambda clock, _: clock)

    def idle(self, timeout_s: float) -> bool:
        """Wait until playback has stopped and everything is shown; return False after the timeout."""
        with self._news:
            return self._news.wait_for(lambda: not (self._stale or self._busy or self._clock.playing), timeout_s)

    def close(self) -> None:
        """End the thread after the current `show`."""
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
        """Wait for an order, during playback at most until `due`. Return (wall time, clock); None if closed."""
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
