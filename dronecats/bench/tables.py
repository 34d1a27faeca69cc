"""The score tables of a suite's audit and of a benchmark."""

import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from msgspec import UNSET

from dronecats.agent.latency import RATE, LatencyPolicy
from dronecats.flight.spec.flight_spec import FlightSpec
from dronecats.judge.judged_flight import question_flags
from dronecats.judge.metrics.replies import is_cut_off, is_refused, is_unreadable
from dronecats.judge.statistics.shares import estimate_share
from dronecats.report.report_data import NONE
from dronecats.report.table import CellValue, ReportTable, TableCell, TableRow, in_blocks, numbers, table_of, words
from dronecats.report.table import row as table_row
from episodes.records import catalogue
from episodes.records.catalogue import BlindFlight, BlindTable
from episodes.records.record import CELLS
from foundation.errors import UsageError
from foundation.protocol import CAP_S
from foundation.run_folder import layout
from foundation.run_folder.reading import rows
from foundation.run_folder.results import SCORED, Result
from foundation.run_folder.rows import Decision
from foundation.wording import counted


@dataclass(frozen=True, slots=True)
class ScoreRow:
    """One row of an audit, with the fields that `episodes audit --json` prints. None: nothing was measured."""

    name: str  # a suite, or a map and a cell (kind of episode)
    solved: int  # scored flights that succeeded by the paper's criterion: SR
    flown: int  # scored flights, so without infrastructure errors
    errors: int
    solved_at_first: int | None  # flights solved by the first declaration: SR₁
    solved_within_three: int | None  # flights solved by one of the first three declarations: SR₃
    precision: float | None  # 0 … 1, share of declarations that are true, mean over the flights that declared
    false_declarations: float | None  # mean number per flight
    censored: int  # flights that ended at their first success; their later declarations are unknown
    median_steps: float | None  # median number of steps of the solved flights


def score_row(name: str, results: Iterable[Result]) -> ScoreRow:
    """Return the row of these results."""
    results = list(results)
    scored = [r for r in results if r.outcome in SCORED]
    solved = [r for r in scored if r.outcome == "success"]
    precisions = [r.declaration_precision for r in scored if r.declaration_precision is not None]
    false = [r.false_declarations for r in scored if r.false_declarations is not None]
    return ScoreRow(
        name=name,
        solved=len(solved),
        flown=len(scored),
        errors=len(results) - len(scored),
        solved_at_first=_count(r.success_at_first for r in scored),
        solved_within_three=_count(r.success_within_three for r in scored),
        precision=round(statistics.fmean(precisions), 4) if precisions else None,
        false_declarations=round(statistics.fmean(false), 4) if false else None,
        censored=sum(bool(r.censored) for r in scored),
        median_steps=statistics.median(r.steps for r in solved) if solved else None,
    )


def _count(measured: Iterable[bool | None]) -> int | None:
    """Return the number of flights with a true measure; None if the measure is missing for any flight."""
    values = list(measured)
    return None if None in values else sum(map(bool, values))


def groups(results: Iterable[Result]) -> dict[str, list[Result]]:
    """Return the results of each row: one per map and cell, one per suite with results, and "all"."""
    results = sorted(results, key=lambda r: r.episode)
    cells: dict[str, list[Result]] = {}
    for result in results:
        cells.setdefault(cell_of(result.episode), []).append(result)
    grouped = {name: cells[name] for name in sorted(cells, key=cell_order)}
    for suite in ("quick", "one-drone", "commanding", "v1"):
        episodes = set(catalogue.suite_ids(suite))
        if members := [r for r in results if r.episode in episodes]:
            grouped[suite] = members
    return {**grouped, "all": results}


def cell_of(episode: str) -> str:
    """Return an id without its number: `residential-tracking` for `residential-tracking-03`."""
    stem, _, number = episode.rpartition("-")
    return stem if number.isdigit() else episode


def cell_order(group: str) -> tuple[int, str]:
    """Return the sort key of maps and cells: the paper's order of the cells, then all other groups."""
    cells = [k for k, cell in enumerate(CELLS) if group.endswith(f"-{cell}")]
    # no group ends with two cells (`-search-and-track` does not end with `-tracking`); a user's group may end with none
    return (cells[-1] if cells else len(CELLS), group)


def solved_steps(results: Iterable[Result]) -> dict[str, int]:
    """Return the steps of every solved episode by id."""
    return {r.episode: r.steps for r in results if r.outcome == "success"}


def blind_flights(results: Iterable[Result]) -> dict[str, BlindFlight]:
    """Return the scored flights of a blind pilot by episode id, as blind.json stores them."""
    return {
        r.episode: BlindFlight(
            success=r.outcome == "success",
            first=bool(r.success_at_first),
            within_three=bool(r.success_within_three),
            declarations=int(r.declarations or 0),
            false_declarations=int(r.false_declarations or 0),
            steps=r.steps,
        )
        for r in results
        if r.outcome in SCORED and r.success_at_first is not None
    }


@dataclass(frozen=True, slots=True)
class BlindBaseline:
    """The best blind pilots (they use no pictures) on the episodes of a row."""

    solved: tuple[str, ScoreRow]  # the pilot with the most solved flights, and its row
    within_three: tuple[str, ScoreRow]  # the pilot with the most flights solved within three declarations, and its row


def floor(blind: BlindTable, name: str, results: Iterable[Result]) -> BlindBaseline | None:
    """Return the best blind pilots on the episodes of these results; None if no blind pilot has flown all episodes."""
    episodes = [r.episode for r in results]
    rows = [
        (pilot, score_row(name, [_blind_result(episode, flights[episode]) for episode in episodes]))
        for pilot, flights in sorted(blind.items())
        if all(episode in flights for episode in episodes)
    ]
    if not rows or not episodes:
        return None
    return BlindBaseline(
        max(rows, key=lambda r: (r[1].solved, r[1].solved_within_three or 0)),
        max(rows, key=lambda r: (r[1].solved_within_three or 0, r[1].solved)),
    )


def _blind_result(episode: str, flight: BlindFlight) -> Result:
    count = flight.declarations
    return Result(
        episode=episode,
        outcome="success" if flight.success else "failure",
        steps=flight.steps,
        declarations=count,
        success_at_first=flight.first,
        success_within_three=flight.within_three,
        declaration_precision=(count - flight.false_declarations) / count if count else None,
        false_declarations=flight.false_declarations,
    )


def audit_table(rows: Iterable[ScoreRow], floors: Mapping[str, BlindBaseline | None]) -> ReportTable:
    """Return the rows as a table. The best blind pilots on the same episodes are below each row."""
    lines = []
    for row in rows:
        lines.append(_audit_line(row.name, row))
        below = floors.get(row.name)
        best = dict.fromkeys((below.solved, below.within_three)) if below else ()
        lines += [_audit_line(f"  {pilot}", blind_row) for pilot, blind_row in best]
    has_notes = any(line[-1] for line in lines)
    columns = [
        words("episodes"), *map(numbers, ("solved", "at first", "in three")), numbers("precision", decimals=2),
        numbers("false", decimals=1), numbers("steps"), *([words("")] if has_notes else []),
    ]  # fmt: skip
    notes = [
        "solved, at first, in three: flights solved by any, by the first, by one of the first three declarations;"
        " false: false declarations per flight; steps: median over the solved flights"
    ]
    if not any(floors.values()):
        notes.append("no blind pilot has flown all of these episodes. Fly one with: --pilot blind:ring")
    return table_of(columns, (line if has_notes else line[:-1] for line in lines), *notes)


def _audit_line(name: str, row: ScoreRow) -> tuple[CellValue, ...]:
    measures = (row.solved, row.solved_at_first, row.solved_within_three)
    counts = (None if count is None else f"{count}/{row.flown}" for count in measures)
    steps = None if row.median_steps is None else f"{row.median_steps:g}"
    notes = [f"{counted(row.errors, 'error')}, not scored"] if row.errors else []
    notes += [f"{row.censored} censored"] if row.censored else []
    return name, *counts, row.precision, row.false_declarations, steps, "; ".join(notes)


QUANTILES = (0.1, 0.5, 0.9)
CLOSE_S = 1e-6  # s, resolution of a logged latency


@dataclass(frozen=True, slots=True, kw_only=True)
class EpisodeScore:
    """The values of one flight that the table of a benchmark counts."""

    setting: str  # name of the run without the flight's number
    episode: str  # id
    outcome: str
    retried: bool  # the flight replaces one that did not move
    stalled: bool  # the host delayed the flight
    rates_hz: tuple[float, ...]  # control rate (replies per s of vehicle time) of each reply within the cap
    broken_pins: int  # replies that came later than a fixed rate allows
    unreadable: int = 0  # decisions without an action
    refused: int = 0  # unreadable decisions because the model refused or its provider withheld the reply
    cut_off: int = 0  # unreadable decisions because the reply was cut off at its length limit


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchRow:
    """One row of a benchmark, with the fields that `bench --json` prints."""

    setting: str
    group: str  # a map and cell, or "all"
    flights: int  # scored flights
    solved: int
    share: float | None  # SR, 0 … 1; None: nothing is scored
    interval: tuple[float, float]  # 95 % interval of the SR, 0 … 1, by `estimate_share`
    rate_hz: tuple[float, float, float] | None  # the quantiles 0.1, 0.5 and 0.9 of the control rate over all replies
    errors: int  # flights that ended in an error and are not scored
    retries: int
    stalled: int  # flights that the host delayed
    dropped: int  # stalled flights that are not scored because of `--drop-stalled`
    broken_pins: int  # as in EpisodeScore
    unreadable: int  # decisions without an action
    refused: int  # as in EpisodeScore
    cut_off: int  # as in EpisodeScore


def score(setting: str, flight: FlightSpec, folder: Path, result: Result, *, retried: bool) -> EpisodeScore:
    """Return the score of an episode folder. A damaged log counts as a log without decisions."""
    try:
        decisions = list(rows(folder / layout.DECISIONS, Decision))
    except UsageError:
        decisions = []
    return EpisodeScore(
        setting=setting,
        episode=result.episode,
        outcome=result.outcome,
        retried=retried,
        stalled=result.host_stalls is not UNSET and result.host_stalls > 0,
        rates_hz=_rates_hz(decisions),
        broken_pins=broken_pins(flight.latency, decisions),
        unreadable=sum(map(is_unreadable, decisions)),
        refused=sum(map(is_refused, decisions)),
        cut_off=sum(map(is_cut_off, decisions)),
    )


def _rates_hz(decisions: Sequence[Decision]) -> tuple[float, ...]:
    """Return the control rate of each reply within the cap, as the metric `rate_hz` counts them."""
    flagged = zip(decisions, question_flags(decisions), strict=True)
    return tuple(d.rate_hz for d, first in flagged if first and d.t_decided <= CAP_S and d.rate_hz is not None)


def broken_pins(latency: LatencyPolicy, decisions: Iterable[Decision]) -> int:
    """Return how many replies came later than a fixed rate allows; 0 unless the policy is only a fixed rate."""
    if [part.kind for part in latency.parts] != [RATE]:  # other parts make the rate variable
        return 0
    pinned_s = 1.0 / latency.parts[0].numbers[0]
    late = {d.step for d in decisions if d.latency_s is not None and d.latency_s > pinned_s + CLOSE_S}
    return len(late)  # a joint reply is in the log once per drone, but counts once


def bench_rows(scores: Sequence[EpisodeScore], *, drop_stalled: bool = False) -> list[BenchRow]:
    """Return the rows of each setting: one per map and cell, in the paper's order, and one over all flights.

    `drop_stalled`: leave flights unscored that the host delayed.
    """
    table: list[BenchRow] = []
    for setting in dict.fromkeys(s.setting for s in scores):
        own = [s for s in scores if s.setting == setting]
        for group in sorted({cell_of(s.episode) for s in own}, key=cell_order):
            table.append(_bench_row(setting, group, [s for s in own if cell_of(s.episode) == group], drop_stalled))
        table.append(_bench_row(setting, "all", own, drop_stalled))
    return table


def _bench_row(setting: str, group: str, scores: Sequence[EpisodeScore], drop_stalled: bool) -> BenchRow:
    scored = [s for s in scores if s.outcome in SCORED]
    kept = [s for s in scored if not (drop_stalled and s.stalled)]
    flights: dict[str, list[bool]] = {}
    for s in kept:
        flights.setdefault(s.episode, []).append(s.outcome == "success")
    success = estimate_share(list(flights.values()))
    rates = [rate for s in kept for rate in s.rates_hz]
    low, middle, high = (round(float(q), 3) for q in np.quantile(rates, QUANTILES)) if rates else (0.0, 0.0, 0.0)
    return BenchRow(
        setting=setting,
        group=group,
        flights=len(kept),
        solved=success.successes,
        share=round(success.share, 4) if kept else None,
        interval=(round(success.low, 4), round(success.high, 4)),
        rate_hz=(low, middle, high) if rates else None,
        errors=len(scores) - len(scored),
        retries=sum(s.retried for s in scores),
        stalled=sum(s.stalled for s in scored),
        dropped=len(scored) - len(kept),
        broken_pins=sum(s.broken_pins for s in kept),
        unreadable=sum(s.unreadable for s in kept),
        refused=sum(s.refused for s in kept),
        cut_off=sum(s.cut_off for s in kept),
    )


def bench_table(rows: Sequence[BenchRow]) -> ReportTable:
    """Return the rows as a table, a block per setting."""
    has_unread = any(row.unreadable for row in rows)
    has_notes = any(map(_notes, rows))
    columns = [
        words("cell"),
        numbers("solved"),
        numbers("SR", unit="%", decimals=1),
        *(numbers(f"{100 * q:g} %", group="control rate, Hz", decimals=2) for q in QUANTILES),
        *(numbers(title) for title in ("unreadable", "refused", "cut off") if has_unread),
        *([words("")] if has_notes else []),
    ]

    def line(row: BenchRow) -> TableRow:
        low, high = (100.0 * end for end in row.interval)
        share = NONE if row.share is None else TableCell(value=100.0 * row.share, low=low, high=high)
        rates = row.rate_hz or (None,) * len(QUANTILES)
        unread = (row.unreadable, row.refused, row.cut_off) if has_unread else ()
        notes = [_notes(row)] if has_notes else []
        return table_row(row.group, f"{row.solved}/{row.flights}", share, *rates, *unread, *notes)

    notes = [
        "SR: success rate, % of the flights, with its 95 % interval. Control rate: decisions per second of"
        " vehicle time, quantiles over all replies"
    ]
    if has_unread:
        notes.append(
            "unreadable: replies without an action. Some of these: refused (by the model or its provider), cut off"
        )
    blocks = in_blocks((row.setting, line(row)) for row in rows)
    return ReportTable(columns=tuple(columns), blocks=blocks, notes=tuple(notes))


def _notes(row: BenchRow) -> str:
    counts = (
        (row.errors, "errors, not scored"),
        (row.retries, "retried"),
        (row.stalled, f"delayed by the host{', left out' if row.dropped else ''}"),
        (row.broken_pins, "replies later than the pinned rate"),
    )
    return "; ".join(f"{count} {note}" for count, note in counts if count)
