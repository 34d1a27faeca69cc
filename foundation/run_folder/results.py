"""Contents of verdict.json, bench.json and study.json, and the result of a flight as the commands print it.

Units and frames as in `rows.py`. docs/run-folder.md explains the numbers of a verdict.
"""

from dataclasses import dataclass
from typing import Annotated, Any, Literal

from msgspec import UNSET, Meta, UnsetType

from foundation.measurement import Distance, Place, doc
from foundation.run_folder.rows import Deviation, DroneNumber, Seconds, Surveyed, Whole
from foundation.run_folder.writing import as_json

Outcome = Annotated[
    Literal["success", "failure", "error", "censored", "unknown", "distance only"],
    Meta(extra={"wrong": "is not an outcome"}),
]
SCORED = ("success", "failure")  # the others are nobody's score


Flag = Annotated[bool | None, doc("null: not known")]
Count = Annotated[int | None, doc("null: not known")]
Share = Annotated[float | None, doc("0 … 1; null: not known")]


@dataclass(frozen=True, slots=True, kw_only=True)
class Deciding:
    """The first declaration that is known to qualify."""

    step: Whole
    drone: DroneNumber
    t: Annotated[Seconds, doc("s, when it was decided")]
    distance_m: Annotated[Distance | None, doc("m, body to the target's centre, at its frame")]


@dataclass(frozen=True, slots=True, kw_only=True)
class Diagnostics:
    """Of one drone, or the best of a fleet's. None: nothing that it could be told from was measured."""

    min_distance_m: Annotated[float | None, doc("m, least, to the target's centre")]
    start_distance_m: Annotated[float | None, doc("m, at the first sample")]
    approach_ratio: Annotated[float | None, doc("share of the start distance that was closed, at most 1")]
    oracle_success: Annotated[bool | None, doc("it was within delta at some sample, in view or not")]
    first_seen_s: Annotated[float | None, doc("s, first sample with the target in view; null also where there is none")]
    dwell_s: Annotated[float | None, doc("s within delta with the target in view")]
    longest_loss_s: Annotated[float | None, doc("s, longest without the target in view, from the beginning to the end")]
    path_m: Annotated[float, doc("m, along the poses, gaps left out")]
    flown_s: Annotated[float, doc("s, last sample")]
    untraced_s: Annotated[float, doc("s in gaps of more than 0.75 s")]


@dataclass(frozen=True, slots=True, kw_only=True)
class DroneDiagnostics(Diagnostics):
    """One drone's part in the episode."""

    drone: DroneNumber
    declarations: Annotated[int, doc("within the cap")]
    qualifying: Annotated[int, doc("of these, known to qualify")]


@dataclass(frozen=True, slots=True, kw_only=True)
class Nearness:
    """How far from a surveyed target, give or take. None: not known."""

    t: Annotated[float | None, doc("s")]
    distance_m: Annotated[Distance | None, doc("m, horizontally where the target has no altitude")]
    std_m: Annotated[Deviation | None, doc("m, standard deviation of that")]
    within: Annotated[bool | None, doc("of delta, by two standard deviations; null: open")]


@dataclass(frozen=True, slots=True, kw_only=True)
class DecidedNear(Nearness):
    """The same of a decision, at its own frame; `t` is when it was decided."""

    step: Whole
    drone: DroneNumber


@dataclass(frozen=True, slots=True, kw_only=True)
class Distances:
    """What can be said of a flight whose truth nobody measured."""

    source: Annotated[str | None, doc("name of the log that the positions are of")]
    target: Annotated[Surveyed, doc("latitude_deg, longitude_deg, altitude_m, std_m, as surveyed")]
    visible: None = None  # nobody measured it
    closest: Nearness | None
    last_action: DecidedNear | None
    declarations: tuple[DecidedNear, ...]
    dwell_s: Annotated[float, doc("s within delta, in view or not")]


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandedStep:
    """What one question had its drones do; all tuples are in the order of `drones`."""

    step: Whole
    drones: Annotated[tuple[DroneNumber, ...], doc("those that were asked for together")]
    identical_point: Annotated[bool | None, doc("all have one point; null: one alone, or not all were told to go")]
    spread_m: Annotated[float | None, doc("m, mean distance between each two of the places; null: fewer than two")]
    places_ned: Annotated[tuple[Place | None, ...], doc("m, NED, where it was sent; null: no go, or no true pose")]
    nears: Annotated[
        tuple[Whole | None, ...],
        doc("candidate that its stride comes nearer to than to others: 0 the target, k the record's k-th look-alike"),
    ]


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandingDiagnostics:
    """How the drones of a commanding episode were told to fly."""

    all_go_steps: Annotated[int, doc("steps on which several drones were asked for and every one was told to go")]
    identical_points: Annotated[int, doc("of these, with one point for all")]
    identical_share: Annotated[float | None, doc("0 … 1; null: there was no such step")]
    one_candidate: Annotated[int, doc("of the same steps, those on which all drones near one candidate")]
    candidates_neared: Annotated[int, doc("how many were neared by any drone, the target among them")]
    spread_m: Annotated[float | None, doc("m, median over the steps that have one")]
    steps: tuple[CommandedStep, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Contacts:
    """What the drones of an episode flew into, all together, within the cap."""

    hits: Annotated[Whole, doc("times a drone flew into something; of one contact each thing counts once")]
    crashes: Annotated[Whole, doc("drones that hit something hard enough to break")]
    hardest_hit_mps: Annotated[float | None, doc("m/s, fastest closing speed; null: of none")]
    contact_s: Annotated[float, doc("s in contact with anything")]


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """What the logs of an episode come to: verdict.json."""

    outcome: Outcome
    success: Annotated[bool | None, doc("null: nobody measured the truth, or only --full would tell")]
    ne_m: Annotated[float | None, doc("m, navigation error: the distance at the decisive measurement")]
    delta_m: Annotated[float, doc("m, success radius to the target's centre")]
    censored: Annotated[bool, doc("the flight was not seen to its cap though its outcome stands, or is open for that")]
    steps: Whole
    declarations: Annotated[Whole, doc("within the cap")]
    declarations_after_cap: Whole
    success_at_first: Annotated[Flag, doc("SR₁: the first declaration qualifies; null: not known")]
    success_within_three: Annotated[Flag, doc("SR₃: one of the first three does; null: not known")]
    declaration_precision: Annotated[Share, doc("share that qualifies; null: none was made, or one not measured")]
    false_declarations: Annotated[Count, doc("how many do not qualify; null: one was not measured")]
    deciding: Deciding | None
    error: Annotated[str | None, doc("what keeps the flight from being scored")]
    note: Annotated[str | None, doc("what the verdict leaves open though it stands")]
    diagnostics: Annotated[Diagnostics | None, doc("{}: nothing was measured")]
    drones: tuple[DroneDiagnostics, ...]
    distances: Annotated[Distances | UnsetType | None, doc("only where nobody measured the truth")] = UNSET
    wide_rotations: Annotated[Whole, doc("turns of more than 90°, within the cap; only if any")] | UnsetType = UNSET
    commanding: Annotated[CommandingDiagnostics | UnsetType, doc("only of a commanding episode")] = UNSET
    cap_s: Annotated[float | UnsetType, doc("s, what is declared later does not count; only where not 300")] = UNSET
    host_stalls: Annotated[Whole, doc("steps that the host delayed; only if any")] | UnsetType = UNSET
    contacts: Annotated[Contacts | UnsetType, doc("only where hits are written; never part of the outcome")] = UNSET
    estimator_resets: (
        Annotated[Whole, doc("of all drones; only where the autopilot tells them; never part of the outcome")]
        | UnsetType
    ) = UNSET

    def as_json(self) -> dict[str, Any]:
        """Return it as verdict.json holds it."""
        return {**as_json(self), "diagnostics": as_json(self.diagnostics) or {}}


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """What `fly --json` prints, a campaign's worker answers and an audit counts. None: not known to whoever made it."""

    episode: Annotated[str, doc("id of its record")]
    pilot: Annotated[str | None, doc("as the command line has it, or the model's name")] = None
    outcome: Outcome
    success: bool | None = None
    ne_m: Annotated[float | None, doc("m, navigation error")] = None
    steps: Whole = 0
    declarations: Annotated[Count, doc("within the cap")] = None
    success_at_first: Annotated[Flag, doc("SR₁")] = None
    success_within_three: Annotated[Flag, doc("SR₃")] = None
    declaration_precision: Annotated[Share, doc("share of the declarations that qualifies")] = None
    false_declarations: Annotated[Count, doc("how many do not qualify")] = None
    censored: bool | None = None
    sim_seconds: Annotated[float | None, doc("s of vehicle time, from the episode's beginning to its last step")] = None
    wall_seconds: Annotated[float | None, doc("s of wall time, likewise")] = None
    real_time_factor: Annotated[float | None, doc("the first over the second; 0: no time has passed")] = None
    run_dir: Annotated[str | None, doc("the episode's folder")] = None
    error: Annotated[str | None, doc("why it is nobody's score, or what went wrong beside it")] = None
    distances: Annotated[Distances | UnsetType | None, doc("of a flight whose truth nobody measured")] = UNSET
    reason: Annotated[str | UnsetType, doc("cap, decided, budget, rejected, interrupted, takeover or error")] = UNSET
    status: Annotated[int | UnsetType, doc("exit status of the command")] = UNSET
    host_stalls: Annotated[Whole, doc("steps that the host delayed; only if any")] | UnsetType = UNSET

    def as_json(self) -> dict[str, Any]:
        """Return it as the commands print it."""
        value: dict[str, Any] = as_json(self)
        return value


@dataclass(frozen=True, slots=True, kw_only=True)
class FlownSuite:
    """The episodes that a run is of."""

    name: Annotated[str | None, doc("null: episodes by name")]
    version: Annotated[Whole, doc("of the records")]
    sha256: Annotated[str, doc("over the ids and digests of its records")]


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchmarkRun:
    """One run of a benchmark: a folder of this name beside bench.json."""

    name: Annotated[str, doc("of its folder: who, agent unless the paper's, command, latency, number of the flight")]
    flight: Annotated[dict[str, Any], doc("each of its flights but for the episode, as in run.json")]
    episodes: Annotated[tuple[str, ...], doc("ids, all that belong to it, whichever of them have been flown")]


@dataclass(frozen=True, slots=True, kw_only=True)
class Benchmark:
    """bench.json: the whole matrix as it was resolved. How much of it one sitting or one machine flies is not in it."""

    schema: Literal[1] = 1
    suite: FlownSuite
    retry: Annotated[bool, doc("whether a flight that did not move is flown once more")]
    runs: tuple[BenchmarkRun, ...]


Level = int | float | str  # of a factor, in its unit; a word of one that has none


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyFactor:
    """What is varied on purpose."""

    name: Annotated[str, doc("of the registry: docs/studies.md")]
    unit: Annotated[str, doc("of its levels; empty: shares, factors and words")]
    levels: Annotated[tuple[Level, ...], doc("that are flown; rising where they are numbers of a range")]


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyRun:
    """One run of a study: a folder of this name beside study.json."""

    name: Annotated[str, doc("of its folder: who, the levels, number of the flight")]
    levels: Annotated[dict[str, Level], doc("by factor, all of them")]
    flight_number: Annotated[Whole, doc("1 is the first; the same number has the same seed at all levels")]


@dataclass(frozen=True, slots=True, kw_only=True)
class Study:
    """study.json: the whole design as it was resolved. How much of it one sitting or one machine flies is not in it."""

    schema: Literal[1] = 1
    name: str
    design: Annotated[str, doc("in words, with what makes it again: generators and resolution, or points and seed")]
    factors: tuple[StudyFactor, ...]
    held: Annotated[dict[str, Level], doc("what is set to one level in every run, by factor")]
    cells: Annotated[tuple[str, ...], doc("of the episodes, in the paper's order")]
    episodes: Annotated[tuple[str, ...], doc("ids, of each run")]
    flights: Annotated[Whole, doc("of each episode by each pilot at each point of the design")]
    seeds: Annotated[
        Literal["paired"], doc("the same episode, flight number and pilot have the same seed at every level")
    ] = "paired"
    runs: tuple[StudyRun, ...]
