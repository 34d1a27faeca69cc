"""The shipped episodes: their ids, their suites, and the baselines of the oracle and the blind pilots.

A suite is a named list of episodes. `dronecats episodes audit` writes the baselines. The oracle is a pilot that knows
the truth; blind pilots fly fixed patterns. In a declaration, a pilot reports arrival.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, TypeVar

from msgspec import Meta

from episodes.records import record as records
from episodes.records.record import CELLS, EpisodeRecord
from foundation.errors import UsageError
from foundation.typed_file import file_bytes, json_of, typed
from foundation.wording import did_you_mean, nearest, suggestion

DEFAULT = "residential-approaching-01"
RECORDS = Path(__file__).parent
FOLDER = RECORDS / "v2"
V1_FOLDER = RECORDS / "v1"  # the first hundred episodes; results from before `v2` refer to them
OPEN_GROUND = "open-ground"  # start place of `dronecats sitl`, no solid within 30 m; not an episode of the benchmark

VERSION = 3  # of the benchmark; raised when images or records change
SUITES = ("one-drone", "commanding", "quick", "all", "v1")
# one episode for each one-drone cell (kind of task) and map; two for each map with `commanding` episodes
QUICK = (
    *(f"{place}-{cell}-01" for place in ("residential", "campus") for cell in CELLS if cell != "commanding"),
    *(f"{place}-commanding-{number}" for place in ("residential", "blocks") for number in ("01", "02")),
)

PAR = RECORDS / "par.json"
BLIND = RECORDS / "blind.json"

FlightCount = Annotated[int, Meta(ge=0)]
Pars = dict[str, Annotated[int, Meta(gt=0)]]  # episode → steps that the oracle takes
T = TypeVar("T")


def ids() -> list[str]:
    """Return the ids of the benchmark's episodes, sorted."""
    return sorted(path.stem for path in FOLDER.glob("*.json"))


def v1_ids() -> list[str]:
    """Return the ids of the episodes of version 1, sorted; each begins with `v1-`."""
    return sorted(path.stem for path in V1_FOLDER.glob("*.json"))


def all_ids() -> list[str]:
    """Return the ids of all shipped episodes, those of the benchmark first."""
    return [*ids(), *v1_ids()]


def is_shipped(record: EpisodeRecord) -> bool:
    """Return whether this record equals a shipped episode. Its id alone is not enough."""
    return record.id in all_ids() and load(record.id) == record


def must_exist(id_or_path: str | Path) -> None:
    """Raise UsageError if this is not a shipped episode's id, `OPEN_GROUND` or a path that could be a record."""
    name = str(id_or_path)
    if name not in (*all_ids(), OPEN_GROUND) and _file(name) is None:
        raise UsageError(_unknown(name))


def load(id_or_path: str | Path) -> EpisodeRecord:
    """Return a shipped episode or `OPEN_GROUND` by its id, or the episode in a JSON file or in an episode's folder.

    Raises UsageError if the episode does not exist or its record is wrong.
    """
    name = str(id_or_path)
    for folder, names in ((FOLDER, ids()), (V1_FOLDER, v1_ids()), (RECORDS / "open", [OPEN_GROUND])):
        if name in names:
            return records.load(folder / f"{name}.json")
    path = _file(name)
    if path is None:
        raise UsageError(_unknown(name))
    return records.load(path)


def _file(name: str) -> Path | None:
    """Return the path of a record: `episode.json` in the folder `name`, or `name` itself; None if it cannot be one.

    A path that ends in `.json` is returned even if the file does not exist.
    """
    path = Path(name)
    try:
        if path.is_dir() and (path / "episode.json").is_file():
            return path / "episode.json"
        if path.suffix == ".json" or path.is_file():
            return path
    except (OSError, ValueError):  # the name is too long or has a null byte
        pass
    return None


def _unknown(name: str) -> str:
    if len(name) <= 80 and Path(name).is_dir():
        return f"folder {name!r} has no episode.json. To name the record files in it: {name.rstrip('/')}/*.json"
    near = nearest(name, all_ids(), cutoff=0.4) or [DEFAULT]
    shown = name if len(name) <= 80 else name[:77] + "..."
    return f"episode {shown!r} is neither an id nor a record file: {did_you_mean(near)} See: dronecats episodes list"


def suite_ids(suite: str) -> list[str]:
    """Return the ids of a suite's episodes, sorted. Raises UsageError for an unknown suite."""
    if suite == "v1":
        return v1_ids()
    if suite == "all":
        return ids()
    if suite == "quick":
        return [name for name in ids() if name in QUICK]
    if suite in ("commanding", "one-drone"):
        return [name for name in ids() if ("-commanding-" in name) == (suite == "commanding")]
    raise UsageError(f"suite {suite[:60]!r} does not exist: {suggestion(suite, SUITES, count=2)}")


def episodes_of(suite: str | Sequence[str]) -> list[str]:
    """Return the ids and files that `suite` names: a suite, names separated by commas, or a sequence of these."""
    if isinstance(suite, str):
        return suite_ids(suite) if suite in SUITES else [name.strip() for name in suite.split(",")]
    return [name for entry in suite for name in episodes_of(entry)]


def suites_of(episode: str) -> tuple[str, ...]:
    """Return the suites that contain an episode; none if the episode is not shipped."""
    return tuple(name for name in SUITES if episode in suite_ids(name))


@dataclass(frozen=True, slots=True)
class BlindFlight:
    """The result of one full-length flight of a blind pilot."""

    success: bool
    first: bool  # the first declaration of the flight was true
    within_three: bool  # one of the first three declarations was true
    declarations: FlightCount
    false_declarations: FlightCount
    steps: FlightCount

    def __post_init__(self) -> None:
        """Raise ValueError for an impossible flight."""
        if not self.first <= self.within_three <= self.success or self.false_declarations > self.declarations:
            raise ValueError(f"{self} is not a flight")


BlindTable = dict[str, dict[str, BlindFlight]]  # pilot → episode → flight


def load_par(file: Path = PAR) -> Pars:
    """Return the par of each episode (the oracle's steps); {} without a table. Raises UsageError for a wrong table."""
    return _table(file, Pars)


def load_blind(file: Path = BLIND) -> BlindTable:
    """Return the blind flights; {} without a table. Raises UsageError for a wrong table."""
    return _table(file, BlindTable)


def merged(table: BlindTable, pilot: str, flights: dict[str, BlindFlight], episodes: list[str]) -> dict[str, Any]:
    """Return the table with new flights of a pilot, as JSON values; only flights of `episodes` remain.

    A new flight replaces the pilot's earlier flight of the same episode.
    """
    new = {**table, pilot: {**table.get(pilot, {}), **flights}}
    return {name: {id_: asdict(new[name][id_]) for id_ in episodes if id_ in new[name]} for name in sorted(new)}


def _table(file: Path, kind: type[T]) -> T:
    return typed(json_of(file_bytes(file, file.name), file.name) if file.exists() else {}, kind, file.name)
