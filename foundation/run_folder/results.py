"""What came of a flight: the verdict, as it stands in verdict.json, and the result that the commands hand on.

Units and frames as in `rows.py`. A verdict's numbers are explained in docs/run-folder.md.
"""

from dataclasses import dataclass
from typing import Annotated, Any, Literal

from msgspec import UNSET, Meta, UnsetType

from foundation.measurement import Distance, Place
from foundation.run_folder.rows import Deviation, DroneNumber, Seconds, Surveyed, Whole
from foundation.run_folder.writing import as_json

Outcome = Annotated[
    Literal["success", "failure", "error", "censored", "unknown", "distance only"],
    Meta(extra={"wrong": "is not an outcome"}),
]
SCORED = ("success", "failure")  # the others are nobody's score


def _of(description: str) -> Meta:
    return Meta(description=description)


Known = Annotated[bool | None, _of("null: not known")]
Count = Annotated[int | None, _of("null: not known")]
Share = Annotated[float | None, _of("0 … 1; null: not known")]


@dataclass(frozen=True, slots=True, kw_only=True)
class Deciding:
    """The first declaration that is known to qualify."""

    step: Whole
    drone: DroneNumber
    t: Annotated[Seconds, _of("s, when it was decided")]
    distance_m: Annotated[Distance | None, _of("m, body to the target's centre, at its frame")]


@dataclass(frozen=True, slots=True, kw_only=True)
class Diagnostics:
    """Of one drone, or the best of a fleet's. None: nothing that it could be told from was measured."""

    min_distance_m: Annotated[float | None, _of("m, least, to the target's centre")]
    start_distance_m: Annotated[float | None, _of("m, at the first sample")]
    approach_ratio: Annotated[float | None, _of("share of the start distance that was closed, at most 1")]
    oracle_success: Annotated[bool | None, _of("it was within delta at some sample, in view or not")]
    first_seen_s: Annotated[float | None, _of("s, first sample with the target in view; null also where there is none")]
    dwell_s: Annotated[float | None, _of("s within delta with the target in view")]
    longest_loss_s: Annotated[float | None, _of("s, longest without the target in view, from the beginning to the end")]
    path_m: Annotated[float, _of("m, along the poses, gaps left out")]
    flown_s: Annotated[float, _of("s, last sample")]
    untraced_s: Annotated[float, _of("s in gaps of more than 0.75 s")]


@dataclass(frozen=True, slots=True, kw_only=True)
class DroneDiagnostics(Diagnostics):
    """One drone's part in the episode."""

    drone: DroneNumber
    declarations: Annotated[int, _of("within the cap")]
    qualifying: Annotated[int, _of("of these, known to qualify")]


@dataclass(frozen=True, slots=True, kw_only=True)
class Nearness:
    """How far from a surveyed target, give or take. None: not known."""

    t: Annotated[float | None, _of("s")]
    distance_m: Annotated[Distance | None, _of("m, horizontally where the target has no altitude")]
    std_m: Annotated[Deviation | None, _of("m, standard deviation of that")]
    within: Annotated[bool | None, _of("of delta, by two standard deviations; null: open")]


@dataclass(frozen=True, slots=True, kw_only=True)
class DecidedNear(Nearness):
    """The same of a decision, at its own frame; `t` is when it was decided."""

    step: Whole
    drone: DroneNumber


@dataclass(frozen=True, slots=True, kw_only=True)
class Distances:
    """What can be said of a flight whose truth nobody measured."""

    source: Annotated[str | None, _of("name of the log that the positions are of")]
    target: Annotated[Surveyed, _of("latitude_deg, longitude_deg, altitude_m, std_m, as surveyed")]
    visible: None = None  # nobody measured it
    closest: Nearness | None
    last_action: DecidedNear | None
    declarations: tuple[DecidedNear, ...]
    dwell_s: Annotated[float, _of("s within delta, in view or not")]


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandedStep:
    """What one question had its drones do; all tuples are in the order of `drones`."""

    step: Whole
    drones: Annotated[tuple[DroneNumber, ...], _of("those that were asked for together")]
    identical_point: Annotated[bool | None, _of("all have one point; null: one alone, or not all were told to go")]
    spread_m: Annotated[float | None, _of("m, mean distance between each two of the places; null: fewer than two")]
    places_ned: Annotated[tuple[Place | None, ...], _of("m, NED, where it was sent; null: no go, or no true pose")]
    nears: Annotated[
        tuple[Whole | None, ...],
        _of("candidate that its stride comes nearer to than to others: 0 the target, k the record's k-th look-alike"),
    ]


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandingDiagnostics:
    """How the drones of a commanding episode were told to fly."""

    all_go_steps: Annotated[int, _of("steps on which several drones were asked for and every one was told to go")]
    identical_points: Annotated[int, _of("of these, with one point for all")]
    identical_share: Annotated[float | None, _of("0 … 1; null: there was no such step")]
    one_candidate: Annotated[int, _of("of the same steps, those on which all drones near one candidate")]
    candidates_neared: Annotated[int, _of("how many were neared by any drone, the target among them")]
    spread_m: Annotated[float | None, _of("m, median over the steps that have one")]
    steps: tuple[CommandedStep, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Contacts:
    """What the drones of an episode flew into, all together, within the cap."""

    hits: Annotated[Whole, _of("times a drone flew into something; of one contact each thing counts once")]
    crashes: Annotated[Whole, _of("drones that hit something hard enough to break")]
    hardest_hit_mps: Annotated[float | None, _of("m/s, fastest closing speed; null: of none")]
    contact_s: Annotated[float, _of("s in contact with anything")]


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """What the logs of an episode come to: verdict.json."""

    outcome: Outcome
    success: Annotated[bool | None, _of("null: nobody measured the truth, or only --full would tell")]
    ne_m: Annotated[float | None, _of("m, navigation error: the distance at the decisive measurement")]
    delta_m: Annotated[float, _of("m, success radius to the target's centre")]
    censored: Annotated[bool, _of("the flight was not seen to its cap though its outcome stands, or is open for that")]
    steps: Whole
    declarations: Annotated[Whole, _of("within the cap")]
    declarations_after_cap: Whole
    success_at_first: Annotated[Known, _of("SR₁: the first declaration qualifies; null: not known")]
    success_within_three: Annotated[Known, _of("SR₃: one of the first three does; null: not known")]
    declaration_precision: Annotated[Share, _of("share that qualifies; null: none was made, or one not measured")]
    false_declarations: Annotated[Count, _of("how many do not qualify; null: one was not measured")]
    deciding: Deciding | None
    error: Annotated[str | None, _of("what keeps the flight from being scored")]
    note: Annotated[str | None, _of("what the verdict leaves open though it stands")]
    diagnostics: Annotated[Diagnostics | None, _of("{}: nothing was measured")]
    drones: tuple[DroneDiagnostics, ...]
    distances: Annotated[Distances | UnsetType | None, _of("only where nobody measured the truth")] = UNSET
    wide_rotations: Annotated[Whole, _of("turns of more than 90°, within the cap; only if any")] | UnsetType = UNSET
    commanding: Annotated[CommandingDiagnostics | UnsetType, _of("only of a commanding episode")] = UNSET
    cap_s: Annotated[float | UnsetType, _of("s, what is declared later does not count; only where not 300")] = UNSET
    host_stalls: Annotated[Whole, _of("steps that the host delayed; only if any")] | UnsetType = UNSET
    contacts: Annotated[Contacts | UnsetType, _of("only where hits are written; never part of the outcome")] = UNSET
    estimator_resets: (
        Annotated[Whole, _of("of all drones; only where the autopilot tells them; never part of the outcome")]
        | UnsetType
    ) = UNSET

    def as_json(self) -> dict[str, Any]:
        """Return it as verdict.json holds it."""
        return {**as_json(self), "diagnostics": as_json(self.diagnostics) or {}}


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """What `fly --json` prints, a campaign's worker answers and an audit counts. None: not known to whoever made it."""

    episode: Annotated[str, _of("id of its record")]
    pilot: Annotated[str | None, _of("as the command line has it, or the model's name")] = None
    outcome: Outcome
    success: bool | None = None
    ne_m: Annotated[float | None, _of("m, navigation error")] = None
    steps: Whole = 0
    declarations: Annotated[Count, _of("within the cap")] = None
    success_at_first: Annotated[Known, _of("SR₁")] = None
    success_within_three: Annotated[Known, _of("SR₃")] = None
    declaration_precision: Annotated[Share, _of("share of the declarations that qualifies")] = None
    false_declarations: Annotated[Count, _of("how many do not qualify")] = None
    censored: bool | None = None
    sim_seconds: Annotated[float | None, _of("s of vehicle time, from the episode's beginning to its last step")] = None
    wall_seconds: Annotated[float | None, _of("s of wall time, likewise")] = None
    real_time_factor: Annotated[float | None, _of("the first over the second; 0: no time has passed")] = None
    run_dir: Annotated[str | None, _of("the episode's folder")] = None
    error: Annotated[str | None, _of("why it is nobody's score, or what went wrong beside it")] = None
    distances: Annotated[Distances | UnsetType | None, _of("of a flight whose truth nobody measured")] = UNSET
    reason: Annotated[str | UnsetType, _of("cap, decided, budget, rejected, interrupted, takeover or error")] = UNSET
    status: Annotated[int | UnsetType, _of("exit status of the command")] = UNSET
    host_stalls: Annotated[Whole, _of("steps that the host delayed; only if any")] | UnsetType = UNSET

    def as_json(self) -> dict[str, Any]:
        """Return it as the commands print it."""
        told: dict[str, Any] = as_json(self)
        return told
