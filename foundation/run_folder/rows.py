"""The rows of the logs, one dataclass each, with the names, units and frames of all fields.

Times are vehicle seconds since the episode began, places metres in the map's NED frame, unless a field says otherwise.
A field with a default may be missing in a line of an older version: None, or UNSET where null has another meaning.
Fields may be added but not renamed, and a reader ignores unknown ones.

mypy, the strict reader (`reading.py`) and the published schemas (`schemas/`) all use the annotations.
"""

from dataclasses import dataclass
from typing import Annotated, Any, Literal

from msgspec import UNSET, Meta, UnsetType

from foundation.measurement import LARGE, Distance, Number, Place, TargetMeasurement, Visible, doc
from foundation.protocol import FINISHED, GO

DRONES = 255  # number of MAVLink system ids

# `wrong`: the reader's message about any other value
Whole = Annotated[int, Meta(ge=0, lt=int(LARGE), extra={"wrong": "is not a whole number"})]
DroneNumber = Annotated[int, Meta(ge=0, lt=DRONES, description="0 is the first",
                                  extra={"wrong": f"is not a whole number below {DRONES}"})]  # fmt: skip
Seconds = Annotated[float, Meta(gt=-LARGE, lt=LARGE, description="s of vehicle time since the episode began")]
Deviation = Annotated[float, Meta(ge=0.0, lt=LARGE, extra={"wrong": "is not a standard deviation"})]
ActionObject = Annotated[
    dict[str, Any],
    Meta(
        extra={"wrong": "is not an action"},
        extra_json_schema={"properties": {"action": {"type": "string"}}, "required": ["action"]},
    ),
]
Cap = Annotated[float, Meta(gt=0.0, lt=LARGE, extra={"wrong": "is not a time"})]
TraceSource = Annotated[Literal["estimate"], Meta(extra={"wrong": "is not known"})]
ResetQuantity = Literal["yaw", "position", "velocity", "height"]
Surveyed = Annotated[dict[str, Number | None], Meta(extra={"wrong": "is not a surveyed place"})]


def drone_label(drone: int) -> str:
    """Return the name of a drone for people, counted from 1; files and columns count from 0."""
    return f"drone {drone + 1}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """The common part of every run.json; the rest is the run's configuration."""

    schema: Annotated[int, Meta(ge=1, description="version of the folder's files; none before there were any",
                                extra={"wrong": "is not a version"})] | UnsetType = UNSET  # fmt: skip
    versions: Annotated[dict[str, str], doc("of dronecats, Python and the packages that matter to a number")]


@dataclass(frozen=True, slots=True, kw_only=True)
class EpisodeIdentity:
    """identity.json: what was really flown. Episodes that differ in it are not pooled."""

    code_sha256: Annotated[str, doc("of the sources that decide what is flown and how it is judged")]
    record_sha256: Annotated[str | None, doc("of the bytes of episode.json; null: there is none")]
    frames: Annotated[Whole, doc("pictures that the pilot was shown")]
    frames_sha256: Annotated[str | None, doc("of their JPEG bytes in the order of their names; null: none was taken")]
    served: Annotated[
        tuple[str, ...],
        doc("models as the vendor's answers name them, and its version of each; empty: nothing but what was asked for"),
    ]
    pace: Annotated[dict[str, float], doc("how well a real-time flight held it")] | UnsetType = UNSET


@dataclass(frozen=True, slots=True)
class PointedGo:
    """The point and the depth of a `go`."""

    x: float  # 0 … 1000, left to right
    y: float  # 0 … 1000, top to bottom
    depth_m: float  # m along the optical axis


@dataclass(frozen=True, slots=True, kw_only=True)
class Decision:
    """What the pilot decided, on which frame, when: a line of decisions.jsonl, by the agent."""

    step: Whole
    drone: DroneNumber
    frame_id: Whole
    t_frame: Annotated[Seconds, doc("s, when the picture was taken")]
    t_decided: Annotated[Seconds, doc("s, when the reply was there")]
    reply: Annotated[str, doc("as received")] | UnsetType = UNSET
    action: Annotated[ActionObject | None, doc("parsed, point in [x, y]; null: the reply holds no valid action")]
    error: Annotated[str | None, doc("why there is no action")] = None
    mended: Annotated[tuple[str, ...], doc("what was mended in the reply, codes: docs/replies.md")] | UnsetType = UNSET
    latency_s: Annotated[Number | None, doc("s of vehicle time that the reply took")] = None
    tokens_in: int | None = None
    tokens_out: int | None = None
    thinking: Annotated[bool | None, doc("whether the model was let to reason at length")] = None
    rate_hz: Annotated[Number | None, doc("decisions per s of vehicle time since the last; null: the first")] = None
    finish: (
        Annotated[str, doc("why the reply ends: length, filtered, refusal, …; missing: it was done")] | UnsetType
    ) = UNSET
    report: Annotated[bool, doc("under a commander: arrival is reported to it here, and not declared")] | UnsetType = (
        UNSET
    )
    confirmed_by: (
        Annotated[Whole, doc("number of the commander's exchange that declares, on the frame that it saw")] | UnsetType
    ) = UNSET
    served: (
        Annotated[str, doc("what answered, in the vendor's words; missing: as before, at first the name asked for")]
        | UnsetType
    ) = UNSET
    tokens_cached: Annotated[Whole, doc("of tokens_in, had from before; missing: not told")] | UnsetType = UNSET
    tokens_reasoning: Annotated[Whole, doc("of tokens_out, reasoning; missing: not told")] | UnsetType = UNSET
    endpoint: (
        Annotated[str, doc("whom a router had answer, in its words, as OpenRouter's provider; missing: not told")]
        | UnsetType
    ) = UNSET
    host_lag_s: (
        Annotated[
            Number, doc("s of wall time × speed by which the vehicle's clock fell behind since the last decision")
        ]
        | UnsetType
    ) = UNSET  # in lockstep there is no such thing
    frame_wait_s: (
        Annotated[Number, doc("s of wall time × speed for which the picture was waited for, of a fleet for each")]
        | UnsetType
    ) = UNSET

    @property
    def kind(self) -> str | None:
        """The action's name, as in `foundation.protocol`; None where the reply holds none."""
        return None if self.action is None else str(self.action["action"])

    @property
    def declares(self) -> bool:
        """True when it declares arrival. A report to a commander is not a declaration."""
        return self.kind == FINISHED and self.report is not True

    @property
    def go(self) -> PointedGo | None:
        """The point and the depth of a go; None of any other action, and of a go without valid numbers."""
        if self.action is None or self.kind != GO:
            return None
        point, depth_m = self.action.get("point"), self.action.get("depth_m")
        numbers = [*point, depth_m] if isinstance(point, list) and len(point) == 2 else []
        valid = [float(n) for n in numbers if isinstance(n, int | float) and not isinstance(n, bool) and abs(n) < LARGE]
        return PointedGo(*valid) if len(valid) == 3 else None


@dataclass(frozen=True, slots=True, kw_only=True)
class Cause:
    """Why a commander was asked."""

    why: Annotated[Literal["start", "report", "stall", "time"], Meta(extra={"wrong": "is no cause"})]
    drone: Annotated[DroneNumber | None, doc("whose report or stall it is")] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Order:
    """What a commander has one drone do."""

    drone: DroneNumber
    goal: Annotated[str, doc("the instruction of the drone's own agent from its next question on")]


@dataclass(frozen=True, slots=True, kw_only=True)
class Exchange:
    """A question to the commander and what came of it: a line of commander.jsonl, by the agent."""

    number: Annotated[Whole, doc("0 is the first")]
    t_asked: Annotated[Seconds, doc("s, when it was asked: no earlier than its newest picture")]
    t_answered: Annotated[Seconds | None, doc("s, when the reply was there; null: the episode was over before")]
    causes: tuple[Cause, ...]
    roster: Annotated[str, doc("what was said of the drones, as it stood in the question")]
    frames: Annotated[tuple[Whole, ...], doc("frame_id of each drone's picture, the first drone's first")]
    reply: Annotated[str | None, doc("as received; null: none came in time")]
    orders: Annotated[tuple[Order, ...], doc("those that were carried out")]
    confirms: Annotated[tuple[DroneNumber, ...], doc("drones whose report was confirmed: a decision each")]
    error: Annotated[str | None, doc("why the reply, or a part of it, changed nothing")] = None
    latency_s: Annotated[Number | None, doc("s of vehicle time that the reply took")] = None
    tokens_in: int | None = None
    tokens_out: int | None = None
    model: Annotated[str, doc("its name")]
    served: (
        Annotated[str, doc("what answered, in the vendor's words; missing: as before, at first the name asked for")]
        | UnsetType
    ) = UNSET


@dataclass(frozen=True, slots=True, kw_only=True)
class LoggedPrompt:
    """The text of one question to a model: a line of prompts.jsonl, by the agent.

    A line has the whole `text`, or what differs from the last line of its role and drone that has one: that line's
    first `head` lines of text, then `lines`, then its last `tail` lines of text. `foundation.run_folder.prompts` puts
    it together.
    """

    role: Annotated[Literal["pilot", "commander"], Meta(extra={"wrong": "is neither pilot nor commander"})]
    drone: Annotated[DroneNumber, doc("the first of the drones that the question is about, 0 is the first")]
    number: Annotated[Whole, doc("questions of this role about these drones before this one")]
    t_asked: Annotated[Seconds, doc("s, when it was asked")]
    frames: Annotated[tuple[Whole, ...], doc("frame_id of each picture, in the order sent")]
    labels: Annotated[tuple[str, ...], doc("the line of text before each picture; empty: none has one")]
    text: Annotated[str, doc("the whole text; missing: it is put together")] | UnsetType = UNSET
    head: Annotated[Whole, doc("lines of text at the beginning")] | UnsetType = UNSET
    lines: Annotated[tuple[str, ...], doc("lines of text between head and tail")] | UnsetType = UNSET
    tail: Annotated[Whole, doc("lines of text at the end")] | UnsetType = UNSET


@dataclass(frozen=True, slots=True, kw_only=True)
class Begin:
    """The beginning of the episode, in truth.jsonl."""

    kind: Literal["begin"] = "begin"
    t: Seconds = 0.0
    t0_us: Annotated[int, doc("µs, the vehicle's clock at t = 0, whatever that counts from")]
    cap_s: Annotated[Cap | None, doc("s, the length of the flight")] = None
    source: Annotated[TraceSource | UnsetType | None, doc("estimate: all that follows is an autopilot's own")] = UNSET
    contacts: Annotated[bool, doc("whether hits are written; missing: they are not")] | UnsetType = UNSET
    resets: (
        Annotated[bool, doc("whether estimator resets are written; missing: the autopilot does not tell them")]
        | UnsetType
    ) = UNSET


@dataclass(frozen=True, slots=True, kw_only=True)
class Pose:
    """Where a drone was, every half second, in truth.jsonl."""

    kind: Literal["pose"] = "pose"
    t: Seconds
    drone: DroneNumber
    position_ned: Annotated[Place, doc("m, NED, of the body")]
    yaw_deg: Annotated[Number | None, doc("°, of the nose, from north, + east")] = None
    target_ned: Annotated[Place | None, doc("m, NED, of the target's centre")] = None
    distance_m: Annotated[Distance | None, doc("m, body to the target's centre in three dimensions")]
    visible: Visible


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameTruth(TargetMeasurement):
    """What was true when a frame was taken, in truth.jsonl."""

    kind: Literal["frame"] = "frame"
    frame_id: Whole
    t: Seconds
    drone: DroneNumber
    position_ned: Annotated[Place | None, doc("m, NED, of the body")] = None
    yaw_deg: Annotated[Number | None, doc("°, of the nose, from north, + east")] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Hit:
    """A drone flew into something, in truth.jsonl. Of one contact each thing is written once."""

    kind: Literal["hit"] = "hit"
    t: Seconds
    drone: DroneNumber
    what: Annotated[str, doc("its name on the map, 'another drone' or 'the ground'")]
    closing_speed: Annotated[Number | None, doc("m/s, with which the contact began; null: of the ground")] = None
    crash: Annotated[bool, doc("it was the first that was hard enough to break something")]


@dataclass(frozen=True, slots=True, kw_only=True)
class Clear:
    """A drone has touched nothing for half a second, in truth.jsonl."""

    kind: Literal["clear"] = "clear"
    t: Seconds
    drone: DroneNumber
    contact_s: Annotated[Number, doc("s, from the first hit of the contact to its last touch")]


@dataclass(frozen=True, slots=True, kw_only=True)
class Reset:
    """The autopilot's estimator was reset, in truth.jsonl: its counter in ODOMETRY went up.

    The jumps are what the estimate moved by between two messages beyond its own velocity and rate of turn.
    """

    kind: Literal["reset"] = "reset"
    t: Seconds
    drone: DroneNumber
    count: Annotated[Whole, doc("resets since the message before, 1 or more")]
    quantities: Annotated[
        tuple[ResetQuantity, ...], doc("yaw, position, velocity, height: those whose jump is too large to be motion")
    ]
    yaw_deg: Annotated[Number, doc("°, jump of the heading, + right")]
    position_m: Annotated[Number, doc("m, horizontal jump of the position")]
    height_m: Annotated[Number, doc("m, jump of the height, + up")]
    velocity_mps: Annotated[Number, doc("m/s, change of the velocity")]


@dataclass(frozen=True, slots=True, kw_only=True)
class End:
    """The end of the episode, in truth.jsonl."""

    kind: Literal["end"] = "end"
    t: Seconds
    reason: Annotated[str, doc("cap, decided, budget, rejected, interrupted, takeover or error")]
    error: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class EstimateHead:
    """What an estimate was derived from, the first line of estimate.jsonl."""

    kind: Literal["estimate"] = "estimate"
    source: Annotated[str, doc("name of the log that the positions are of")] | UnsetType = UNSET
    origin: Annotated[Place | None, doc("lat °, lon °, alt m above mean sea level, of the local frame")] = None
    target: Annotated[Surveyed | None, doc("latitude_deg, longitude_deg, altitude_m, std_m, as surveyed")] = None
    target_ned: Annotated[Place | None, doc("m, NED in the local frame")] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class EstimatedPose:
    """Where the autopilot thought it was, smoothed, every half second, in estimate.jsonl."""

    kind: Literal["pose"] = "pose"
    t: Seconds
    drone: DroneNumber
    position_ned: Annotated[Place, doc("m, NED in the autopilot's local frame")]
    position_std_m: Annotated[Place | None, doc("m, standard deviation per axis")] = None
    yaw_deg: Annotated[Number | None, doc("°, of the nose, from north, + east")] = None
    target_ned: Annotated[Place | None, doc("m, NED in the local frame")] = None
    distance_m: Annotated[Distance | None, doc("m to the surveyed target, horizontally where it has no altitude")]
    distance_std_m: Annotated[Deviation | None, doc("m, standard deviation of that")] = None
    visible: Visible


@dataclass(frozen=True, slots=True, kw_only=True)
class EstimatedFrame:
    """Where the autopilot thought it was when a frame was taken, in estimate.jsonl."""

    kind: Literal["frame"] = "frame"
    frame_id: Whole
    t: Seconds
    drone: DroneNumber
    position_ned: Annotated[Place | None, doc("m, NED in the autopilot's local frame")] = None
    position_std_m: Annotated[Place | None, doc("m, standard deviation per axis")] = None
    yaw_deg: Annotated[Number | None, doc("°, of the nose, from north, + east")] = None
    target_ned: Annotated[Place | None, doc("m, NED in the local frame")] = None
    distance_m: Annotated[Distance | None, doc("m to the surveyed target, horizontally where it has no altitude")]
    distance_std_m: Annotated[Deviation | None, doc("m, standard deviation of that")] = None
    visible: Visible


@dataclass(frozen=True, slots=True, kw_only=True)
class FlownThing:
    """A thing of the record that stands somewhere."""

    position_ned: Annotated[Place | None, doc("m, NED, on the ground under its middle; null: it moves")] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class FlownRecord:
    """The part of episode.json that the judging of a fleet needs. The full record: `episodes.records.record`."""

    cell: str
    target: FlownThing
    candidates: tuple[FlownThing, ...] = ()


TRUTH_ROWS = {  # by `kind`
    "begin": Begin, "pose": Pose, "frame": FrameTruth, "hit": Hit, "clear": Clear, "reset": Reset, "end": End,
}  # fmt: skip
ESTIMATE_ROWS = {"estimate": EstimateHead, "pose": EstimatedPose, "frame": EstimatedFrame}
