"""Reads the results of a study from a folder, and checks that the runs differ only in the levels of its factors."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
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
    labels, identities = _entrants(runs, study, study_runs)
    _check_identities(runs, labels, identities)
    _check_seeds(runs, labels, study_runs)
    _check_duplicates(runs, labels, study_runs)
    flights = tuple(
        StudiedFlight(
            entrant=labels[scored.run.folder],
            levels=tuple(_as_level(study_runs[scored.run.folder.name].levels[name]) for name in names),
            number=study_runs[scored.run.folder.name].flight_number,
            scored=scored,
        )
        for scored in collection.episodes
        if scored.run.folder in labels
    )
    cells = {flight.scored.cell for flight in flights}
    factors = tuple(_factor(study, name) for name in names)
    return StudyResults(
        name=study.name,
        design=study.design,
        factors=factors,
        entrants=tuple(dict.fromkeys(labels.values())),
        cells=tuple(cell for cell in (*CELLS, "") if cell in cells),
        flights=flights,
        planned=len(study.runs) * len(study.episodes),
        notes=(
            *_agent_notes(study),
            *_notes(runs, labels, identities),
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


def _entrants(
    runs: Sequence[RecordedRun], study: Study, study_runs: Mapping[str, StudyRun]
) -> tuple[dict[Path, str], dict[Path, Identity]]:
    """Return, by run folder, the label of the run's entrant, and the identity (settings) of the run.

    The factors must not affect the identity, so every identity is computed with the levels of the first run.
    """
    first = study_runs[runs[0].folder.name].levels
    same_levels = {factor.name: first[factor.name] for factor in study.factors if factor.name not in ENTRANT_FACTORS}
    traces = _traces(runs)
    settings: dict[Path, Setting] = {}
    identities: dict[Path, Identity] = {}
    for run in runs:
        flight = from_json(run.flight, str(run.folder / layout.RUN))
        levelled = as_redacted_json(_with_levels(flight, {**study.held, **same_levels}, traces))
        levelled_run = replace(run, configuration={**run.configuration, "flight": levelled})
        settings[run.folder] = replace(setting(levelled_run), latency="", agent=flight.agent)
        identities[run.folder] = identity(levelled_run)
    all_settings = list(dict.fromkeys(settings.values()))
    return {folder: _label(own, all_settings) for folder, own in settings.items()}, identities


def _label(own: Setting, all_settings: Sequence[Setting]) -> str:
    """Return the pilot's name, and its settings that are unusual or differ between entrants of this name."""
    name = f"replay of {own.pilot}" if own.replayed else own.pilot
    usual = {"command": FLAT, "commander": "", "agent": PAPER}
    namesakes = [s for s in all_settings if (s.pilot, s.replayed) == (own.pilot, own.replayed)]
    details = [
        value
        for field, plain in usual.items()
        if (value := str(getattr(own, field))) != plain or any(getattr(s, field) != value for s in namesakes)
    ]
    for field in REQUEST_FIELDS:
        value = getattr(own, field)
        if any(getattr(s, field) != value for s in namesakes):
            details.append(value)
    return " · ".join([name, *filter(None, details)])


def _check_identities(
    runs: Sequence[RecordedRun], labels: Mapping[Path, str], identities: Mapping[Path, Identity]
) -> None:
    first: dict[str, RecordedRun] = {}
    for run in runs:
        codes = sorted(identities[run.folder]["the code"])
        if len(codes) > 1:
            raise UsageError(f"the episodes of {run.folder} were flown by different code")
        before = first.setdefault(labels[run.folder], run)
        differing = differences(identities[before.folder], identities[run.folder])
        if differing:
            text = ", ".join(str(difference) for difference in differing[:4]) + (
                " and more" if len(differing) > 4 else ""
            )
            raise UsageError(
                f"{before.folder.name} and {run.folder.name} differ in more than the study's factors: in {text}."
                " The effect of the factors cannot be separated from these differences"
            )


def _check_seeds(runs: Sequence[RecordedRun], labels: Mapping[Path, str], study_runs: Mapping[str, StudyRun]) -> None:
    seeds: dict[tuple[str, int], RecordedRun] = {}
    for run in runs:
        before = seeds.setdefault((labels[run.folder], study_runs[run.folder.name].flight_number), run)
        if before.seed != run.seed:
            raise UsageError(
                f"{before.folder.name} and {run.folder.name} are paired in {layout.STUDY}, but have the seeds"
                f" {before.seed} and {run.seed}"
            )


def _check_duplicates(
    runs: Sequence[RecordedRun], labels: Mapping[Path, str], study_runs: Mapping[str, StudyRun]
) -> None:
    """Raise UsageError if one flight was flown under two names: it would count twice."""
    seen: dict[tuple[str, frozenset[tuple[str, Level]], int], str] = {}
    for run in runs:
        name = run.folder.name
        before = seen.setdefault(
            (labels[run.folder], frozenset(study_runs[name].levels.items()), study_runs[name].flight_number), name
        )
        if before != name:
            raise UsageError(
                f"{before} and {name} are the same flight by {labels[run.folder]} under two names. Remove one of them"
                f" from {layout.STUDY}"
            )


def _notes(
    runs: Sequence[RecordedRun], labels: Mapping[Path, str], identities: Mapping[Path, Identity]
) -> Iterator[str]:
    """Yield sentences on entrants that differ in settings that all should share (`is_common`), or in their seeds."""
    first: dict[str, RecordedRun] = {}
    for run in runs:
        first.setdefault(labels[run.folder], run)
    common = {
        label: {name: value for name, value in identities[run.folder].items() if is_common(name)}
        for label, run in first.items()
    }
    (label, kind), *rest = common.items()
    for other_label, another in rest:
        if differing := differences(kind, another):
            yield f"{label} and {other_label} have different settings: {', '.join(map(str, differing))}."
    seeds = {label: min(run.seed for run in runs if labels[run.folder] == label) for label in first}
    if len(set(seeds.values())) > 1:
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
