"""What time of the episode is shown: pure, so that whoever plays brings the wall's clock along."""

import math
from dataclasses import dataclass, replace

from foundation.errors import UsageError

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
