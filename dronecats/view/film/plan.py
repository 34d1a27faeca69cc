"""The plan of a film: a validated value that can be sent to another process."""

import hashlib
import json
import math
from dataclasses import asdict, dataclass
from pathlib import Path

import dronecats
from dronecats.report import recorded
from dronecats.report.recorded.flight import RecordedFlight
from foundation.errors import UsageError
from foundation.run_folder import layout
from foundation.run_folder.reading import episode_folder

CLOSING_S = 2.5  # s of film that show the last picture with the verdict
PART = 60  # pictures per part; a killed process loses at most this many drawn pictures
SPEEDS = (0.1, 100.0)  # lowest and highest, s of flight per s of film
RATES = (1, 120)
SIDES_PX = (120, 3840)
OF_EPISODE = (layout.EPISODE, layout.DECISIONS, layout.TRUTH, layout.TLOG)  # the logs that a film depends on
SOURCES = (Path(__file__).parent, Path(recorded.__file__).parent, Path(dronecats.__file__).parents[1] / "episodes")


@dataclass(frozen=True, slots=True, kw_only=True)
class FilmPlan:
    """A film of one flight. Its pictures are numbered from 0."""

    folder: str  # the episode's folder
    width: int  # px, even
    height: int  # px, even
    fps: int  # pictures per second of film
    speed: float  # seconds of flight per second of film
    from_s: float  # s since the episode began
    to_s: float  # s since the episode began
    closing: int  # number of pictures at the end that show the last moment with the verdict; 0: none
    drone: int | None  # the only drone to follow; None: all drones
    per_part: int = PART  # pictures per part

    @property
    def moving(self) -> int:
        """The number of pictures before the closing pictures."""
        return max(1, math.ceil((self.to_s - self.from_s) / self.speed * self.fps - 1e-6))

    @property
    def pictures(self) -> int:
        return self.moving + self.closing

    @property
    def seconds(self) -> float:
        return self.pictures / self.fps

    def time_of(self, picture: int) -> float:
        """Return the time (s since the episode began) that a picture shows."""
        if picture >= self.moving:
            return self.to_s
        return min(self.from_s + picture * self.speed / self.fps, self.to_s)

    @property
    def part_ranges(self) -> tuple[range, ...]:
        firsts = range(0, self.pictures, self.per_part)
        return tuple(range(first, min(first + self.per_part, self.pictures)) for first in firsts)

    def digest(self, codec: str) -> str:
        """Return a digest of everything that affects a film's parts: plan, codec, logs, frames and source files."""
        folder = Path(self.folder)
        state = hashlib.sha256(json.dumps([asdict(self), codec, dronecats.__version__]).encode())
        frames = sorted((folder / layout.FRAMES).glob("*.jpg"))
        files = [folder.parent / layout.RUN, *(folder / name for name in OF_EPISODE), *frames]
        files += [path for room in SOURCES for path in sorted(room.rglob("*.py"))]
        for path in files:
            state.update(f"\n{path.name} ".encode())
            state.update(hashlib.sha256(path.read_bytes()).digest() if path.is_file() else b"missing")
        return state.hexdigest()


def plan(
    flight: RecordedFlight,
    *,
    size: tuple[int, int],
    fps: int,
    speed: float,
    from_s: float,
    to_s: float | None,
    drone: int | None,
) -> FilmPlan:
    """Return the plan of a film. `to_s` None: until the flight's end. Raises UsageError for invalid values."""
    least, most = SIDES_PX
    width, height = size
    if not all(least <= side <= most and side % 2 == 0 for side in size):
        raise UsageError(
            f"--size must be two even numbers from {least} to {most}, such as 1280x720, got {width}x{height}"
        )
    if not 1.2 <= width / height <= 2.5:
        raise UsageError(f"--size must be 1.2 to 2.5 times as wide as high, got {width}x{height}")
    if not RATES[0] <= fps <= RATES[1]:
        raise UsageError(f"--fps must be {RATES[0]} to {RATES[1]} pictures a second, got {fps}")
    if not SPEEDS[0] <= speed <= SPEEDS[1]:
        raise UsageError(f"--speed must be a factor from {SPEEDS[0]:g} to {SPEEDS[1]:g}, got {speed:g}")
    end = flight.end_s
    last = end if to_s is None else min(to_s, end)
    if not (math.isfinite(from_s) and 0.0 <= from_s < last):
        until = "--to" if to_s is not None and to_s < end else "the flight's end"
        raise UsageError(f"--from {from_s:g} must be 0 or more, and less than {until}, {last:g} s")
    drones = sorted({pose.drone for pose in flight.logs.poses})
    if drone is not None and drone not in drones:
        numbers = ", ".join(str(number + 1) for number in drones)
        raise UsageError(f"--drone {drone + 1} did not fly in {flight.folder}: {numbers} did")
    return FilmPlan(
        folder=str(flight.folder.resolve()),
        width=width,
        height=height,
        fps=fps,
        speed=speed,
        from_s=from_s,
        to_s=last,
        closing=round(CLOSING_S * fps) if last == end else 0,
        drone=drone,
    )


def filmable(path: Path) -> RecordedFlight:
    """Return the flight of an episode's folder, or of a run with one episode.

    Raises UsageError for another folder, a flight without truth, and a flight whose world is unknown.
    """
    folder = episode_folder(path)
    flight = RecordedFlight.read(folder)
    if not flight.logs.true:
        raise UsageError(
            f"{folder} has no truth, only an autopilot's estimates, so it cannot be filmed. See: dronecats replay"
        )
    if flight.logs.begin is None or not flight.logs.poses:
        raise UsageError(f"{folder / layout.TRUTH} has no pose of a drone, so there is nothing to film")
    if not (folder / layout.EPISODE).is_file():
        raise UsageError(f"{folder} has no {layout.EPISODE}, so its world is unknown")
    return flight
