"""The folder of the flight logs: a new name for the next one, and the list that clients are shown."""

import contextlib
import re
from dataclasses import dataclass
from pathlib import Path

from foundation.errors import UsageError

_NAME = re.compile(r"log(\d{3,6})\.ulg")


@dataclass(frozen=True, slots=True)
class LogFile:
    """One finished or growing log."""

    id: int  # from 0, in the order they were written
    path: Path
    size: int  # bytes
    time_utc: int  # s since 1970, when the file was last written to


def make_folder(folder: Path) -> None:
    """Create a folder of the vehicle unless it exists. Raises UsageError when that is impossible."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(
            f"The folder {folder} cannot be made ({error.strerror}); give one that can be written to."
        ) from error


class LogDirectory:
    """`log001.ulg`, `log002.ulg`, … in one folder, which belongs to one vehicle.

    Creates the folder. Raises UsageError when that is impossible.
    """

    def __init__(self, folder: Path) -> None:
        make_folder(folder)
        self.folder = folder
        self.active: Path | None = None  # the log being written, which no client may change

    def _numbered(self) -> list[tuple[int, Path]]:
        found = []
        try:
            for path in self.folder.iterdir():
                match = _NAME.fullmatch(path.name)
                if match is not None and path.is_file():
                    found.append((int(match[1]), path))
        except OSError:  # the folder has been taken away: there are no logs
            return []
        return sorted(found)

    def next_path(self) -> Path:
        """Return the path of a log that does not exist yet, after all that do."""
        numbered = self._numbered()
        return self.folder / f"log{numbered[-1][0] + 1 if numbered else 1:03d}.ulg"

    def logs(self) -> list[LogFile]:
        """Return every log, oldest first."""
        logs: list[LogFile] = []
        for _, path in self._numbered():
            try:
                stat = path.stat()
            except OSError:  # removed in between
                continue
            logs.append(LogFile(len(logs), path, stat.st_size, max(int(stat.st_mtime), 0)))
        return logs

    def make_room(self, most: int) -> None:
        """Remove the oldest logs so that there are `most` with the next one; 0: remove none.

        PX4's SDLOG_DIRS_MAX counts folders; here every log stands in one folder and counts by itself.
        """
        for log in self.logs()[: 1 - most or None] if most > 0 else ():
            if log.path != self.active:
                with contextlib.suppress(OSError):
                    log.path.unlink()

    def erase(self) -> None:
        """Remove every log but the one being written, as far as the disk lets it."""
        for log in self.logs():
            if log.path != self.active:
                with contextlib.suppress(OSError):
                    log.path.unlink()
