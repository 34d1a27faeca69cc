"""Metrics of commanding episodes, which have a fleet: the outcome of each drone, and the fleet's commands.

Source: paper, "Commanding Several Drones". The paper's Reached, Declared and SR of a fleet are the metrics
`oracle_success`, `declared` and `success`, which pool the drones.
"""

import math
from collections import Counter
from collections.abc import Iterable
from typing import Literal

from dronecats.judge.commanding import COMMANDING
from dronecats.judge.judged_flight import JudgedFlight
from dronecats.judge.metrics.metric import Metric, MetricFunction, MetricValue, verdict_value
from dronecats.judge.verdict import Measured
from foundation.run_folder.rows import FrameTruth

DroneOutcome = Literal["found", "look-alike", "elsewhere", "never declared"]


def drone_outcomes(flight: JudgedFlight) -> dict[int, DroneOutcome] | None:
    """Return the best outcome of each drone's declarations; None for other episodes, and if an outcome is unknown.

    found: a declaration qualifies. look-alike: a declaration is within the radius of the centre of a look-alike (a copy
    of the target at another place), in view or not. elsewhere: any other declaration. The record gives only
    the foot of a look-alike. The centre is assumed to be as high above the foot as the target's centre.
    """
    record = flight.logs.record
    if record is None or record.cell != COMMANDING or not flight.verdict.drones:
        return None
    made: dict[int, list[Measured]] = {drone.drone: [] for drone in flight.verdict.drones}
    for declaration in flight.declarations:
        made.setdefault(declaration.drone, []).append(declaration)
    outcomes = {}
    for drone, declarations in sorted(made.items()):
        outcome = _outcome(flight, declarations)
        if outcome is None:
            return None
        outcomes[drone] = outcome
    return outcomes


def _outcome(flight: JudgedFlight, made: Iterable[Measured]) -> DroneOutcome | None:
    best: DroneOutcome = "never declared"
    unknown = False
    frames = {(step.decision.step, step.decision.drone): step.truth for step in reversed(flight.steps)}
    for declaration in made:
        qualifies = declaration.qualifies(flight.delta_m)
        if qualifies:
            return "found"
        frame = frames.get((declaration.step, declaration.drone))
        beside = _is_at_look_alike(flight, frame) if frame else None
        unknown = unknown or qualifies is None or beside is None
        best = "look-alike" if beside or best == "look-alike" else "elsewhere"
    return None if unknown else best


def _is_at_look_alike(flight: JudgedFlight, frame: FrameTruth) -> bool | None:
    """Return whether a drone was within the radius of a look-alike; None if record or frame lack a position."""
    record = flight.logs.record
    if record is None or record.target.position_ned is None or frame.position_ned is None or frame.target_ned is None:
        return None
    rise_m = frame.target_ned[2] - record.target.position_ned[2]
    feet = [candidate.position_ned for candidate in record.candidates if candidate.position_ned is not None]
    return any(math.dist(frame.position_ned, (n, e, d + rise_m)) <= flight.delta_m for n, e, d in feet)


def _outcome_count(outcome: DroneOutcome) -> MetricFunction:
    def of(flight: JudgedFlight) -> MetricValue:
        outcomes = drone_outcomes(flight)
        return None if outcomes is None else Counter(outcomes.values())[outcome]

    return of


def one_candidate_share(flight: JudgedFlight) -> float | None:
    """Of the steps in which every drone got a go, return the share in which all drones approach the same candidate."""
    commanding = flight.verdict.commanding
    return commanding.one_candidate / commanding.all_go_steps if commanding and commanding.all_go_steps else None


COMMAND = "Commanding Several Drones"
METRICS = (
    Metric(
        name="drones_found", title="Found the target", unit="count", level="episode", better="more",
        definition="number of drones with a declaration that qualifies",
        paper=COMMAND, of=_outcome_count("found"),
    ),
    Metric(
        name="drones_beside", title="Declared at a look-alike", unit="count", level="episode", better="less",
        definition="number of drones without a declaration that qualifies, but with a declaration within the radius of"
        " a look-alike's centre",
        paper=COMMAND, of=_outcome_count("look-alike"),
    ),
    Metric(
        name="drones_elsewhere", title="Declared elsewhere", unit="count", level="episode", better="less",
        definition="number of drones with declarations of which none qualifies and none is within the radius of a"
        " look-alike's centre",
        paper=COMMAND, of=_outcome_count("elsewhere"),
    ),
    Metric(
        name="drones_silent", title="Never declared", unit="count", level="episode", better=None,
        definition="number of drones that never declared within the cap",
        paper=COMMAND, of=_outcome_count("never declared"),
    ),
    Metric(
        name="identical_share", title="Coordinate copying", unit="ratio", level="episode", better="less",
        definition="of the steps in which every drone got a go: share in which all points are equal",
        paper=COMMAND, of=verdict_value("commanding", "identical_share"),
    ),
    Metric(
        name="one_candidate_share", title="All at one candidate", unit="ratio", level="episode", better="less",
        definition="of the steps in which every drone got a go: share in which all gos lead towards the same candidate",
        paper=COMMAND, of=one_candidate_share,
    ),
    Metric(
        name="candidates_neared", title="Candidates neared", unit="count", level="episode", better="more",
        definition="number of candidates (the target and its look-alikes) that at least one drone approached",
        paper=COMMAND, of=verdict_value("commanding", "candidates_neared"),
    ),
    Metric(
        name="spread_m", title="Spread", unit="m", level="episode", better=None,
        definition="per step, the mean distance over all pairs of places to which drones are sent; median over the"
        " steps",
        paper=COMMAND, of=verdict_value("commanding", "spread_m"),
    ),
)  # fmt: skip
