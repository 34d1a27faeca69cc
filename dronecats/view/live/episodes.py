"""The flights below a folder: which are in the air, and which are over."""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from foundation.run_folder import layout

DEEP = 2  # an episode's folder is below its run's, and that below a benchmark's


@dataclass(frozen=True, slots=True)
class WatchedEpisode:
    """One flight."""

    name: str  # of its folder, from the folder that is watched
    folder: Path
    begun_ns: int  # ns of the machine's clock, when its folder was made ready
    over: bool  # it has been judged


class EpisodeList:
    """The flights below a folder, looked for again and again."""

    def __init__(self, root: Path) -> None:
        self._root = root
        self._over: dict[Path, WatchedEpisode] = {}  # what is over stays so

    def look(self) -> list[WatchedEpisode]:
        """Return the flights that there are, the newest first."""
        found = [self._over.get(folder) or self._episode(folder) for folder in _episodes(self._root, DEEP)]
        known = [one for one in found if one is not None]
        self._over = {one.folder: one for one in known if one.over}
        return sorted(known, key=lambda one: (-one.begun_ns, one.name))

    def _episode(self, folder: Path) -> WatchedEpisode | None:
        told = folder / layout.EPISODE
        try:
            begun_ns = told.stat().st_mtime_ns
        except OSError:
            return None  # not told yet: it is being made
        name = folder.name if folder == self._root else str(folder.relative_to(self._root))
        return WatchedEpisode(name, folder, begun_ns, (folder / layout.VERDICT).exists())


def newest_flown(episodes: list[WatchedEpisode]) -> WatchedEpisode | None:
    """Return the newest flight that is not over, None where there is none."""
    return next((one for one in episodes if not one.over), None)


def _episodes(folder: Path, deep: int) -> Iterator[Path]:
    if (folder / layout.DECISIONS).exists():
        yield folder
        return
    try:
        below = [entry for entry in os.scandir(folder) if deep and entry.is_dir() and entry.name != layout.UNFINISHED]
    except OSError:
        return
    for entry in below:
        yield from _episodes(Path(entry.path), deep - 1)
