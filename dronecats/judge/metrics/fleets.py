"""What became of each drone of a commanding episode, and how the fleet was told to fly. Paper, "Commanding Several
Drones".

Reached, declared and SR of a fleet are `oracle_success`, `declared` and `success`, which pool its drones.
"""

import math
from collections import Counter
from collections.abc import Callable, Iterable
from typing import Literal

from dronecats.judge.commanding import COMMANDING
from dronecats.judge.judged_flight import JudgedFlight
from dronecats.judge.metrics.metric import Metric, MetricValue
from dronecats.judge.verdict import Measured
from foundation.run_folder.rows import FrameTruth

DroneOutcome = Literal["found", "look-alike", "elsewhere", "never declared"]


def drone_outcomes(flight: JudgedFlight) -> dict[int, DroneOutcome] | None:
    """Return by drone the best that a declaration of it came to; None of other episodes, and where one is not known.

    found: one qualifies. look-alike: one was made within the radius of a look-alike's centre, in view or not; that is
    as high above its foot as the target's, of which it is a copy. elsewhere: it declared, and neither was so.
    """
    if not _commanding(flight) or not flight.verdict.drones:
        return None
    made: dict[int, list[Measured]] = {drone.drone: [] for drone in flight.verdict.drones}
    for declaration in flight.declarations:
        made.setdefault(declaration.drone, []).append(declaration)
    each = {drone: _outcome(flight, of_it) for drone, of_it in sorted(made.items())}
    known = {drone: outcome for drone, outcome in each.items() if outcome is not None}
    return known if len(known) == len(each) else None


def _outcome(flight: JudgedFlight, made: Iterable[Measured]) -> DroneOutcome | None:
    best: DroneOutcome = "never declared"
    unknown = False
    for declaration in made:
        qualifies = declaration.qualifies(flight.delta_m)
        if qualifies:
            return "found"
        frame = _frame(flight, declaration)
        beside = None if frame is None else _beside_look_alike(flight, frame)
        unknown = unknown or qualifies is None or beside is None
        best = "look-alike" if beside or best == "look-alike" else "elsewhere"
    return None if unknown else best


def _frame(flight: JudgedFlight, declaration: Measured) -> FrameTruth | None:
    return next(
        (
            step.truth
            for step in flight.steps
            if (step.decision.step, step.decision.drone) == (declaration.step, declaration.drone)
        ),
        None,
    )


def _beside_look_alike(flight: JudgedFlight, frame: FrameTruth) -> bool | None:
    """Return whether a drone was within the radius of a look-alike; None where the record or the frame cannot tell."""
    record = flight.logs.record
    if record is None or record.target.position_ned is None or frame.position_ned is None or frame.target_ned is None:
        return None
    rise_m = frame.target_ned[2] - record.target.position_ned[2]
    feet = [one.position_ned for one in record.candidates if one.position_ned is not None]
    return any(math.dist(frame.position_ned, (n, e, d + rise_m)) <= flight.delta_m for n, e, d in feet)


def _commanding(flight: JudgedFlight) -> bool:
    return flight.logs.record is not None and flight.logs.record.cell == COMMANDING


def _counted(outcome: DroneOutcome) -> Callable[[JudgedFlight], MetricValue]:
    def of(flight: JudgedFlight) -> MetricValue:
        told = drone_outcomes(flight)
        return None if told is None else Counter(told.values())[outcome]

    return of


drones_found, drones_beside = _counted("found"), _counted("look-alike")
drones_elsewhere, drones_silent = _counted("elsewhere"), _counted("never declared")


def identical_share(flight: JudgedFlight) -> float | None:
    """Return the share of the steps on which all drones go that give all of them one point."""
    return flight.verdict.commanding.identical_share if flight.verdict.commanding else None


def spread(flight: JudgedFlight) -> float | None:
    """Return the median over the steps of how far apart (m) the drones were sent, each from each on average."""
    return flight.verdict.commanding.spread_m if flight.verdict.commanding else None


def one_candidate_share(flight: JudgedFlight) -> float | None:
    """Return the share of the steps on which all drones go that bring all of them nearer to one candidate."""
    told = flight.verdict.commanding
    return told.one_candidate / told.all_go_steps if told and told.all_go_steps else None


def candidates_neared(flight: JudgedFlight) -> int | None:
    """Return how many candidates, the target among them, a drone was sent towards."""
    return flight.verdict.commanding.candidates_neared if flight.verdict.commanding else None


COMMAND = "Commanding Several Drones"
METRICS = (
    Metric(
        name="drones_found", title="Found the target", unit="count", level="episode", better="more",
        definition="drones of which a declaration qualifies",
        paper=COMMAND, of=drones_found,
    ),
    Metric(
        name="drones_beside", title="Declared at a look-alike", unit="count", level="episode", better="less",
        definition="other drones of which a declaration was made within the radius of a look-alike's centre",
        paper=COMMAND, of=drones_beside,
    ),
    Metric(
        name="drones_elsewhere", title="Declared elsewhere", unit="count", level="episode", better="less",
        definition="other drones that declared",
        paper=COMMAND, of=drones_elsewhere,
    ),
    Metric(
        name="drones_silent", title="Never declared", unit="count", level="episode", better=None,
        definition="drones that never declared within the cap",
        paper=COMMAND, of=drones_silent,
    ),
    Metric(
        name="identical_share", title="Coordinate copying", unit="ratio", level="episode", better="less",
        definition="of the steps on which all drones are told to go, those with one point for all",
        paper=COMMAND, of=identical_share,
    ),
    Metric(
        name="one_candidate_share", title="All at one candidate", unit="ratio", level="episode", better="less",
        definition="of the same steps, those on which every drone nears the same candidate",
        paper=COMMAND, of=one_candidate_share,
    ),
    Metric(
        name="candidates_neared", title="Candidates neared", unit="count", level="episode", better="more",
        definition="candidates towards which a drone was sent, the target among them",
        paper=COMMAND, of=candidates_neared,
    ),
    Metric(
        name="spread_m", title="Spread", unit="m", level="episode", better=None,
        definition="median over the steps of the mean distance between each two of the places that drones are sent to",
        paper=COMMAND, of=spread,
    ),
)  # fmt: skip
