"""A film of a flight, from its folder to a file, by several processes at once."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2

from dronecats.view.film.composition import Composition
from dronecats.view.film.encoders import Codec, codec_for, join, write_part
from dronecats.view.film.flown import filmed_flight, told
from dronecats.view.film.parts import FilmParts, opened
from dronecats.view.film.plan import FilmPlan
from dronecats.view.film.words import Picture
from episodes.authoring.processes import share_out
from foundation.errors import UsageError
from foundation.threads import once

PicturesDone = Callable[[int], object]  # told how many more pictures are there


@dataclass(frozen=True, slots=True)
class FilmPart:
    """A part that is to be made: what a process is told."""

    parts: FilmParts
    number: int


def make(
    plan: FilmPlan, out: Path, jobs: int | None = None, progress: Callable[[int], PicturesDone] | None = None
) -> Codec:
    """Write a film, and return how it is encoded. For the main thread.

    `progress` is given how many pictures are there already, and returns what is told of each that comes; `jobs`: how
    many processes draw, None: one a core. What an unfinished film of the same command has left is gone on with. Raises
    UsageError when nothing can be written there, InfrastructureError when an encoder or a process fails.
    """
    codec = codec_for(out)
    with opened(out, plan, codec) as parts:
        missing = parts.missing
        done = plan.pictures - sum(len(plan.parts[number]) for number in missing)
        tell = progress(done) if progress else _nobody
        try:
            for number in share_out(draw_part, [FilmPart(parts, number) for number in missing], jobs):
                tell(len(plan.parts[number]))
            finished = parts.folder / f"film{out.suffix}"
            join(parts.paths, finished, plan, codec)
            finished.replace(out)
            parts.remove()
        except OSError as error:
            raise UsageError(f"{out} cannot be written: {error.strerror}; the same command goes on") from None
    return codec


def draw_part(part: FilmPart) -> int:
    """Draw and write one part, and return its number. In a process of its own, or in the caller's."""
    parts, plan = part.parts, part.parts.plan
    making = parts.making(part.number)
    write_part(making, _pictures(plan, part.number), plan, parts.codec)
    making.replace(parts.path(part.number))
    return part.number


def _pictures(plan: FilmPlan, number: int) -> Iterator[Picture]:
    drawn = composition(plan.folder, plan.width, plan.height, plan.drone)
    for picture in plan.parts[number]:
        yield drawn.at(plan.time_of(picture), plan.speed, over=picture >= plan.moving and plan.closing > 0)


@once(1)
def composition(folder: str, width: int, height: int, drone: int | None) -> Composition:
    """Return what draws the pictures of a film, made once in a process. Raises UsageError where it cannot be."""
    cv2.setNumThreads(1)  # a process draws on one core: there is one for each of them
    return Composition(filmed_flight(told(Path(folder))), width, height, drone)


def _nobody(pictures: int) -> None:
    """Tell nobody how far it is."""
