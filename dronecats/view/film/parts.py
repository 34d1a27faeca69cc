"""A film that is being made, beside the file that it becomes: parts by number, and what they are parts of.

A part has its name when all of it is on disk, so that a kill leaves whole parts alone, and the same command makes the
others.
"""

import contextlib
import fcntl
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from dronecats.view.film.encoders import SUFFIX, Codec
from dronecats.view.film.plan import FilmPlan
from foundation.errors import UsageError
from foundation.run_folder.reading import json_object
from foundation.whole_file import write_json

MANIFEST, LOCK, MAKING = "manifest.json", ".lock", ".making"


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
