"""Reads a study's results from a folder, and checks that the runs differ only in the levels of the study's factors."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from dronecats.agent.latency import LatencyPolicy, trace_name
from dronecats.agent.names import PAPER
from dronecats.flight.spec.flight_spec import FlightSpec, digest_of
from dronecats.flight.spec.spec_file import as_redacted_json, from_json
from dronecats.judge.metrics.judging import METRICS
from dronecats.report.recorded.run import RecordedRun
from dronecats.report.report_data import FLAT, REQUEST_FIELDS, Setting, is_common, setting
from dronecats.report.results.collection import Exclusion, collect, exclude, exclusion_sentences
from dronecats.report.results.identity import Identity, differences, identity
from dronecats.study import folder as study_folder
from dronecats.study.analysis.steps import METRICS as MOTION
from dronecats.study.analysis.study_results import MANY, StudiedFactor, StudiedFlight, StudiedLevel, StudyResults
from dronecats.study.factors import ENTRANT_FACTORS, POLICY, at_levels
from episodes.records.record import CELLS
from foundation.errors import UsageError
from foundation.run_folder import layout
from foundation.run_folder.results import Level, Study, StudyRun

# factors whose highest level is the reference
MORE_IS_EASIER = ("rate", "rate_cap", "frame_rate", "setpoint_rate", "link_baud")
NONE_COUNTS = "No flight counts yet."


def load_results(folder: Path, exclusions: Sequence[Exclusion] = ()) -> StudyResults:
    """Return the results of the study in a folder. Flights that `exclusions` exclude are marked as left out.

    Raises UsageError if the folder holds no study, if a run contradicts study.json, if runs of one entrant (pilot)
    differ in more than their levels, if paired flights have different seeds, or if a flight was flown twice.
    """
    study = study_folder.read(folder)
    collection = exclude(collect([folder], metrics=(*METRICS.values(), *MOTION)), exclusions)
    study_runs = {run.name: run for run in study.runs}
    runs = [run for run in collection.runs if run.folder.name in study_runs]
    if not runs:
        raise UsageError(f"{folder} has no run of its study. Fly it with the command that made it")
    names = [factor.name for factor in study.factors if factor.name not in ENTRANT_FACTORS]
    _check_levels(study, runs, study_runs)
    loaded = _with_entrants(runs, study, study_runs)
    _check_identities(loaded)
    _check_seeds(loaded)
    _check_duplicates(loaded)
    by_folder = {one.run.folder: one for one in loaded}
    flights = tuple(
        StudiedFlight(
            entrant=one.label,
            levels=tuple(_as_level(one.planned.levels[name]) for name in names),
            number=one.planned.flight_number,
            scored=scored,
        )
        for scored in collection.episodes
        if (one := by_folder.get(scored.run.folder))
    )
    cells = {flight.scored.cell for flight in flights}
    factors = tuple(_factor(study, name) for name in names)
    return StudyResults(
        name=study.name,
        design=study.design,
        factors=factors,
        entrants=tuple(dict.fromkeys(one.label for one in loaded)),
        cells=tuple(cell for cell in (*CELLS, "") if cell in cells),
        flights=flights,
        planned=len(study.runs) * len(study.episodes),
        notes=(
            *_agent_notes(study),
            *_notes(loaded),
            *_exclusion_notes(flights, factors, exclusions),
            *(() if any(flight.scored.scored for flight in flights) else [NONE_COUNTS]),
        ),
    )


def _agent_notes(study: Study) -> list[str]:
    """Return a sentence that says which words in the names of the entrants are agents; empty if no agent varies."""
    return [
        f"Agents of this study: {', '.join(map(str, factor.levels))}. An agent asks the pilot and flies its actions."
        for factor in study.factors
        if factor.name == "agent"
    ]


def _factor(study: Study, name: str) -> StudiedFactor:
    declared = next(factor for factor in study.factors if factor.name == name)
    levels = tuple(_as_level(level) for level in declared.levels)
    easiest = max(levels) if name in MORE_IS_EASIER else levels[0]
    return StudiedFactor(name=name, unit=declared.unit, levels=levels, reference=easiest)


def _as_level(level: Level) -> StudiedLevel:
    return level if isinstance(level, str) else float(level)


def _check_levels(study: Study, runs: Sequence[RecordedRun], study_runs: Mapping[str, StudyRun]) -> None:
    """Raise UsageError if a run was not flown at its levels in study.json."""
    traces = _traces(runs)
    for run in runs:
        levels = {**study.held, **study_runs[run.folder.name].levels}
        missing = [factor.name for factor in study.factors if factor.name not in levels]
        if missing:
            raise UsageError(f"{layout.STUDY} has no level of {missing[0]} for {run.folder.name}")
        flight = from_json(run.flight, str(run.folder / layout.RUN))
        if as_redacted_json(_with_levels(flight, levels, traces)) != as_redacted_json(flight):
            text = ", ".join(f"{name} {level}" for name, level in levels.items())
            raise UsageError(f"{run.folder} was not flown at its levels in {layout.STUDY}: {text}")


def _traces(runs: Sequence[RecordedRun]) -> dict[str, tuple[float, ...]]:
    """Return the recorded latencies (s) in the flights of the runs, by the name of the trace."""
    traces = (run.flight.get("latency_trace") for run in runs)
    return {trace_name(trace): tuple(trace) for trace in traces if trace}


def _with_levels(
    flight: FlightSpec, levels: Mapping[str, Level], traces: Mapping[str, tuple[float, ...]]
) -> FlightSpec:
    """Return a flight at these levels. `traces` maps the name of a trace in the levels to its recorded latencies (s).

    If the levels name the flight's model, the settings and prices in the flight are kept, since those in models.toml
    may have changed.
    """
    named = str(levels.get("model", ""))
    if flight.model is not None and ("/" not in named or named == flight.model.title):
        levels = {name: level for name, level in levels.items() if name != "model"}
    recorded = traces.get(name := digest_of(str(levels.get(POLICY, ""))) or "")
    traced = replace(flight, latency=LatencyPolicy.parse(f"trace:{name}", recorded)) if recorded else flight
    return at_levels(traced, levels)


@dataclass(frozen=True, slots=True)
class _LoadedRun:
    run: RecordedRun
    planned: StudyRun  # its entry in study.json
    label: str  # of its entrant
    identity: Identity  # its settings


def _with_entrants(runs: Sequence[RecordedRun], study: Study, study_runs: Mapping[str, StudyRun]) -> list[_LoadedRun]:
    """Return the runs with the labels of their entrants and their identities.

    The factors must not affect the identity, so every identity is computed with the levels of the first run.
    """
    first = study_runs[runs[0].folder.name].levels
    same_levels = {factor.name: first[factor.name] for factor in study.factors if factor.name not in ENTRANT_FACTORS}
    traces = _traces(runs)
    settings: list[Setting] = []
    identities: list[Identity] = []
    for run in runs:
        flight = from_json(run.flight, str(run.folder / layout.RUN))
        levelled = as_redacted_json(_with_levels(flight, {**study.held, **same_levels}, traces))
        levelled_run = replace(run, configuration={**run.configuration, "flight": levelled})
        settings.append(replace(setting(levelled_run), latency="", agent=flight.agent))
        identities.append(identity(levelled_run))
    all_settings = list(dict.fromkeys(settings))
    return [
        _LoadedRun(run, study_runs[run.folder.name], _label(own, all_settings), of_run)
        for run, own, of_run in zip(runs, settings, identities, strict=True)
    ]


def _label(own: Setting, all_settings: Sequence[Setting]) -> str:
    """Return the pilot's name, and its settings that are unusual or differ between entrants of this name."""
    name = f"replay of {own.pilot}" if own.replayed else own.pilot
    usual = {
        "command": FLAT,
        "commander": "",
        "agent": PAPER,
        **{field: getattr(own, field) for field in REQUEST_FIELDS},
    }
    namesakes = [s for s in all_settings if (s.pilot, s.replayed) == (own.pilot, own.replayed)]
    details = [
        value
        for field, plain in usual.items()
        if (value := str(getattr(own, field))) != plain or any(getattr(s, field) != value for s in namesakes)
    ]
    return " · ".join([name, *filter(None, details)])


def _check_identities(loaded: Sequence[_LoadedRun]) -> None:
    first: dict[str, _LoadedRun] = {}
    for one in loaded:
        codes = sorted(one.identity["the code"])
        if len(codes) > 1:
            raise UsageError(f"the episodes of {one.run.folder} were flown by different code")
        before = first.setdefault(one.label, one)
        differing = differences(before.identity, one.identity)
        if differing:
            text = ", ".join(str(difference) for difference in differing[:4]) + (
                " and more" if len(differing) > 4 else ""
            )
            raise UsageError(
                f"{before.planned.name} and {one.planned.name} differ in more than the study's factors: in {text}."
                " The effect of the factors cannot be separated from these differences"
            )


def _check_seeds(loaded: Sequence[_LoadedRun]) -> None:
    first: dict[tuple[str, int], _LoadedRun] = {}
    for one in loaded:
        before = first.setdefault((one.label, one.planned.flight_number), one)
        if before.run.seed != one.run.seed:
            raise UsageError(
                f"{before.planned.name} and {one.planned.name} are paired in {layout.STUDY}, but have the seeds"
                f" {before.run.seed} and {one.run.seed}"
            )


def _check_duplicates(loaded: Sequence[_LoadedRun]) -> None:
    """Raise UsageError if one flight was flown under two names: it would count twice."""
    first: dict[object, _LoadedRun] = {}
    for one in loaded:
        key = one.label, frozenset(one.planned.levels.items()), one.planned.flight_number
        before = first.setdefault(key, one)
        if before is not one:
            raise UsageError(
                f"{before.planned.name} and {one.planned.name} are the same flight by {one.label} under two names."
                f" Remove one of them from {layout.STUDY}"
            )


def _notes(loaded: Sequence[_LoadedRun]) -> Iterator[str]:
    """Yield sentences on entrants that differ in settings that all should share (`is_common`), or in their seeds."""
    common = {
        one.label: {name: value for name, value in one.identity.items() if is_common(name)} for one in reversed(loaded)
    }
    labels = dict.fromkeys(one.label for one in loaded)
    label, *rest = labels
    for other_label in rest:
        if differing := differences(common[label], common[other_label]):
            yield f"{label} and {other_label} have different settings: {', '.join(map(str, differing))}."
    if len({min(one.run.seed for one in loaded if one.label == label) for label in labels}) > 1:
        yield "The entrants' seeds begin at different numbers, so their pairs share only the episode."


def _exclusion_notes(
    flights: Sequence[StudiedFlight], factors: Sequence[StudiedFactor], exclusions: Sequence[Exclusion]
) -> Iterator[str]:
    """Yield sentences on the exclusions, and on the excluded share at each level; unequal shares bias the result."""
    yield from exclusion_sentences([flight.scored for flight in flights], exclusions)
    if not any(flight.scored.left_out for flight in flights):
        return
    for k, factor in enumerate(factors):
        at = {level: [flight for flight in flights if flight.levels[k] == level] for level in factor.levels}
        shares = (
            f"{sum(flight.scored.left_out is not None for flight in group)} of {len(group)} at {factor.label(level)}"
            for level, group in at.items()
        )
        if len(at) <= MANY:
            yield f"Left out along {factor.words}: {', '.join(shares)}."
