"""Makes docs/leaderboard.md from verified entries, in separate tables for models and built-in pilots."""

from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec

from dronecats.agent.names import PAPER, agent_name
from dronecats.report.leaderboard.verification import VERSION_KEY, CellScore, Verification
from dronecats.report.report_data import pilot_description
from dronecats.report.table import CellValue, TableCell, numbers, table_of, words
from dronecats.report.writers import as_markdown, escaped
from episodes.records.catalogue import VERSION
from episodes.records.record import CELLS
from foundation.conversion import decode
from foundation.errors import UsageError

ENTRY_MAX = 1 << 20  # bytes; a larger file is not an entry
SUITE_TITLES = {
    "all": "All hundred episodes",
    "one-drone": "One drone, eighty episodes",
    "commanding": "Commanding four drones, twenty episodes",
    "quick": "Quick, twelve episodes",
    "v1": "Version 1 of the episodes",
}
HEADS = {"approaching": "Appr.", "searching": "Search.", "tracking": "Track.", "search-and-track": "S-and-T",
         "commanding": "Command."}  # fmt: skip


def entry(path: Path) -> Verification:
    """Return the entry in a file with the output of `dronecats verify --json`. Raises UsageError for other files."""
    try:
        data = path.read_bytes()
        if len(data) > ENTRY_MAX:
            raise UsageError(f"{path} is too large for an entry. Name the output of `dronecats verify FILE --json`")
        return decode(data, Verification)
    except OSError as error:
        raise UsageError(f"{path} cannot be read: {error.strerror}") from None
    except (msgspec.DecodeError, UnicodeError, RecursionError) as wrong:
        raise UsageError(
            f"{path} is not an entry: {wrong}. Name the output of `dronecats verify FILE --json`"
        ) from None


def page(entries: Iterable[Verification]) -> str:
    """Return the page as Markdown. Raises UsageError if an entry is not verified, or occurs twice."""
    ordered = sorted(entries, key=lambda entry: (entry.name, entry.archive_sha256))
    for entry in ordered:
        if not entry.verified:
            difference = entry.differences[0] if entry.differences else "it differs"
            raise UsageError(f"{entry.name} was not verified: {difference}")
    archives = [entry.archive_sha256 for entry in ordered]
    if twice := next((entry.name for entry in ordered if archives.count(entry.archive_sha256) > 1), None):
        raise UsageError(f"the entry {twice} is there twice: remove one")
    models = [entry for entry in ordered if entry.is_model]
    ours = [entry for entry in ordered if not entry.is_model]
    sections = [HEADER, "## Models\n", _tables(models) or "No entry yet.\n"]
    sections += ["## Built-in pilots\n", ABOUT_PILOTS, _tables(ours) or "No entry yet.\n"]
    common = [
        sentence
        for sentence in (ordered[0].unchecked if ordered else ())
        if all(sentence in entry.unchecked for entry in ordered)
    ]
    sections += [
        HOW_TO,
        "## Entries\n",
        _list(common, "Not checked for any entry"),
        *(_about(entry, common) for entry in ordered),
    ]
    return "\n".join(sections)


HEADER = """# Leaderboard

<!-- `dronecats leaderboard` makes this page from docs/leaderboard/*.json -->

After this page you can read the ranking, verify an entry and submit your own.

*SR* is the success rate in % over all episodes of the entry, with its [95 % interval](report.md#uncertainty). The
columns of cells are also success rates in %. *Flights* is the number of flights of each episode. *Scored* is the number
of scored flights of all episodes. Compare only entries of the same suite with the same settings, for example with the
same `latency`. Tables with *or earlier* in the title have entries of an earlier
[version of the benchmark](episodes-reference.md#versions).
"""
HOW_TO = """## Submit an entry

An entry has the flights of one pilot over a whole suite, all with the same settings except `seed`.

1. Pack the run folders:

<!-- test: run -->
```sh
dronecats submit runs/demo --partial --out entry.tar.xz --note "as the paper has it"
```

   `submit` rejects runs with different settings, missing episodes and unscored flights. With `--partial` it accepts missing
   episodes and unscored flights, but such an entry is not ranked.

2. Verify the archive. Anybody can do this:

<!-- test: run -->
```sh
dronecats verify entry.tar.xz
```

   `verify` derives settings, actions and verdicts from the logs again. It prints the scores, and lists what it cannot
   check. You can safely verify archives from strangers.

| status | meaning |
| --- | --- |
| 0 | nothing differs |
| 2 | the file is not an archive of this kind |
| 4 | something differs |

   `verify` cannot check that the poses in `truth.jsonl` were flown. To check the poses of a lockstep flight,
   [fly it again from its replies](models.md#replay-a-flight).

3. Write the output of `dronecats verify FILE --json` to a file in `docs/leaderboard/`. Then make this page:

<!-- test: run -->
```sh
dronecats leaderboard docs/leaderboard/*.json --out docs/leaderboard.md
```

## Content of an archive

| file | content |
| --- | --- |
| `manifest.json` | pilot, suite, reasons for *partial*, digest of the settings, SHA-256 and size of every file |
| `runs/NN/run.json` | the settings of run NN, which has one flight per episode |
| `runs/NN/EPISODE/` | `episode.json`, `identity.json`, `decisions.jsonl`, `truth.jsonl`, `verdict.json`; also `commander.jsonl` and `estimate.jsonl` if the run has them |

`submit` leaves out images and telemetry; `--with-frames` includes the images. In all files, `submit` replaces API
keys by `***`, and absolute paths by the name of the file. The same runs give the same archive.
"""  # noqa: E501  # tables
ABOUT_PILOTS = (
    "These pilots show how hard the episodes are. Some know the place of the target, some look at the images, and"
    " some use neither.\n"
)


def _tables(entries: Sequence[Verification]) -> str:
    """Return the tables of all agents as Markdown, the paper's agent first."""
    tables = []
    for agent in sorted({_agent(entry) for entry in entries}, key=lambda agent: (agent != PAPER, agent)):
        by = "" if agent == PAPER else f", by the agent {escaped(agent)}"
        tables += _by_one_agent([entry for entry in entries if _agent(entry) == agent], by)
    return "\n".join(tables)


def _agent(entry: Verification) -> str:
    return agent_name(entry.settings.get("agent"))


def _by_one_agent(entries: Sequence[Verification], by: str) -> list[str]:
    """Return a table per suite for this benchmark version, then for earlier versions; last, the partial entries."""
    complete = [entry for entry in entries if entry.suite in SUITE_TITLES and not entry.partial]
    tables = []
    for is_present, when in ((True, ""), (False, f", version {VERSION - 1} or earlier")):
        for suite, title in SUITE_TITLES.items():
            members = [entry for entry in complete if entry.suite == suite and _is_present(entry) == is_present]
            if members:
                tables.append(_table(title + by + when, members))
    partial = [entry for entry in entries if entry not in complete]
    if partial:
        tables.append(_table(f"Partial{by}: no whole suite, or not all scored; not to be compared", partial))
    return tables


def _is_present(entry: Verification) -> bool:
    return entry.settings.get(VERSION_KEY) == VERSION


def _table(title: str, entries: Sequence[Verification]) -> str:
    cells = [cell for cell in CELLS if any(cell in entry.cells for entry in entries)]
    columns = (words("Entry"), *map(numbers, ("Flights", *(HEADS[cell] for cell in cells), "SR", "Scored", "95 %")))
    ordered = sorted(entries, key=lambda entry: (-(_rate(entry.cells.values()) or 0.0), entry.name))
    table = table_of(columns, (_cells(entry, cells) for entry in ordered))
    return as_markdown(replace(table, title=title), level=3)


def _cells(entry: Verification, cells: Sequence[str]) -> list[CellValue | TableCell]:
    scores = entry.cells.values()
    scored = sum(score.scored for score in scores)
    rates = (_percent([entry.cells[cell]]) if cell in entry.cells else None for cell in cells)
    low, high = entry.interval
    return [
        TableCell(value=entry.name, link=f"#{_anchor(entry)}"),
        str(entry.flights),
        *rates,
        TableCell(value=_percent(scores), best=True),
        str(scored),
        f"{100.0 * low:.1f} – {100.0 * high:.1f}" if scored else "–",
    ]


def _rate(scores: Collection[CellScore]) -> float | None:
    """Return the success rate over these cells (kinds of episode), 0 … 1; None without scored flights."""
    scored = sum(score.scored for score in scores)
    return sum(score.successes for score in scores) / scored if scored else None


def _percent(scores: Collection[CellScore]) -> str:
    rate = _rate(scores)
    return "–" if rate is None else f"{100.0 * rate:.1f}"


def _list(sentences: Sequence[str], title: str) -> str:
    return "\n".join([f"{title}:\n", *(f"- {escaped(sentence)}" for sentence in sentences), ""]) if sentences else ""


def _about(entry: Verification, common: Sequence[str]) -> str:
    pilot = f"`{_code(entry.pilot)}`"
    kind = (
        f"The model {pilot}"
        if entry.is_model
        else f"The built-in pilot {pilot} is no model. It {pilot_description(entry.pilot) or 'is built in'}"
    )
    lines = [
        f"### {_heading(entry)}\n",
        f"{kind}. {f'Note: {escaped(entry.note)}' if entry.note else ''}".rstrip() + "\n",
    ]
    if entry.partial:
        lines.append(f"**Partial**: {escaped(entry.partial)}.\n")
    settings = ", ".join(f"{name} `{_code(_plain(value))}`" for name, value in entry.settings.items())
    lines.append(f"- {settings}; dronecats {escaped(entry.dronecats)}")
    lines.append(f"- archive of {entry.archive_bytes} bytes, SHA-256 `{entry.archive_sha256}`")
    lines += [f"- not checked: {escaped(sentence)}" for sentence in entry.unchecked if sentence not in common]
    return "\n".join(lines) + "\n"


def _plain(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{key} {_plain(item)}" for key, item in value.items() if item is not None)
    return str(value)


def _heading(entry: Verification) -> str:
    return f"{escaped(entry.name)} {entry.archive_sha256[:8]}"


def _anchor(entry: Verification) -> str:
    """Return GitHub's anchor for the heading of an entry."""
    heading = f"{entry.name} {entry.archive_sha256[:8]}".lower()
    return "".join(letter for letter in heading if letter.isalnum() or letter in " -_").replace(" ", "-")


def _code(text: str) -> str:
    return "".join(letter if letter.isprintable() and letter != "`" else "�" for letter in text)
