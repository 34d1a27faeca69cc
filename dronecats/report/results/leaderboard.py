"""docs/leaderboard.md, from verified entries: models, and built-in pilots apart from them, each named as what it is."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec

from dronecats.agent.names import PAPER, agent_name
from dronecats.pilots.oracle.failing import FAILURES
from dronecats.pilots.roster import BLIND, FAILING, NOISY, ORACLE, RECORDED, SERVED
from dronecats.pilots.scripted import PATTERNS
from dronecats.report.archive.verification import CellScore, Verification
from dronecats.report.table import CellValue, TableCell, numbers, table_of, words
from dronecats.report.writers import as_markdown, escaped
from episodes.records.record import CELLS
from foundation.errors import UsageError

ENTRY_MAX = 1 << 20  # bytes
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
    """Return the entry in a file, as `dronecats verify --json` prints it. Raises UsageError."""
    try:
        data = path.read_bytes()
        if len(data) > ENTRY_MAX:
            raise UsageError(f"{path} is longer than an entry can be")
        made = msgspec.json.decode(data, type=Verification)
    except OSError as error:
        raise UsageError(f"{path} cannot be read: {error.strerror}") from None
    except (msgspec.DecodeError, UnicodeError, RecursionError) as wrong:
        raise UsageError(f"{path} is no entry, which `dronecats verify FILE --json` prints: {wrong}") from None
    return made


def page(entries: Iterable[Verification]) -> str:
    """Return the whole page. Raises UsageError for an entry that was not verified, or is there twice."""
    told = sorted(entries, key=lambda one: (one.name, one.archive_sha256))
    for one in told:
        if not one.verified:
            raise UsageError(f"{one.name} was not verified: {one.differences[0] if one.differences else 'it differs'}")
    archives = [one.archive_sha256 for one in told]
    if twice := next((one.name for one in told if archives.count(one.archive_sha256) > 1), None):
        raise UsageError(f"{twice} is there twice")
    models = [one for one in told if one.is_model]
    ours = [one for one in told if not one.is_model]
    parts = [HEADER, "## Models\n", _tables(models) or "None has been submitted.\n"]
    parts += ["## Built-in pilots, which are no models\n", ABOUT_PILOTS, _tables(ours) or "None has been submitted.\n"]
    parts += ["## The entries\n", *map(_about, told)]
    return "\n".join(parts)


HEADER = """# Leaderboard

<!-- made from docs/leaderboard/*.json, as submitting.md tells; change the entries, not this page -->

Percent of the episodes that succeeded, over all flights of an entry; SR is over all of its episodes, with a 95 %
interval in which [episodes are the unit](report.md#how-sure-it-is). Each number was derived anew from an archive of the
logs ([how to submit one](submitting.md)). Entries
of one suite compare with one another, if their settings do: what a reply is charged (`latency`) stands with each.
"""
ABOUT_PILOTS = "They say how hard the episodes are: some are told where the target is, and some look at nothing.\n"


def what(pilot: str) -> str:
    """Return what a built-in pilot is, a phrase."""
    if pilot == ORACLE:
        return "is told where the target is"
    if pilot == NOISY:
        return "is told where the target is, and errs as classical vision does"
    if pilot.startswith(FAILING):
        failing = FAILURES.get(pilot.removeprefix(FAILING))
        return f"is told the truth, and fails on purpose{f': {failing.description}' if failing else ''}"
    if pilot == "blind" or pilot.startswith(BLIND):
        pattern = PATTERNS.get(pilot.removeprefix(BLIND))
        return f"looks at nothing{f': {pattern.description}' if pattern else ''}"
    if pilot.startswith(RECORDED):
        return "says the replies of a file again"
    if pilot in SERVED:
        return "looks at the frames by classical vision"
    return "is built in"


def _tables(entries: Sequence[Verification]) -> str:
    """Return a table a suite, those of another agent behind the paper's: no table holds two agents."""
    found = []
    for agent in sorted({_agent(one) for one in entries}, key=lambda agent: (agent != PAPER, agent)):
        by = "" if agent == PAPER else f", by the agent {escaped(agent)}"
        found += _by_one_agent([one for one in entries if _agent(one) == agent], by)
    return "\n".join(found)


def _agent(one: Verification) -> str:
    return agent_name(one.settings.get("agent"))


def _by_one_agent(entries: Sequence[Verification], by: str) -> list[str]:
    """Return a table a suite; what is partial stands in one of its own, behind them."""
    whole = {suite: [one for one in entries if one.suite == suite and not one.partial] for suite in SUITE_TITLES}
    parts = [_table(SUITE_TITLES[suite] + by, of_it) for suite, of_it in whole.items() if of_it]
    partial = [one for one in entries if not any(one in of_it for of_it in whole.values())]
    if partial:
        parts.append(_table(f"Partial{by}: no whole suite, or not all scored; not to be compared", partial))
    return parts


def _table(title: str, entries: Sequence[Verification]) -> str:
    cells = [cell for cell in CELLS if any(cell in one.cells for one in entries)]
    columns = (words("Entry"), *map(numbers, ("Flights", *(HEADS[cell] for cell in cells), "SR", "of", "95 %")))
    ordered = sorted(entries, key=lambda one: (-_rate(_all(one)), one.name))
    table = table_of(columns, (_cells(one, cells) for one in ordered))
    return as_markdown(replace(table, title=title), level=3)


def _cells(one: Verification, cells: Sequence[str]) -> list[CellValue | TableCell]:
    of = _all(one)
    name, rate = TableCell(value=one.name, link=f"#{_anchor(one)}"), TableCell(value=_percent(of), best=True)
    rates = (_percent(one.cells[cell]) if cell in one.cells else None for cell in cells)
    return [name, str(one.flights), *rates, rate, str(of.scored), _interval(one)]


def _all(one: Verification) -> CellScore:
    each = one.cells.values()
    return CellScore(
        scored=sum(of.scored for of in each),
        successes=sum(of.successes for of in each),
        oracle_successes=sum(of.oracle_successes for of in each),
        declared=sum(of.declared for of in each),
        unscored=sum(of.unscored for of in each),
        ne_m=None,
    )


def _rate(of: CellScore) -> float:
    return of.successes / of.scored if of.scored else 0.0


def _percent(of: CellScore) -> str:
    return f"{100.0 * _rate(of):.1f}" if of.scored else "–"


def _interval(one: Verification) -> str:
    low, high = one.interval
    return f"{100.0 * low:.1f} – {100.0 * high:.1f}" if _all(one).scored else "–"


def _about(one: Verification) -> str:
    pilot = f"`{_code(one.pilot)}`"
    kind = f"The model {pilot}" if one.is_model else f"The built-in pilot {pilot}, no model: it {what(one.pilot)}"
    lines = [f"### {_heading(one)}\n", f"{kind}. {escaped(one.note)}".rstrip() + "\n"]
    if one.partial:
        lines.append(f"**Partial**: {escaped(one.partial)}.\n")
    settings = ", ".join(f"{name} `{_code(_plain(value))}`" for name, value in one.settings.items())
    lines.append(f"- {settings}; dronecats {escaped(one.dronecats)}")
    lines.append(f"- archive of {one.archive_bytes} bytes, SHA-256 `{one.archive_sha256}`")
    lines += [f"- not checked: {escaped(said)}" for said in one.unchecked]
    return "\n".join(lines) + "\n"


def _plain(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{key} {_plain(each)}" for key, each in value.items() if each is not None)
    return str(value)


def _heading(one: Verification) -> str:
    return f"{escaped(one.name)} {one.archive_sha256[:8]}"


def _anchor(one: Verification) -> str:
    """Return the place of an entry, as GitHub spells its heading."""
    heading = f"{one.name} {one.archive_sha256[:8]}".lower()
    return "".join(letter for letter in heading if letter.isalnum() or letter in " -_").replace(" ", "-")


def _code(text: str) -> str:
    return "".join(letter if letter.isprintable() and letter != "`" else "�" for letter in text)
