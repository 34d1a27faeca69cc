"""The episodes that ship with the project, by id."""

import difflib
from pathlib import Path

from dronecats.border.errors import UsageError
from episodes import record as records
from episodes.record import EpisodeRecord

DEFAULT = "residential-approaching-01"
FOLDER = Path(__file__).parent / "records"


def ids() -> list[str]:
    """Return the ids of all shipped episodes, sorted."""
    return sorted(path.stem for path in FOLDER.glob("*.json"))


def load(id_or_path: str | Path) -> EpisodeRecord:
    """Return a shipped episode by its id, or the one in a JSON file or in an episode's folder.

    Raises UsageError when there is no such episode or its record is wrong.
    """
    name = str(id_or_path)
    known = ids()
    if name in known:
        return records.load(FOLDER / f"{name}.json")
    path = Path(name)
    try:
        if path.is_dir() and (path / "episode.json").is_file():
            return records.load(path / "episode.json")
        if path.suffix == ".json" or path.is_file():
            return records.load(path)
    except (OSError, ValueError):  # a name too long or with a null byte is no path
        pass
    near = ", ".join(difflib.get_close_matches(name[:100], known, 3, 0.4) or known)
    shown = name if len(name) <= 80 else name[:77] + "..."
    raise UsageError(f"episode {shown!r} is neither an id nor a record file: did you mean {near}?")
