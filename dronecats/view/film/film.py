"""A film of a flight, from its folder to a file, by several processes at once.

It is made in parts beside the file that it becomes, each by its number. A part has its name when all of it is on disk,
so that a kill leaves whole parts alone, and the same command makes the others.
"""

import contextlib
import fcntl
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import cv2

from dronecats.view.film.composition import Composition
from dronecats.view.film.encoders import SUFFIX, Codec, codec_for, join, write_part
from dronecats.view.film.lettering import Picture
from dronecats.view.film.plan import FilmPlan, filmable
from episodes.authoring.processes import share_out
from foundation.errors import UsageError
from foundation.run_folder.reading import json_object
from foundation.threads import once
from foundation.whole_file import write_json

MANIFEST, LOCK, MAKING = "manifest.json", ".lock", ".making"

PicturesDone = Callable[[int], object]  # told how many more pictures are there


@dataclass(frozen=True, slots=True)
class FilmParts:
    """The folder of a film's parts."""

    folder: Path
    plan: FilmPlan
    codec: Codec

    def path(self, number: int) -> Path:
        """Return the file of a part."""
        return self.folder / f"{number:05d}{SUFFIX[self.codec]}"

    def making(self, number: int) -> Path:
        """Return the file of a part while it is being written."""
        return self.folder / f"{number:05d}{MAKING}{SUFFIX[self.codec]}"

    @property
    def missing(self) -> list[int]:
        """The numbers of the parts that are not there yet."""
        return [number for number in range(len(self.plan.parts)) if not self.path(number).is_file()]

    @property
    def paths(self) -> list[Path]:
        """The files of all parts."""
        return [self.path(number) for number in range(len(self.plan.parts))]

    def remove(self) -> None:
        """Remove the folder with all that is in it."""
        shutil.rmtree(self.folder)


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
    return Composition(filmable(Path(folder)), width, height, drone)


def _nobody(pictures: int) -> None:
    """Tell nobody how far it is."""


def folder_beside(out: Path) -> Path:
    """Return where the parts of a film are kept."""
    return out.with_name(out.name + ".parts")


@contextlib.contextmanager
def opened(out: Path, plan: FilmPlan, codec: Codec) -> Iterator[FilmParts]:
    """Yield the parts of a film, nobody else's; those of another film in their place are thrown away.

    Raises UsageError when nothing can be written there, or somebody else is making a film there.
    """
    if out.is_dir():
        raise UsageError(f"--out {out} is a folder; name a file in it")
    parts = FilmParts(folder_beside(out), plan, codec)
    try:
        parts.folder.mkdir(parents=True, exist_ok=True)
        lock: IO[str] = (parts.folder / LOCK).open("w")
    except OSError as error:
        raise UsageError(f"--out {out} cannot be written: {error.strerror}") from None
    with lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise UsageError(f"{out} is being made by another process; wait for it, or choose another --out") from None
        _begin(parts)
        yield parts


def _begin(parts: FilmParts) -> None:
    manifest = {"film": parts.plan.digest(parts.codec), "codec": parts.codec, "pictures": parts.plan.pictures}
    before = json_object(parts.folder / MANIFEST)
    for path in parts.folder.iterdir():
        if path.name not in (LOCK, MANIFEST) and (before != manifest or MAKING in path.name):
            path.unlink()
    write_json(parts.folder / MANIFEST, manifest)
