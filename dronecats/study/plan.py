"""Plans a study: the runs in which every pilot flies every point of the design several times.

A point is one level of each varied factor. A factor that changes no flight is an error. Example: a factor that refines
another factor whose level is 0. All pilots fly the same levels, so the check uses only the first pilot's flights.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from dronecats.agent.latency import CAP, FIXED, RATE
from dronecats.bench.matrix import BenchEntry, ChosenSuite, slug
from dronecats.flight.run.pilot import agent_maker
from dronecats.flight.spec.flight import look_up
from dronecats.flight.spec.flight_spec import FlightSpec
from dronecats.flight.spec.spec_file import as_json
from dronecats.study.design import Design, DesignPoint
from dronecats.study.factors import FACTORS, at_levels, check_together, level_text, stored_levels
from episodes.records.record import CELLS
from foundation.errors import UsageError
from foundation.run_folder.results import Level, Study, StudyFactor, StudyRun

RUNS_MAX = 10_000
NAME_MAX = 100  # characters; a longer folder name has the point's number instead of the levels


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyPlan:
    """The content of study.json and the runs of the campaign."""

    study: Study
    entries: tuple[BenchEntry, ...]  # in the order of flying


def plan(
    name: str,
    pilots: Sequence[tuple[str, FlightSpec]],
    suite: ChosenSuite,
    design: Design,
    *,
    held: Mapping[str, Level],
    flights: int,
) -> StudyPlan:
    """Return the plan of a study.

    `pilots`: (name, flight); the flights have no episode and no levels yet. The k-th flight of an episode by a pilot
    has the same seed at every point. Round k has all k-th flights. In a round, the pilots fly one after another. Each
    pilot flies an episode at all points before the next episode. So if a study stops early, only its last flights lack
    a counterpart at other points. Raises UsageError for contradicting levels, a factor without an effect, and if there
    is nothing to fly.
    """
    factors = tuple(design.points[0]) if design.points else ()
    if overlap := next((factor for factor in factors if factor in held), None):
        raise UsageError(f"{overlap} is varied and also held at one level. Leave one of them out")
    check_together([*held, *factors])
    if not pilots:
        raise UsageError("no pilot was named. Add --model or --pilot")
    count = len(pilots) * len(design.points) * flights
    if count > RUNS_MAX:
        raise UsageError(f"the study has {count:,} runs, more than {RUNS_MAX:,}. Use fewer points, pilots or flights")
    _check_fleets(suite, [held.get("command"), *(point.get("command") for point in design.points)])
    points = [stored_levels(point) for point in design.points]
    if len({tuple(point.items()) for point in points}) < len(points):
        raise UsageError("two levels of latency_policy have the same recorded latencies. Leave one of them out")
    check_effects(pilots[0][1], design.points, held)
    names = _folder_names([pilot for pilot, _ in pilots], points)
    entries, runs = [], []
    for number in range(1, flights + 1):
        for pilot, base in pilots:
            for k, (point, levels) in enumerate(zip(design.points, points, strict=True)):
                run = f"{names[pilot, k]}-f{number}"
                flight = at_levels(replace(base, seed=base.seed + number - 1), {**held, **point})
                entries.append(
                    BenchEntry(name=run, flight=flight, episodes=tuple(suite.records), beside=f"{pilot} f{number}")
                )
                runs.append(StudyRun(name=run, levels=levels, flight_number=number))
    cells = {record.cell for record in suite.records.values()}
    study = Study(
        name=name,
        design=design.description,
        factors=tuple(_study_factor(factor, points) for factor in factors),
        held=stored_levels(held),
        cells=tuple(cell for cell in CELLS if cell in cells),
        episodes=tuple(record.id for record in suite.records.values()),
        flights=flights,
        runs=tuple(runs),
    )
    return StudyPlan(study=study, entries=tuple(entries))


def _study_factor(name: str, points: Sequence[DesignPoint]) -> StudyFactor:
    levels = dict.fromkeys(point[name] for point in points)
    ordered = sorted(levels, key=float) if FACTORS[name].quantity else list(levels)
    return StudyFactor(name=name, unit=FACTORS[name].unit, levels=tuple(ordered))


def _check_fleets(suite: ChosenSuite, commands: Sequence[Level | None]) -> None:
    alone = next((record.id for record in suite.records.values() if len(record.starts) == 1), None)
    if alone and any(command not in (None, "flat") for command in commands):
        raise UsageError(f"command needs a fleet, but {alone} has one drone. Use --cells commanding")


def _folder_names(pilots: Sequence[str], points: Sequence[DesignPoint]) -> dict[tuple[str, int], str]:
    """Return the folder name of each pilot at each point (by its index), without the number of the flight."""
    names: dict[tuple[str, int], str] = {}
    for pilot in dict.fromkeys(pilots):  # pilot by pilot, so that a new pilot does not rename the folders of others
        prefix = [slug(pilot)] if pilot else []
        by_levels = [[slug(f"{name}-{_name_part(level)}") for name, level in point.items()] for point in points]
        own = ["-".join([*prefix, *words]) for words in by_levels]
        if len(set(own)) < len(points) or max(map(len, own)) > NAME_MAX:
            digits = len(str(len(points)))
            own = ["-".join([*prefix, f"point-{number:0{digits}d}"]) for number in range(1, len(points) + 1)]
        names |= {(pilot, k): name for k, name in enumerate(own)}
    if len(set(names.values())) < len(pilots) * len(points):
        raise UsageError("two pilots have the same name. Give them different names in the file")
    return names


def _name_part(level: Level) -> str:
    """Return a level for a folder name; the minus sign becomes a word, since `slug` removes it."""
    return f"minus-{level_text(-level)}" if not isinstance(level, str) and level < 0 else level_text(level)


def check_flights(plan: StudyPlan) -> None:
    """Raise UsageError for the first flight that cannot be flown. Models are not contacted.

    The error names the levels of the flight, unless all flights fail for the same reason.
    """
    # a later flight differs from the first one only in the seed
    flights = [(entry, run) for entry, run in zip(plan.entries, plan.study.runs, strict=True) if run.flight_number == 1]
    reasons = [_refusal(entry.flight) for entry, _ in flights]
    for (_, run), reason in zip(flights, reasons, strict=True):
        if reason is not None:
            levels = ", ".join(f"{name} {level_text(level)}" for name, level in run.levels.items())
            raise UsageError(reason if set(reasons) == {reason} else f"at {levels}: {reason}")


def _refusal(flight: FlightSpec) -> str | None:
    """Return why a flight cannot be flown; None if it can be. Ignores the cost ledger, which does not exist yet."""
    try:
        look_up(replace(flight, accounts=replace(flight.accounts, ledger=None)))
        agent_maker(flight.agent)
    except UsageError as error:
        return str(error)
    return None


COMPARED = ("rate_cap",)  # factors that need only one level with an effect: their other levels are references


def check_effects(flight: FlightSpec, points: Sequence[DesignPoint], held: Mapping[str, Level]) -> None:
    """Raise UsageError for a varied or held factor without effect, and for two levels that give the same flight.

    `flight` is any flight of the study, without levels. The function sets `held` and the levels of each point.
    """
    if not points:
        return
    flights = [at_levels(flight, {**held, **point}) for point in points]
    for name in (*points[0], *held):
        reasons = [_no_effect_reason(name, case) for case in flights]
        effective = [point for point, reason in zip(points, reasons, strict=True) if reason is None]
        is_varied = name in points[0]
        compares_levels = is_varied and name not in COMPARED and len({point[name] for point in points}) > 1
        if len({point.get(name) for point in effective}) < (2 if compares_levels else 1):
            reason = next(reason for reason in reasons if reason is not None)
            where = "at all of its levels but one" if effective else "in any flight"
            level = "" if is_varied else f" at {level_text(held[name])}"
            raise UsageError(f"{name}{level} has no effect {where}: {reason}")
        if is_varied:
            _check_distinct_levels(flight, {**held, **effective[0]}, name, [point[name] for point in points])


def _check_distinct_levels(flight: FlightSpec, at: Mapping[str, Level], name: str, levels: Sequence[Level]) -> None:
    """Raise UsageError if two levels of a factor give the same flight. `at` has the levels of the other factors."""
    levels_of: dict[str, Level] = {}
    for level in dict.fromkeys(levels):
        try:
            content = json.dumps(as_json(at_levels(flight, {**at, name: level})))
        except UsageError:  # this level is invalid with these levels of the other factors
            continue
        if content in levels_of:
            raise UsageError(
                f"{name} at {level_text(levels_of[content])} and at {level_text(level)} gives the same flight."
                " Leave one of them out"
            )
        levels_of[content] = level


def _no_effect_reason(name: str, flight: FlightSpec) -> str | None:
    """Return the reason why a factor has no effect on a flight; None if it has one."""
    if name == "rate_cap":
        return _cap_reason(flight)
    refined = FACTORS[name].refines
    if not refined or FACTORS[refined].get(flight) != 0.0:
        return None
    return f"{refined} is 0 in these flights. Vary it, or hold it above 0"


def _cap_reason(flight: FlightSpec) -> str | None:
    """Return the reason why a rate cap delays no reply; None if it delays some."""
    policy = flight.latency
    takes_s = sum(policy.numbers(FIXED)) + sum(1.0 / hz for hz in policy.numbers(RATE))
    if not any(takes_s * hz >= 1.0 for hz in policy.numbers(CAP)):
        return None
    held = f"{policy.numbers(CAP)[0]:g} Hz delays none of these replies"
    return f"every reply takes {takes_s:g} s, and {held}. Change a level of one of these factors"
