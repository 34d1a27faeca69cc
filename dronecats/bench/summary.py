"""What a benchmark came to: a line per pilot, map and cell, with its interval and the control rate it was served."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from msgspec import UNSET

from dronecats.agent.latency import RATE, LatencyPolicy
from dronecats.bench.audit import cell_of, cell_order
from dronecats.flight.spec.flight_spec import FlightSpec
from dronecats.judge.metrics.replies import is_cut_off, is_refused, is_unreadable
from dronecats.judge.statistics.shares import known_share
from dronecats.report.cells import NONE
from dronecats.report.table import ReportTable, TableCell, TableRow, in_blocks, numbers, words
from dronecats.report.table import row as table_row
from foundation.errors import UsageError
from foundation.run_folder import layout
from foundation.run_folder.reading import rows
from foundation.run_folder.results import SCORED, Result
from foundation.run_folder.rows import Decision

QUANTILES = (0.1, 0.5, 0.9)
CLOSE_S = 1e-6  # s, as exactly as the log tells a latency


@dataclass(frozen=True, slots=True, kw_only=True)
class EpisodeScore:
    """What is told of one flight in a table."""

    setting: str  # the run's name without the number of its flight
    episode: str  # id
    outcome: str
    retried: bool  # it stands for one that did not move
    stalled: bool  # the host delayed it
    rates_hz: tuple[float, ...]  # decisions per s of vehicle time, of each step but the first
    broken_pins: int  # replies that came later than the pinned rate allows
    unreadable: int = 0  # decisions without an action
    refused: int = 0  # of these, refused by the model or withheld by its provider
    cut_off: int = 0  # of these, cut off at the longest reply that was allowed


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchRow:
    """One line."""

    setting: str
    group: str  # a map and cell, or "all"
    flights: int  # scored
    solved: int
    share: float | None  # SR, 0 … 1; None: nothing is scored
    interval: tuple[float, float]  # 0 … 1, 95 %, episodes being the unit
    rate_hz: tuple[float, float, float] | None  # the quantiles 0.1, 0.5 and 0.9 of the control rate over all steps
    errors: int  # nobody's score
    retries: int
    stalled: int  # flights that the host delayed
    dropped: int  # of these, left unscored
    broken_pins: int
    unreadable: int  # decisions without an action
    refused: int  # of these, refused by the model or withheld by its provider
    cut_off: int  # of these, cut off at the longest reply that was allowed

    def as_json(self) -> dict[str, Any]:
        """Return it as `bench --json` prints it."""
        return {name: getattr(self, name) for name in self.__slots__}


def score(setting: str, flight: FlightSpec, folder: Path, result: Result, *, retried: bool) -> EpisodeScore:
    """Return what an episode folder tells. Of a damaged log no rates are told."""
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
        rates_hz=tuple(each.rate_hz for each in decisions if each.rate_hz is not None),
        broken_pins=broken_pins(flight.latency, decisions),
        unreadable=sum(map(is_unreadable, decisions)),
        refused=sum(map(is_refused, decisions)),
        cut_off=sum(map(is_cut_off, decisions)),
    )


def broken_pins(latency: LatencyPolicy, decisions: Iterable[Decision]) -> int:
    """Return how many replies came later than the rate that is pinned; 0 where none is."""
    if [part.kind for part in latency.parts] != [RATE]:  # to which something is added, it is not pinned
        return 0
    pinned_s = 1.0 / latency.parts[0].numbers[0]
    return sum(each.latency_s is not None and each.latency_s > pinned_s + CLOSE_S for each in decisions)


def table(scores: Sequence[EpisodeScore], *, drop_stalled: bool = False) -> list[BenchRow]:
    """Return the lines: of each setting one per map and cell, in the paper's order, and one of all of them."""
    found: list[BenchRow] = []
    for setting in dict.fromkeys(each.setting for each in scores):
        own = [each for each in scores if each.setting == setting]
        for group in sorted({cell_of(each.episode) for each in own}, key=cell_order):
            found.append(_row(setting, group, [s for s in own if cell_of(s.episode) == group], drop_stalled))
        found.append(_row(setting, "all", own, drop_stalled))
    return found


def _row(setting: str, group: str, scores: Sequence[EpisodeScore], drop_stalled: bool) -> BenchRow:
    scored = [each for each in scores if each.outcome in SCORED]
    kept = [each for each in scored if not (drop_stalled and each.stalled)]
    flights: dict[str, list[bool]] = {}
    for each in kept:
        flights.setdefault(each.episode, []).append(each.outcome == "success")
    known = known_share(list(flights.values()))
    rates = [rate for each in kept for rate in each.rates_hz]
    low, middle, high = (round(float(q), 3) for q in np.quantile(rates, QUANTILES)) if rates else (0.0, 0.0, 0.0)
    return BenchRow(
        setting=setting,
        group=group,
        flights=len(kept),
        solved=known.successes,
        share=round(known.share, 4) if kept else None,
        interval=(round(known.low, 4), round(known.high, 4)),
        rate_hz=(low, middle, high) if rates else None,
        errors=len(scores) - len(scored),
        retries=sum(each.retried for each in scores),
        stalled=sum(each.stalled for each in scored),
        dropped=len(scored) - len(kept),
        broken_pins=sum(each.broken_pins for each in kept),
        unreadable=sum(each.unreadable for each in kept),
        refused=sum(each.refused for each in kept),
        cut_off=sum(each.cut_off for each in kept),
    )


def as_table(rows: Sequence[BenchRow]) -> ReportTable:
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

    notes = ["SR: with its 95 % interval; control rate: decisions per second of vehicle time, quantiles over all steps"]
    if has_unread:
        notes.append("unreadable: replies without an action; of these, refused (by model or provider), and cut off")
    blocks = in_blocks((row.setting, line(row)) for row in rows)
    return ReportTable(columns=tuple(columns), blocks=blocks, notes=tuple(notes))


def _notes(row: BenchRow) -> str:
    counts = (
        (row.errors, "broken, not scored"),
        (row.retries, "flown once more"),
        (row.stalled, f"delayed by the host{', left out' if row.dropped else ''}"),
        (row.broken_pins, "replies later than the pinned rate"),
    )
    return "; ".join(f"{count} {what}" for count, what in counts if count)
