"""A study's folder read back: its flights with their levels, refused where they differ in more than these."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from dronecats.agent.latency import LatencyPolicy, trace_name
from dronecats.agent.names import PAPER
from dronecats.flight.spec.flight_spec import FlightSpec, digest_of
from dronecats.flight.spec.spec_file import as_kept, from_json
from dronecats.judge.metrics.metric import Metric
from dronecats.judge.metrics.registry import METRICS
from dronecats.report.recorded.run import RecordedRun
from dronecats.report.results.collection import collect
from dronecats.report.results.entrants import FLAT, Setting, setting
from dronecats.report.results.exclusion import Exclusion, exclude, exclusion_sentences
from dronecats.report.results.identity import Identity, differences, identity
from dronecats.study import folder as study_folder
from dronecats.study.analysis.studied import MANY, Studied, StudiedFactor, StudiedFlight, StudiedLevel
from dronecats.study.analysis.target_motion import METRICS as MOTION
from dronecats.study.factors import POLICY, WHO_FLIES, at_levels
from episodes.records.record import CELLS
from foundation.errors import UsageError
from foundation.run_folder import layout
from foundation.run_folder.benchmark import Level, Study, StudyRun

MORE_IS_EASIER = ("rate", "frame_rate", "setpoint_rate", "link_baud")  # of these the highest level is the reference
NONE_COUNTS = "No flight counts yet."
ALIKE = ("the code", "the camera", "the clock", "the protocol", "the suite", "the version")  # whoever flew


def flown_study(folder: Path, metrics: Sequence[Metric] = (), exclusions: Sequence[Exclusion] = ()) -> Studied:
    """Return the study that was flown in a folder; `metrics` are measured besides, `exclusions` leave flights out.

    Raises UsageError where there is none, where a run is not what study.json says of it, where runs of one entrant
    differ in more than their levels, where flights that are a pair have not the same seed, and where one of them was
    flown twice.
    """
    study = study_folder.read(folder)
    collection = exclude(collect([folder], metrics=(*METRICS.values(), *MOTION, *metrics)), exclusions)
    told = {run.name: run for run in study.runs}
    runs = [run for run in collection.runs if run.folder.name in told]
    if not runs:
        raise UsageError(f"{folder} holds no run of its study; fly it with the command that made it")
    names = [factor.name for factor in study.factors if factor.name not in WHO_FLIES]
    _check_levels(study, runs, told)
    labels, kinds = _entrants(runs, study, told)
    _check_kinds(runs, labels, kinds)
    _check_seeds(runs, labels, told)
    _check_once(runs, labels, told)
    flights = tuple(
        StudiedFlight(
            entrant=labels[scored.run.folder],
            levels=tuple(_level(told[scored.run.folder.name].levels[name]) for name in names),
            number=told[scored.run.folder.name].flight_number,
            scored=scored,
        )
        for scored in collection.episodes
        if scored.run.folder in labels
    )
    cells = {each.scored.cell for each in flights}
    factors = tuple(_factor(study, name) for name in names)
    return Studied(
        name=study.name,
        design=study.design,
        factors=factors,
        entrants=tuple(dict.fromkeys(labels.values())),
        cells=tuple(cell for cell in (*CELLS, "") if cell in cells),
        flights=flights,
        planned=len(study.runs) * len(study.episodes),
        notes=(
            *_notes(runs, labels, kinds),
            *_excluded(flights, factors, exclusions),
            *(() if any(each.scored.scored for each in flights) else [NONE_COUNTS]),
        ),
    )


def _factor(study: Study, name: str) -> StudiedFactor:
    told = next(factor for factor in study.factors if factor.name == name)
    levels = tuple(_level(level) for level in told.levels)
    easiest = max(levels) if name in MORE_IS_EASIER else levels[0]
    return StudiedFactor(name=name, unit=told.unit, levels=levels, reference=easiest)


def _level(level: Level) -> StudiedLevel:
    return level if isinstance(level, str) else float(level)


def _check_levels(study: Study, runs: Sequence[RecordedRun], told: Mapping[str, StudyRun]) -> None:
    """Raise UsageError where a run was not flown at the levels that study.json tells of it."""
    traces = _traces(runs)
    for run in runs:
        levels = {**study.held, **told[run.folder.name].levels}
        missing = [factor.name for factor in study.factors if factor.name not in levels]
        if missing:
            raise UsageError(f"{layout.STUDY} tells no level of {missing[0]} for {run.folder.name}")
        flight = from_json(run.flight, str(run.folder / layout.RUN))
        if as_kept(_at_levels(flight, levels, traces)) != as_kept(flight):
            said = ", ".join(f"{name} {level}" for name, level in levels.items())
            raise UsageError(f"{run.folder} was not flown at what {layout.STUDY} says of it: {said}")


def _traces(runs: Sequence[RecordedRun]) -> dict[str, tuple[float, ...]]:
    """Return the recorded latencies (s) that travelled with the flights, by the name that they are known by."""
    found = (run.flight.get("latency_trace") for run in runs)
    return {trace_name(trace): tuple(trace) for trace in found if trace}


def _at_levels(flight: FlightSpec, levels: Mapping[str, Level], traces: Mapping[str, tuple[float, ...]]) -> FlightSpec:
    """Return a flight at some levels, whichever of the study's recorded latencies they name."""
    recorded = traces.get(name := digest_of(str(levels.get(POLICY, ""))) or "")
    traced = replace(flight, latency=LatencyPolicy.parse(f"trace:{name}", recorded)) if recorded else flight
    return at_levels(traced, levels)


def _entrants(
    runs: Sequence[RecordedRun], study: Study, told: Mapping[str, StudyRun]
) -> tuple[dict[Path, str], dict[Path, Identity]]:
    """Return who flew each run, a label, and its identity as if every factor had been at the same level."""
    first = told[runs[0].folder.name].levels  # which was flown, whatever it names
    same = {factor.name: first[factor.name] for factor in study.factors if factor.name not in WHO_FLIES}
    traces = _traces(runs)
    settings: dict[Path, Setting] = {}
    kinds: dict[Path, Identity] = {}
    for run in runs:
        flight = from_json(run.flight, str(run.folder / layout.RUN))
        levelled = as_kept(_at_levels(flight, {**study.held, **same}, traces))
        one = replace(run, configuration={**run.configuration, "flight": levelled})
        settings[run.folder] = replace(setting(one), latency="", agent=flight.agent)
        kinds[run.folder] = identity(one)
    every = list(dict.fromkeys(settings.values()))
    return {folder: _label(one, every) for folder, one in settings.items()}, kinds


def _label(one: Setting, every: Sequence[Setting]) -> str:
    """Return the pilot's name, with as much of what it flew under as tells it from the others of that name."""
    name = f"replay of {one.pilot}" if one.replayed else one.pilot
    usual = {"command": FLAT, "commander": "", "agent": PAPER}
    namesakes = [other for other in every if (other.pilot, other.replayed) == (one.pilot, one.replayed)]
    said = [
        value
        for field, plain in usual.items()
        if (value := str(getattr(one, field))) != plain or any(getattr(other, field) != value for other in namesakes)
    ]
    return " · ".join([name, *filter(None, said)])


def _check_kinds(runs: Sequence[RecordedRun], labels: Mapping[Path, str], kinds: Mapping[Path, Identity]) -> None:
    first: dict[str, RecordedRun] = {}
    for run in runs:
        codes = sorted(kinds[run.folder]["the code"])
        if len(codes) > 1:
            raise UsageError(f"the episodes of {run.folder} were flown by different code")
        before = first.setdefault(labels[run.folder], run)
        found = differences(kinds[before.folder], kinds[run.folder])
        if found:
            said = ", ".join(str(each) for each in found[:4]) + (" and more" if len(found) > 4 else "")
            raise UsageError(
                f"{before.folder.name} and {run.folder.name} differ in more than the study's factors: in {said};"
                " what differs besides cannot be told from what the factors do"
            )


def _check_seeds(runs: Sequence[RecordedRun], labels: Mapping[Path, str], told: Mapping[str, StudyRun]) -> None:
    seeds: dict[tuple[str, int], RecordedRun] = {}
    for run in runs:
        before = seeds.setdefault((labels[run.folder], told[run.folder.name].flight_number), run)
        if before.seed != run.seed:
            raise UsageError(
                f"{before.folder.name} and {run.folder.name} are said to be paired, and have the seeds {before.seed}"
                f" and {run.seed}"
            )


def _check_once(runs: Sequence[RecordedRun], labels: Mapping[Path, str], told: Mapping[str, StudyRun]) -> None:
    """Raise UsageError where one flight was flown under two names: it would count twice."""
    seen: dict[tuple[str, frozenset[tuple[str, Level]], int], str] = {}
    for run in runs:
        name = run.folder.name
        before = seen.setdefault(
            (labels[run.folder], frozenset(told[name].levels.items()), told[name].flight_number), name
        )
        if before != name:
            raise UsageError(
                f"{before} and {name} are one flight by {labels[run.folder]}, flown under two names; leave one of them"
                f" out of {layout.STUDY}"
            )


def _notes(runs: Sequence[RecordedRun], labels: Mapping[Path, str], kinds: Mapping[Path, Identity]) -> Iterator[str]:
    """Yield in what entrants were not flown alike, a sentence each."""
    first: dict[str, RecordedRun] = {}
    for run in runs:
        first.setdefault(labels[run.folder], run)
    common = {
        label: {what: value for what, value in kinds[run.folder].items() if what.startswith(ALIKE)}
        for label, run in first.items()
    }
    (one, kind), *rest = common.items()
    for other, another in rest:
        if found := differences(kind, another):
            yield f"{one} and {other} were not flown alike: they differ in {', '.join(map(str, found))}."
    seeds = {label: min(run.seed for run in runs if labels[run.folder] == label) for label in first}
    if len(set(seeds.values())) > 1:
        yield "The entrants' seeds begin at different numbers, so that pairs of theirs share their episodes alone."


def _excluded(
    flights: Sequence[StudiedFlight], factors: Sequence[StudiedFactor], exclusions: Sequence[Exclusion]
) -> Iterator[str]:
    """Yield which flights are left out, and of each factor at which levels: unequal shares favour some of them."""
    yield from exclusion_sentences([each.scored for each in flights], exclusions)
    if not any(each.scored.left_out for each in flights):
        return
    for k, factor in enumerate(factors):
        at = {level: [each for each in flights if each.levels[k] == level] for level in factor.levels}
        shares = (
            f"{sum(each.scored.left_out is not None for each in flown)} of {len(flown)} at {factor.told(level)}"
            for level, flown in at.items()
        )
        if len(at) <= MANY:
            yield f"Left out along {factor.name.replace('_', ' ')}: {', '.join(shares)}."
