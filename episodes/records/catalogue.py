"""The episodes that ship with the project, by id."""

from pathlib import Path

from episodes.records import record as records
from episodes.records.record import EpisodeRecord
from foundation.errors import UsageError
from foundation.wording import did_you_mean, nearest

DEFAULT = "residential-approaching-01"
RECORDS = Path(__file__).parent
FOLDER = RECORDS / "v2"
FORMER = RECORDS / "v1"  # the first hundred, which results from before the second are about
OPEN_GROUND = "open-ground"  # where `dronecats sitl` starts: 30 m free of solids; no episode of the benchmark


def ids() -> list[str]:
    """Return the ids of the benchmark's episodes, sorted."""
    return sorted(path.stem for path in FOLDER.glob("*.json"))


def former() -> list[str]:
    """Return the ids of the episodes of version 1, sorted; each begins with `v1-`."""
    return sorted(path.stem for path in FORMER.glob("*.json"))


def known() -> list[str]:
    """Return the ids of everything that ships, what is flown now first."""
    return [*ids(), *former()]


def ships(record: EpisodeRecord) -> bool:
    """Return whether this is a shipped episode, and not merely one that bears the id of one."""
    return record.id in known() and load(record.id) == record


def must_exist(id_or_path: str | Path) -> None:
    """Raise UsageError when this is neither a shipped episode nor something on the disk that could be a record."""
    name = str(id_or_path)
    if name not in (*known(), OPEN_GROUND) and _file(name) is None:
        raise UsageError(_unknown(name))


def load(id_or_path: str | Path) -> EpisodeRecord:
    """Return a shipped episode or `OPEN_GROUND` by its id, or the one in a JSON file or in an episode's folder.

    Raises UsageError when there is no such episode or its record is wrong.
    """
    name = str(id_or_path)
    for folder, names in ((FOLDER, ids()), (FORMER, former()), (RECORDS / "open", [OPEN_GROUND])):
        if name in names:
            return records.load(folder / f"{name}.json")
    path = _file(name)
    if path is None:
        raise UsageError(_unknown(name))
    return records.load(path)


def _file(name: str) -> Path | None:
    """Return the file that a path means; None when it means none."""
    path = Path(name)
    try:
        if path.is_dir() and (path / "episode.json").is_file():
            return path / "episode.json"
        if path.suffix == ".json" or path.is_file():
            return path
    except (OSError, ValueError):  # a name too long or with a null byte is no path
        pass
    return None


def _unknown(name: str) -> str:
    near = nearest(name, known(), cutoff=0.4) or [DEFAULT]
    shown = name if len(name) <= 80 else name[:77] + "..."
    return f"episode {shown!r} is neither an id nor a record file: {did_you_mean(near)} See: dronecats episodes list"
