"""The named lists of shipped episodes that runs and reports go by."""

import difflib
from collections.abc import Sequence

from episodes.records import catalogue
from foundation.errors import UsageError

NAMES = ("one-drone", "commanding", "quick", "all", "v1")

# Every cell on every map it is flown on, the commanding ones twice: twelve, for a run over a cup of coffee.
QUICK = (
    "residential-approaching-01",
    "residential-searching-01",
    "residential-tracking-01",
    "residential-search-and-track-01",
    "campus-approaching-01",
    "campus-searching-01",
    "campus-tracking-01",
    "campus-search-and-track-01",
    "residential-commanding-01",
    "residential-commanding-02",
    "blocks-commanding-01",
    "blocks-commanding-02",
)


def ids(suite: str) -> list[str]:
    """Return the ids of a suite's episodes, sorted. Raises UsageError for a name that is no suite."""
    if suite == "v1":
        return catalogue.former()
    known = catalogue.ids()
    if suite == "all":
        return known
    if suite == "quick":
        return [name for name in known if name in QUICK]
    if suite == "commanding":
        return [name for name in known if "-commanding-" in name]
    if suite == "one-drone":
        return [name for name in known if "-commanding-" not in name]
    near = ", ".join(difflib.get_close_matches(suite, NAMES, 2, 0.4) or NAMES)
    raise UsageError(f"suite {suite[:60]!r} does not exist: did you mean {near}?")


def episodes_of(suite: str | Sequence[str]) -> list[str]:
    """Return the episodes of a suite's name, or of ids and files: a sequence, or one text with commas between."""
    if isinstance(suite, str):
        return ids(suite) if suite in NAMES else [name.strip() for name in suite.split(",")]
    return [name for each in suite for name in episodes_of(each)]


def of(episode: str) -> tuple[str, ...]:
    """Return the suites that an episode belongs to; none when it does not ship with the project."""
    return tuple(name for name in NAMES if episode in ids(name))
