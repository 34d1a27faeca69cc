"""Computes the data of the report's tables: entrants (groups of runs), table cells, notes and warnings."""

import json
import statistics
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, wraps
from pathlib import Path
from typing import Any

from dronecats.agent.names import PAPER
from dronecats.judge.metrics import metric as metric_statistics
from dronecats.judge.statistics.shares import ShareEstimate, estimate_share
from dronecats.pilots import roster
from dronecats.pilots.oracle.failing import FAILURES
from dronecats.pilots.scripted import PATTERNS
from dronecats.report.recorded.run import RecordedRun
from dronecats.report.results.collection import Collection, ScoredEpisode
from dronecats.report.results.identity import deviating_runs, differences, identity, pooling_conflict
from dronecats.report.table import CellValue, ReportTable, TableBlock, TableCell, TableColumn, TableRow, row
from episodes.records.catalogue import BlindTable
from episodes.records.record import CELLS
from foundation.errors import UsageError

FLAT = "flat"


@dataclass(frozen=True, slots=True)
class Setting:
    """The settings that divide the runs of one pilot into entrants. All other settings must agree within an entrant."""

    pilot: str
    replayed: bool  # the replies are recorded ones; no model was called
    is_model: bool
    command: str  # how the drones are commanded: flat, hierarchical or solo
    commander: str  # PROVIDER/NAME, or a script; empty: none
    latency: str  # latency policy, which may also fix the decision rate
    agent: str  # paper, or another agent
    disturbed: str = ""  # disturbances of the flights, in words; empty: none
    temperature: str = ""  # in words, such as "temperature 0.5"; empty: no model, or not sent
    top_p: str = ""  # in words, like temperature
    max_tokens: str = ""  # in words, like temperature
    reasoning: str = ""  # request fields for reasoning, except in steps after a `think`


# fields of a setting with parameters of the model's requests; empty without a model
REQUEST_FIELDS = ("temperature", "top_p", "max_tokens", "reasoning")


@dataclass(frozen=True)
class Entrant:
    """A row of the tables: all flights of a pilot under one setting."""

    label: str
    setting: Setting
    runs: tuple[RecordedRun, ...]
    episodes: tuple[ScoredEpisode, ...]  # every flight of every episode, including unscored ones

    @property
    def is_model(self) -> bool:
        """Whether a model flew. False for built-in pilots and replays."""
        return self.setting.is_model and not self.setting.replayed

    @cached_property
    def scored(self) -> tuple[ScoredEpisode, ...]:
        """The successes and failures that no exclusion rule left out."""
        return tuple(flight for flight in self.episodes if flight.scored)

    @cached_property
    def by_episode(self) -> Mapping[str, tuple[ScoredEpisode, ...]]:
        """The flights in `scored` by their episode's id, in the order of their seeds."""
        flights: dict[str, list[ScoredEpisode]] = {}
        for flight in sorted(self.scored, key=lambda flight: flight.run.seed):
            flights.setdefault(flight.episode, []).append(flight)
        return {name: tuple(flights[name]) for name in sorted(flights)}


def entrants(collection: Collection, *, pool_anyway: bool = False) -> tuple[Entrant, ...]:
    """Return the entrants, models first, otherwise in the order of the runs.

    Raises UsageError if two different episode records have the same id. Without `pool_anyway`, also if an entrant's
    runs differ in other settings (`results.identity`), or if two of its flights have the same episode and seed.
    """
    _check_record_ids(collection.episodes)
    runs: dict[Setting, list[RecordedRun]] = {}
    for run in collection.runs:
        runs.setdefault(setting(run), []).append(run)
    by_run: dict[Path, list[ScoredEpisode]] = {}
    for flight in collection.episodes:
        by_run.setdefault(flight.run.folder, []).append(flight)
    entries = []
    for settings, members in runs.items():
        episodes = tuple(flight for run in members for flight in by_run.get(run.folder, ()))
        if not pool_anyway:
            advice = "or count them together with --pool-anyway"
            if reason := pooling_conflict(members):
                odd = ", ".join(str(run.folder) for run, _ in deviating_runs(members)) or "it"
                raise UsageError(f"{reason}. Leave {odd} out and report it by itself, {advice}")
            if reason := _repeated_flight(episodes):
                raise UsageError(f"{reason}. Leave one of them out, {advice}")
        entries.append(Entrant(_label(settings, list(runs)), settings, tuple(members), episodes))
    return tuple(sorted(entries, key=lambda entrant: not entrant.is_model))


def setting(run: RecordedRun) -> Setting:
    flight = run.flight
    commander = flight.get("commander")
    return Setting(
        pilot=run.pilot,
        replayed=flight.get("replay") is not None,
        is_model=run.is_model,
        command=str(flight.get("command") or FLAT),
        commander=f"{commander.get('provider')}/{commander.get('name')}"
        if isinstance(commander, dict)
        else str(flight.get("scripted") or ""),
        latency=str(flight.get("latency") or ""),
        agent=run.agent,
        disturbed=str(run.configuration.get("disturbed") or ""),
        **_request_words(flight.get("model")),
    )


def _request_words(model: Any) -> dict[str, str]:
    """Return the request fields of a model in words, by the field of a Setting."""
    if not isinstance(model, dict):
        return {}
    sent = {name: model.get(name) for name in ("temperature", "top_p", "max_tokens")}
    words = {name: f"{name} {value}" for name, value in sent.items() if value is not None}
    quick = model.get("quick")
    return words if quick is None else {**words, "reasoning": f"reasoning {json.dumps(quick, sort_keys=True)}"}


def _label(entry: Setting, entries: Sequence[Setting]) -> str:
    """Return the pilot's name, with the fields of its setting that differ among entrants of that name.

    An agent other than the paper's is always named.
    """
    name = f"replay of {entry.pilot}" if entry.replayed else entry.pilot
    name = name if entry.agent == PAPER else f"{name} · {entry.agent}"
    key = (entry.pilot, entry.replayed, entry.agent)
    namesakes = [setting for setting in entries if (setting.pilot, setting.replayed, setting.agent) == key]
    differing = []
    for field in ("command", "commander", "latency", "disturbed", *REQUEST_FIELDS):
        value = getattr(entry, field)
        if value and any(getattr(namesake, field) != value for namesake in namesakes):
            differing.append(value)
    return ", ".join([name, *differing])


def _repeated_flight(episodes: Iterable[ScoredEpisode]) -> str | None:
    """Return a sentence about two flights with the same episode and the same seed; None: there are none."""
    seen: dict[tuple[str, int], ScoredEpisode] = {}
    for flight in episodes:
        before = seen.setdefault((flight.episode, flight.run.seed), flight)
        if before is not flight:
            return f"{before.folder} and {flight.folder} have the same episode and the same seed {flight.run.seed}"
    return None


def _check_record_ids(episodes: Iterable[ScoredEpisode]) -> None:
    seen: dict[str, ScoredEpisode] = {}
    for flight in episodes:
        before = seen.setdefault(flight.episode, flight)
        if flight.record_sha256 and before.record_sha256 and flight.record_sha256 != before.record_sha256:
            raise UsageError(
                f"{before.folder} and {flight.folder} have different records with the id '{flight.episode}', so"
                " they are different episodes. Report them separately"
            )


MODELS = "Models"
BUILT_IN = "Built-in pilots, no models"
BLIND_ROW_TITLE = "The best blind pilot"
COMMANDING = "commanding"  # the cell (kind of episode) for a fleet
ONE_DRONE = tuple(cell for cell in CELLS if cell != COMMANDING)
PERCENT = 100.0
NONE = TableCell(value=None)
NAME = TableColumn(name="pilot", title="Pilot", align="left")
FLIGHTS = TableColumn(name="flights", title="Flights")
ERRORS = TableColumn(name="not_scored", title="Not scored")

Cells = Sequence[TableCell | CellValue]
RowsFunction = Callable[[Sequence[Entrant]], Sequence[TableRow]]  # the rows of a block of entrants
RowFunction = Callable[[Entrant], Cells | None]  # the cells after the name; None: the entrant has no row


@dataclass(frozen=True, slots=True)
class OutcomeColumn:
    """One way in which a flight, or a drone of a fleet, ends."""

    name: str  # a failure mode, or the name of a metric
    title: str  # in tables and figures

    @property
    def column(self) -> str:
        """The name of the column with the share (%) of this outcome."""
        return f"{self.name.replace(' ', '_')}_percent"


FAILURE_MODE_COLUMNS = (  # names as in `failure_mode`, in the order of the paper's bars; "did not move" is ours
    OutcomeColumn("success", "Success"),
    OutcomeColumn("declared", "Declared, never true"),
    OutcomeColumn("arrived", "Arrived, undeclared"),
    OutcomeColumn("never grounded", "Never grounded"),
    OutcomeColumn("oscillated", "Oscillated"),
    OutcomeColumn("never closed", "Never closed"),
    OutcomeColumn("timed out", "Timed out"),
    OutcomeColumn("did not move", "Did not move"),
)
DRONE_OUTCOMES = (  # names of metrics that count an episode's drones
    OutcomeColumn("drones_found", "Found the target"),
    OutcomeColumn("drones_beside", "Declared at a look-alike"),
    OutcomeColumn("drones_elsewhere", "Declared elsewhere"),
    OutcomeColumn("drones_silent", "Never declared"),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportData:
    """The data of all tables."""

    entrants: tuple[Entrant, ...]
    blind: BlindTable  # results of the pilots that never look at an image, on the shipped episodes
    command: str  # the command line that makes the report

    @property
    def episodes(self) -> tuple[ScoredEpisode, ...]:
        return tuple(flight for entrant in self.entrants for flight in entrant.episodes)

    def cells(self, among: Iterable[str] = ONE_DRONE) -> list[str]:
        """Return the cells (kinds of episode) of `among` that have flights, in the order of `among`."""
        used_cells = {flight.cell for flight in self.episodes}
        return [cell for cell in among if cell in used_cells]

    def maps(self) -> list[str]:
        """Return the maps that have flights, sorted by name."""
        return sorted({flight.map for flight in self.episodes} - {""})

    def table_of_rows(
        self, columns: Sequence[TableColumn], rows_of: RowsFunction, notes: Sequence[str] = (), **texts: str
    ) -> ReportTable | None:
        """Return a table with a block of models and a block of built-in pilots; None: both blocks are empty.

        `texts`: name, title and caption of the table."""
        blocks = []
        for title, is_model in ((MODELS, True), (BUILT_IN, False)):
            if rows := rows_of([entrant for entrant in self.entrants if entrant.is_model is is_model]):
                blocks.append(TableBlock(title=title, rows=tuple(rows)))
        if not blocks:
            return None
        content: dict[str, Any] = {"columns": tuple(columns), "blocks": tuple(blocks), "notes": tuple(notes), **texts}
        return ReportTable(**content, command=self.command)

    def table(
        self, columns: Sequence[TableColumn], row_of: RowFunction, notes: Sequence[str] = (), **texts: str
    ) -> ReportTable | None:
        """Return a table with a row for each entrant; None: no entrant has a row.

        The best cells of the models are marked. Built-in pilots are only references."""

        def rows_of(entrants: Sequence[Entrant]) -> Sequence[TableRow]:
            named_cells = [(e.label, row_of(e)) for e in entrants]
            rows = [row(label, *cells, entrant=label) for label, cells in named_cells if cells is not None]
            return _marked(rows, columns) if any(e.is_model for e in entrants) else rows

        return self.table_of_rows(columns, rows_of, notes, **texts)

    def notes(self) -> tuple[str, ...]:
        """Return a sentence that describes each built-in pilot."""
        pilots = [e.setting.pilot for e in self.entrants if not e.is_model and not e.setting.replayed]
        return tuple(f"{pilot} {words}." for pilot in dict.fromkeys(pilots) if (words := pilot_description(pilot)))

    def warnings(self) -> tuple[str, ...]:
        """Return sentences about differences between rows, or between flights of one row, that limit comparisons."""
        sentences: list[str] = []
        for entrant in self.entrants:
            if reason := pooling_conflict(entrant.runs):
                sentences.append(f"Counted together because of --pool-anyway: {reason}.")
            if entrant.setting.disturbed:
                sentences.append(f"{entrant.label} flew with disturbances: {entrant.setting.disturbed}.")
            names = {name for flight in entrant.scored for name in flight.served}
            if len(names) > 1:
                sentences.append(f"{entrant.label}: the server answered as {', '.join(sorted(names))}.")
        kinds = [{k: values for k, values in identity(e.runs[0]).items() if is_common(k)} for e in self.entrants]
        differing = {str(difference) for kind in kinds[1:] for difference in differences(kinds[0], kind)}
        if differing:
            sentences.append(
                f"The rows are not fully comparable, because their runs differ in {', '.join(sorted(differing))}."
            )
        return tuple(sentences)


TableFunction = Callable[[ReportData], ReportTable | None]


def by_entrant(columns: Sequence[TableColumn], **texts: str) -> Callable[[RowFunction], TableFunction]:
    """Return a decorator for a function that returns an entrant's row. The result is a function that returns the table.

    The table has the name of the row function. `texts`: title and caption of the table.
    """

    def decorated(row_of: RowFunction) -> TableFunction:
        @wraps(row_of)
        def table(data: ReportData) -> ReportTable | None:
            return data.table(columns, row_of, name=row_of.__name__, **texts)

        return table

    return decorated


def is_common(name: str) -> bool:
    """Return whether this setting (a key of `identity`) should be equal in all rows, even for different pilots."""
    return name in ("the code", "the camera", "the clock") or name.startswith(
        ("the protocol", "the suite", "the version")
    )


def pilot_description(pilot: str) -> str:
    """Return a phrase that describes a built-in pilot; empty: an unknown pilot."""
    if pilot == roster.ORACLE:
        return "knows where the target is"
    if pilot == roster.NOISY:
        return "knows where the target is, and makes the errors of classical vision"
    if pilot.startswith(roster.FAILING):
        failing = FAILURES.get(pilot.removeprefix(roster.FAILING))
        return f"knows the truth and fails on purpose{f'. It {failing.description}' if failing else ''}"
    if pilot == "blind" or pilot.startswith(roster.BLIND):
        pattern = PATTERNS.get(pilot.removeprefix(roster.BLIND))
        return f"never looks at an image{f'. It {pattern.description}' if pattern else ''}"
    if pilot.startswith(roster.RECORDED):
        return "repeats the replies in a file"
    return "looks at the images with classical vision" if pilot in roster.SERVED else ""


def best_blind(table: BlindTable, episodes: Iterable[str]) -> tuple[str, int, int] | None:
    """Return (pilot, solved, flown) of the blind pilot that solved most of these episodes.

    None: no pilot flew all of them, or there are no episodes.
    """
    ids = sorted(set(episodes))
    solved = [
        (pilot, sum(flights[episode].success for episode in ids), len(ids))
        for pilot, flights in sorted(table.items())
        if all(episode in flights for episode in ids)
    ]
    return max(solved, key=lambda result: result[1], default=None) if ids else None


def cell_heading(cell: str) -> str:
    """Return a cell's name as a heading, such as Search-and-Track."""
    return "-".join(word if word == "and" else word.capitalize() for word in cell.split("-"))


def _marked(rows: Sequence[TableRow], columns: Sequence[TableColumn]) -> tuple[TableRow, ...]:
    """Return the rows with marked best cells. A column without a better direction or with one value has no marks."""
    best: Mapping[int, float] = {
        k: (max if column.better == "more" else min)(values)
        for k, column in enumerate(columns)
        if column.better and len(set(values := [v for row in rows if (v := _number(row.cells[k])) is not None])) > 1
    }
    return tuple(
        replace(row, cells=tuple(
            replace(cell, best=k in best and _number(cell) == best[k]) for k, cell in enumerate(row.cells)
        ))
        for row in rows
    )  # fmt: skip


def _number(cell: TableCell) -> float | None:
    return cell.value if isinstance(cell.value, int | float) else None


def percent(flights: Iterable[ScoredEpisode], metric: str) -> TableCell:
    """Return the share (%) of flights for which a metric holds, with its interval. The episode is the statistical unit.

    Flights that are not scored, or for which the metric is unknown, are left out.
    """
    outcomes: dict[str, list[bool]] = {}
    for flight in flights:
        value = flight.values.get(metric) if flight.scored else None
        if value is not None:
            outcomes.setdefault(flight.episode, []).append(bool(value))
    return share_cell(estimate_share(list(outcomes.values())))


def share_cell(share: ShareEstimate) -> TableCell:
    """Return a share (%) with its interval."""
    if not share.trials:
        return NONE
    low, high = PERCENT * share.low, PERCENT * share.high
    return TableCell(value=PERCENT * share.share, low=low, high=high, count=share.successes, of=share.trials)


def fraction(count: int, of: int) -> TableCell:
    """Return a share (%) of steps or drones. It has no interval, because the unit of intervals is the episode."""
    return TableCell(value=PERCENT * count / of, count=count, of=of) if of else NONE


def mean(flights: Iterable[ScoredEpisode], metric: str) -> TableCell:
    """Return the mean of a metric over the scored flights that have it."""
    known = known_values(flights, metric)
    return TableCell(value=statistics.fmean(known), of=len(known)) if known else NONE


def total(flights: Iterable[ScoredEpisode], metric: str) -> int:
    """Return the sum of a count over the scored flights that have it."""
    return round(sum(known_values(flights, metric)))


def known_values(flights: Iterable[ScoredEpisode], metric: str) -> list[float]:
    """Return the values of an episode metric for every scored flight that has it."""
    return metric_statistics.known_values(flight.values.get(metric) for flight in flights if flight.scored)


def steps(flights: Iterable[ScoredEpisode], metric: str) -> list[float]:
    """Return the values of a step metric for every step of scored flights that has it."""
    return metric_statistics.known_values(
        v for flight in flights if flight.scored for v in flight.steps.get(metric, ())
    )


def quantile(values: Sequence[float], share: float) -> TableCell:
    """Return a quantile, interpolated linearly."""
    return TableCell(value=metric_statistics.quantile(values, share), of=len(values)) if values else NONE


def not_scored(flights: Iterable[ScoredEpisode]) -> int:
    return sum(not flight.scored for flight in flights)
