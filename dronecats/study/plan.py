"""A study resolved: every pilot at every point of the design, so many flights of each, as runs of a campaign.

`check_flights` refuses a study of which one flight cannot be flown, before the first is.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from dronecats.bench.matrix import BenchEntry, ChosenSuite, slug
from dronecats.flight.run.pilot import agent_maker
from dronecats.flight.spec.flight import look_up
from dronecats.flight.spec.flight_spec import FlightSpec
from dronecats.study.design import Design, DesignPoint
from dronecats.study.factors import FACTORS, as_told, at_levels, check_together, said
from dronecats.study.no_effect import check_effects
from episodes.records.record import CELLS
from foundation.errors import UsageError
from foundation.run_folder.benchmark import Level, Study, StudyFactor, StudyRun

RUNS_MAX = 10_000
NAME_MAX = 100  # letters of a folder that tells its levels; longer ones tell the number of the point


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyPlan:
    """What study.json holds, and what is flown."""

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

    `pilots` are (name, flight but for the episode and the factors). The k-th flight of a pair (an episode and a pilot)
    has the same seed at every point of the design, and all points of a pair are flown before the next pair, and the
    first flight of all pairs before the second of any: a study that stops anywhere is paired but for its last flights.
    Raises UsageError for levels that do not go together, for a factor that says nothing, and for nothing to be flown.
    """
    factors = tuple(design.points[0]) if design.points else ()
    if both := next((each for each in factors if each in held), None):
        raise UsageError(f"{both} is varied and held at one level; leave one of them out")
    check_together([*held, *factors])
    if not pilots:
        raise UsageError("nothing is to be flown: name a pilot with --model or --pilot")
    count = len(pilots) * len(design.points) * flights
    if count > RUNS_MAX:
        raise UsageError(f"that makes {count:,} runs, more than {RUNS_MAX:,}: fewer points, pilots or flights")
    _check_fleets(suite, [each for point in design.points for each in (point.get("command"), held.get("command"))])
    points = [as_told(point) for point in design.points]
    if len({tuple(point.items()) for point in points}) < len(points):
        raise UsageError("two levels of latency_policy are the same recorded latencies; leave one of them out")
    check_effects(pilots[0][1], design.points, held)
    names = _names([pilot for pilot, _ in pilots], points)
    entries, runs = [], []
    for number in range(1, flights + 1):
        for pilot, base in pilots:
            for point, told in zip(design.points, points, strict=True):
                run = f"{names[pilot, tuple(told.items())]}-f{number}"
                flight = at_levels(replace(base, seed=base.seed + number - 1), {**held, **point})
                entries.append(
                    BenchEntry(name=run, flight=flight, episodes=tuple(suite.records), beside=f"{pilot} f{number}")
                )
                runs.append(StudyRun(name=run, levels=told, flight_number=number))
    cells = {record.cell for record in suite.records.values()}
    study = Study(
        name=name,
        design=design.said,
        factors=tuple(_factor(each, points) for each in factors),
        held=as_told(held),
        cells=tuple(cell for cell in CELLS if cell in cells),
        episodes=tuple(record.id for record in suite.records.values()),
        flights=flights,
        runs=tuple(runs),
    )
    return StudyPlan(study=study, entries=tuple(entries))


def _factor(name: str, points: Sequence[DesignPoint]) -> StudyFactor:
    levels = dict.fromkeys(point[name] for point in points)
    ordered = sorted(levels, key=float) if FACTORS[name].quantity else list(levels)
    return StudyFactor(name=name, unit=FACTORS[name].unit, levels=tuple(ordered))


def _check_fleets(suite: ChosenSuite, commands: Sequence[Level | None]) -> None:
    alone = next((record.id for record in suite.records.values() if len(record.starts) == 1), None)
    if alone and any(command not in (None, "flat") for command in commands):
        raise UsageError(f"command is of fleets, and {alone} has one drone: --cells commanding has fleets alone")


def _names(
    pilots: Sequence[str], points: Sequence[DesignPoint]
) -> dict[tuple[str, tuple[tuple[str, Level], ...]], str]:
    """Return the name of each pilot's folders at each point, but for the number of the flight."""

    def by_levels(pilot: str, point: DesignPoint, _: int) -> str:
        told = [f"{name}-{_in_name(level)}" for name, level in point.items()]
        return "-".join(slug(each) for each in (*([pilot] if pilot else []), *told))

    def by_number(pilot: str, _: DesignPoint, number: int) -> str:
        return "-".join([*([slug(pilot)] if pilot else []), f"point-{number:0{len(str(len(points)))}d}"])

    found: dict[tuple[str, tuple[tuple[str, Level], ...]], str] = {}
    for pilot in dict.fromkeys(pilots):  # each by itself, so that whoever is added renames nobody
        by_name = [by_levels(pilot, point, number) for number, point in enumerate(points, 1)]
        if len(set(by_name)) < len(points) or max(map(len, by_name)) > NAME_MAX:
            by_name = [by_number(pilot, point, number) for number, point in enumerate(points, 1)]
        found |= {(pilot, tuple(point.items())): name for point, name in zip(points, by_name, strict=True)}
    if len(set(found.values())) < len(pilots) * len(points):
        raise UsageError("two of the pilots have one name; give them other names in the file")
    return found


def _in_name(level: Level) -> str:
    """Return a level as a folder's name has it, where a minus alone would be lost."""
    return f"minus-{said(-level)}" if not isinstance(level, str) and level < 0 else said(level)


def check_flights(plan: StudyPlan) -> None:
    """Raise UsageError for the first flight that cannot be; where others can, by the levels at which it is.

    No model is asked whether it answers.
    """
    first: tuple[str, str] | None = None  # what is wrong, and with which levels
    others = False  # something else is wrong elsewhere, or nothing
    for entry, run in zip(plan.entries, plan.study.runs, strict=True):
        if run.flight_number > 1:  # it has another seed and nothing else
            continue
        wrong = _wrong(entry.flight)
        if wrong is not None and first is None:
            first = wrong, ", ".join(f"{name} {said(level)}" for name, level in run.levels.items())
        others |= wrong is None or (first is not None and wrong != first[0])
        if first and others:
            raise UsageError(f"at {first[1]}: {first[0]}")
    if first:
        raise UsageError(first[0])


def _wrong(flight: FlightSpec) -> str | None:
    """Return why a flight cannot be, None where it can. Its ledger is made with the folder, and not here."""
    try:
        look_up(replace(flight, accounts=replace(flight.accounts, ledger=None)))
        agent_maker(flight.agent)
    except UsageError as wrong:
        return str(wrong)
    return None
