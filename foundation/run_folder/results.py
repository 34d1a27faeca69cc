"""Contents of verdict.json, bench.json and study.json, and the result of a flight as the commands print it.

Units and frames are as in `rows.py`. docs/run-folder.md explains the numbers of a verdict.
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
SCORED = ("success", "failure")  # a flight with another outcome has no score


Flag = Annotated[bool | None, doc("null: not known")]
Count = Annotated[int | None, doc("null: not known")]
Share = Annotated[float | None, doc("0 … 1; null: not known")]


@dataclass(frozen=True, slots=True, kw_only=True)
class Deciding:
    """The first declaration that is known to succeed."""

    step: Whole
    drone: DroneNumber
    t: Annotated[Seconds, doc("s, time of the decision")]
    distance_m: Annotated[Distance | None, doc("m, from the body to the target's centre, at its frame")]


@dataclass(frozen=True, slots=True, kw_only=True)
class Diagnostics:
    """Values of one drone, or the best values of a fleet. None: not measured."""

    min_distance_m: Annotated[float | None, doc("m, smallest distance to the target's centre")]
    start_distance_m: Annotated[float | None, doc("m, distance at the first sample")]
    approach_ratio: Annotated[float | None, doc("1 − smallest distance / start distance")]
    oracle_success: Annotated[bool | None, doc("within delta at some sample, in view or not")]
    first_seen_s: Annotated[
        float | None, doc("s, first sample with the target in view; null: not known, or never in view")
    ]
    dwell_s: Annotated[float | None, doc("s, time within delta with the target in view")]
    longest_loss_s: Annotated[float | None, doc("s, longest time without the target in view")]
    path_m: Annotated[float, doc("m, length of the path along the poses, without gaps")]
    flown_s: Annotated[float, doc("s, time of the last sample")]
    untraced_s: Annotated[float, doc("s, total of the gaps longer than 0.75 s")]


@dataclass(frozen=True, slots=True, kw_only=True)
class DroneDiagnostics(Diagnostics):
    """Diagnostics of one drone."""

    drone: DroneNumber
    declarations: Annotated[int, doc("within the cap")]
    qualifying: Annotated[int, doc("number of declarations that are known to qualify")]


@dataclass(frozen=True, slots=True, kw_only=True)
class Nearness:
    """Distance to a surveyed target, with its uncertainty. None: not known."""

    t: Annotated[float | None, doc("s")]
    distance_m: Annotated[Distance | None, doc("m; horizontal if the target has no altitude")]
    std_m: Annotated[Deviation | None, doc("m, standard deviation of the distance")]
    within: Annotated[bool | None, doc("within delta, by two standard deviations; null: undecided")]


@dataclass(frozen=True, slots=True, kw_only=True)
class DecidedNear(Nearness):
    """The distance at the frame of a decision; `t` is the time of the decision."""

    step: Whole
    drone: DroneNumber


@dataclass(frozen=True, slots=True, kw_only=True)
class Distances:
    """Distances of a flight without truth, by the autopilot's estimate."""

    source: Annotated[str | None, doc("name of the log that contains the positions")]
    target: Annotated[Surveyed, doc("surveyed latitude_deg, longitude_deg, altitude_m, std_m")]
    visible: None = None  # not measured
    closest: Nearness | None
    last_action: DecidedNear | None
    declarations: tuple[DecidedNear, ...]
    dwell_s: Annotated[float, doc("s, time within delta, in view or not")]


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandedStep:
    """The commands that follow from one question; all tuples are in the order of `drones`."""

    step: Whole
    drones: Annotated[tuple[DroneNumber, ...], doc("drones of this question")]
    identical_point: Annotated[bool | None, doc("all have the same point; null: only one drone, or not all got a go")]
    spread_m: Annotated[float | None, doc("m, mean distance between any two of the places; null: fewer than two")]
    places_ned: Annotated[tuple[Place | None, ...], doc("m, NED, commanded place; null: no go, or no true pose")]
    nears: Annotated[
        tuple[Whole | None, ...],
        doc("candidate that the drone approaches most: 0 is the target, k the k-th look-alike of the record"),
    ]


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandingDiagnostics:
    """Measures of the commands in a commanding episode."""

    all_go_steps: Annotated[int, doc("steps with a question about several drones, all of which got a go")]
    identical_points: Annotated[int, doc("number of all_go_steps with one point for all drones")]
    identical_share: Annotated[float | None, doc("0 … 1; null: no such step")]
    one_candidate: Annotated[int, doc("number of these on which all drones approach the same candidate")]
    candidates_neared: Annotated[int, doc("number of candidates, with the target, that any drone approached")]
    spread_m: Annotated[float | None, doc("m, median over the steps that have a value")]
    steps: tuple[CommandedStep, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Contacts:
    """Contacts of all drones of an episode with obstacles, within the cap."""

    hits: Annotated[Whole, doc("number of hits; each thing counts once per contact")]
    crashes: Annotated[Whole, doc("number of drones that hit something hard enough to break")]
    hardest_hit_mps: Annotated[float | None, doc("m/s, highest closing speed; null: no hit has one")]
    contact_s: Annotated[float, doc("s, time in contact with anything")]


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """The verdict that follows from the logs of an episode: verdict.json."""

    outcome: Outcome
    success: Annotated[
        bool | None, doc("null: no truth was measured, or only a flight with --full can show the outcome")
    ]
    ne_m: Annotated[float | None, doc("m, navigation error: the distance at the decisive measurement")]
    delta_m: Annotated[float, doc("m, success radius to the target's centre")]
    censored: Annotated[bool, doc("the log ends before the cap; the outcome is final, or unknown for this reason")]
    steps: Whole
    declarations: Annotated[Whole, doc("within the cap")]
    declarations_after_cap: Whole
    success_at_first: Annotated[Flag, doc("SR₁: the first declaration qualifies; null: not known")]
    success_within_three: Annotated[Flag, doc("SR₃: one of the first three qualifies; null: not known")]
    declaration_precision: Annotated[
        Share, doc("share that qualifies; null: no declaration, or one that was not measured")
    ]
    false_declarations: Annotated[Count, doc("number that does not qualify; null: one was not measured")]
    deciding: Deciding | None
    error: Annotated[str | None, doc("why the flight is not scored")]
    note: Annotated[str | None, doc("what remains uncertain in the verdict")]
    diagnostics: Annotated[Diagnostics | None, doc("{}: nothing was measured")]
    drones: tuple[DroneDiagnostics, ...]
    distances: Annotated[Distances | UnsetType | None, doc("only if no truth was measured")] = UNSET
    wide_rotations: Annotated[Whole, doc("turns of more than 90°, within the cap; only if any")] | UnsetType = UNSET
    commanding: Annotated[CommandingDiagnostics | UnsetType, doc("only for a commanding episode")] = UNSET
    cap_s: Annotated[float | UnsetType, doc("s, later declarations do not count; missing: 300")] = UNSET
    host_stalls: Annotated[Whole, doc("steps that the host delayed; only if any")] | UnsetType = UNSET
    contacts: Annotated[Contacts | UnsetType, doc("only if the log has hits; never part of the outcome")] = UNSET
    estimator_resets: Annotated[
        Whole | UnsetType, doc("of all drones; only if the autopilot reports them; never part of the outcome")
    ] = UNSET

    def as_json(self) -> dict[str, Any]:
        """Return the object in verdict.json."""
        return {**as_json(self), "diagnostics": as_json(self.diagnostics) or {}}


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """The result of a flight. `fly --json` prints it; campaigns and audits count it. None: not known."""

    episode: Annotated[str, doc("id of its record")]
    pilot: Annotated[str | None, doc("as on the command line, or the model's name")] = None
    outcome: Outcome
    success: bool | None = None
    ne_m: Annotated[float | None, doc("m, navigation error")] = None
    steps: Whole = 0
    declarations: Annotated[Count, doc("within the cap")] = None
    success_at_first: Annotated[Flag, doc("SR₁")] = None
    success_within_three: Annotated[Flag, doc("SR₃")] = None
    declaration_precision: Annotated[Share, doc("share of the declarations that qualify")] = None
    false_declarations: Annotated[Count, doc("number that does not qualify")] = None
    censored: bool | None = None
    sim_seconds: Annotated[float | None, doc("s of vehicle time, from the start of the episode to its last step")] = (
        None
    )
    wall_seconds: Annotated[float | None, doc("s of wall time, for the same")] = None
    real_time_factor: Annotated[float | None, doc("sim_seconds / wall_seconds; 0: no time has passed")] = None
    run_dir: Annotated[str | None, doc("the episode's folder")] = None
    error: Annotated[str | None, doc("why the flight is not scored, or what else went wrong")] = None
    distances: Annotated[Distances | UnsetType | None, doc("only if no truth was measured")] = UNSET
    reason: Annotated[str | UnsetType, doc("cap, decided, budget, rejected, interrupted, takeover or error")] = UNSET
    status: Annotated[int | UnsetType, doc("exit status of the command")] = UNSET
    host_stalls: Annotated[Whole, doc("steps that the host delayed; only if any")] | UnsetType = UNSET

    def as_json(self) -> dict[str, Any]:
        """Return the object that the commands print."""
        value: dict[str, Any] = as_json(self)
        return value


@dataclass(frozen=True, slots=True, kw_only=True)
class FlownSuite:
    """The suite of a run's episodes."""

    name: Annotated[str | None, doc("null: the episodes were named one by one")]
    version: Annotated[Whole, doc("version of the benchmark: its images and episodes")]
    sha256: Annotated[str, doc("digest over the ids and digests of its records")]


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchmarkRun:
    """One run of a benchmark: a folder of this name beside bench.json."""

    name: Annotated[str, doc("folder: pilot, agent unless paper, command, latency, number of the flight")]
    flight: Annotated[dict[str, Any], doc("settings of its flights without the episode, as in run.json")]
    episodes: Annotated[tuple[str, ...], doc("ids of all its episodes, flown or not")]


@dataclass(frozen=True, slots=True, kw_only=True)
class Benchmark:
    """bench.json: all runs of the benchmark, resolved. The file does not say which machine flies which run."""

    schema: Literal[1] = 1
    suite: FlownSuite
    retry: Annotated[bool, doc("whether flights that did not move are retried once")]
    runs: tuple[BenchmarkRun, ...]


Level = int | float | str  # level of a factor: a number in its unit, or a word


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyFactor:
    """A factor of a study: a setting that the study varies."""

    name: Annotated[str, doc("name of a factor in docs/studies.md")]
    unit: Annotated[str, doc("unit of its levels; empty for shares, multipliers and words")]
    levels: Annotated[tuple[Level, ...], doc("the flown levels; in rising order if they are numbers of a range")]


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyRun:
    """One run of a study: a folder of this name beside study.json."""

    name: Annotated[str, doc("folder: pilot, levels, number of the flight")]
    levels: Annotated[dict[str, Level], doc("level of every factor")]
    flight_number: Annotated[Whole, doc("from 1; the same number has the same seed at all levels")]


@dataclass(frozen=True, slots=True, kw_only=True)
class Study:
    """study.json: all runs of the design, resolved. The file does not say which machine flies which run."""

    schema: Literal[1] = 1
    name: str
    design: Annotated[str, doc("the design in words, with its generators and resolution, or its points and seed")]
    factors: tuple[StudyFactor, ...]
    held: Annotated[dict[str, Level], doc("factors with one level in every run, and that level")]
    cells: Annotated[tuple[str, ...], doc("cells of the episodes, in the paper's order")]
    episodes: Annotated[tuple[str, ...], doc("ids of the episodes of each run")]
    flights: Annotated[Whole, doc("flights of each episode by each pilot at each point of the design")]
    seeds: Annotated[
        Literal["paired"], doc("flights with the same episode, number and pilot have the same seed at every level")
    ] = "paired"
    runs: tuple[StudyRun, ...]
