"""The rows of the logs, one dataclass each, with the names, units and frames of all fields.

Unless a field says otherwise, times are vehicle seconds since the episode began, and positions are in metres in the
map's NED frame. A line may lack a field that has a default, for example if an older version wrote the line. The default
is usually None. It is UNSET for fields in which null has a meaning of its own. Fields may be added but not renamed.
Readers ignore unknown fields.

mypy, the strict reader (`reading.py`) and the published schemas (`schemas/`) all use the annotations.
"""

import textwrap
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from msgspec import UNSET, Meta, UnsetType

from foundation.measurement import Distance, Place, TargetMeasurement, Visible, doc
from foundation.protocol import FINISHED, GO, ROTATE
from foundation.typed_file import LARGE, Number

DRONES = 255  # one for each system id of MAVLink

# `wrong`: the message of the strict reader (`reading.py`) about an invalid value
Whole = Annotated[int, Meta(ge=0, lt=int(LARGE), extra={"wrong": "is not a whole number"})]
DroneNumber = Annotated[int, Meta(ge=0, lt=DRONES, description="0 is drone 1",
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
ServedName = Annotated[
    str | UnsetType, doc("model name in the reply; missing: as in the previous line, in the first line as requested")
]
Surveyed = Annotated[dict[str, Number | None], Meta(extra={"wrong": "is not a surveyed place"})]


def drone_label(drone: int) -> str:
    """Return a drone's name in texts for people. These texts count drones from 1; files and columns count from 0."""
    return f"drone {drone + 1}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """The keys that every run.json has. The other keys are the configuration of the run."""

    schema: Annotated[int, Meta(ge=1, description="version of the folder's files; missing in older folders",
                                extra={"wrong": "is not a version"})] | UnsetType = UNSET  # fmt: skip
    versions: Annotated[dict[str, str], doc("versions of dronecats, Python and the packages that affect results")]


@dataclass(frozen=True, slots=True, kw_only=True)
class EpisodeIdentity:
    """identity.json: the code, pictures and models of the flight. Flights with different identities are not pooled."""

    code_sha256: Annotated[str, doc("digest of the sources that affect flying and judging")]
    record_sha256: Annotated[str | None, doc("digest of episode.json; null: no such file")]
    frames: Annotated[Whole, doc("number of pictures that the pilot got")]
    frames_sha256: Annotated[
        str | None, doc("digest of the pictures' JPEG bytes, in the order of the file names; null: no picture")
    ]
    served: Annotated[
        tuple[str, ...], doc("names and versions of models in the vendor's replies; empty: only the requested name")
    ]
    pace: Annotated[dict[str, float], doc("how well a real-time flight kept its pace")] | UnsetType = UNSET


@dataclass(frozen=True, slots=True)
class PointedGo:
    """The point and the depth of a `go` action."""

    x: float  # 0 … 1000, left to right in the picture
    y: float  # 0 … 1000, top to bottom in the picture
    depth_m: float  # m along the optical axis


@dataclass(frozen=True, slots=True, kw_only=True)
class Decision:
    """A decision of the pilot, with its frame and times: a line of decisions.jsonl, by the agent."""

    step: Whole
    drone: DroneNumber
    frame_id: Whole
    t_frame: Annotated[Seconds, doc("s, time of the picture")]
    t_decided: Annotated[Seconds, doc("s, time of the reply")]
    reply: Annotated[str, doc("as received")] | UnsetType = UNSET
    action: Annotated[ActionObject | None, doc("parsed, point as [x, y]; null: the reply has no valid action")]
    error: Annotated[str | None, doc("why there is no action")] = None
    mended: Annotated[tuple[str, ...], doc("codes of the repairs of the reply: docs/replies.md")] | UnsetType = UNSET
    latency_s: Annotated[Number | None, doc("s of vehicle time that the reply took")] = None
    tokens_in: int | None = None
    tokens_out: int | None = None
    thinking: Annotated[bool | None, doc("whether extended reasoning was on")] = None
    rate_hz: Annotated[Number | None, doc("Hz, 1 / vehicle time since the previous decision; null: first decision")] = (
        None
    )
    finish: Annotated[
        str | UnsetType, doc("why the reply ends: length, filtered, refusal, …; missing: it is complete")
    ] = UNSET
    report: Annotated[
        bool | UnsetType, doc("with a commander: this reports arrival to it, and is not a declaration")
    ] = UNSET
    confirmed_by: Annotated[
        Whole | UnsetType, doc("number of the commander's exchange that confirms the report, on the frame it saw")
    ] = UNSET
    served: ServedName = UNSET
    tokens_cached: Annotated[Whole, doc("part of tokens_in that was cached; missing: not reported")] | UnsetType = UNSET
    tokens_reasoning: Annotated[Whole | UnsetType, doc("part of tokens_out for reasoning; missing: not reported")] = (
        UNSET
    )
    endpoint: Annotated[
        str | UnsetType, doc("provider that a router such as OpenRouter chose; missing: not reported")
    ] = UNSET
    host_lag_s: Annotated[
        Number | UnsetType, doc("s that the vehicle's clock fell behind wall time × speed since the last decision")
    ] = UNSET  # missing in lockstep, where no clock lags
    frame_wait_s: Annotated[
        Number | UnsetType, doc("s, wall time × speed of the wait for the picture; in a fleet, per drone")
    ] = UNSET

    @property
    def kind(self) -> str | None:
        """The action's name, as in `foundation.protocol`; None if the reply has no action."""
        return None if self.action is None else str(self.action["action"])

    @property
    def declares(self) -> bool:
        """True if the decision declares arrival. A report to a commander is not a declaration."""
        return self.kind == FINISHED and self.report is not True

    @property
    def go(self) -> PointedGo | None:
        """The point and the depth of a go; None for other actions, and for a go without valid numbers."""
        if self.action is None or self.kind != GO:
            return None
        point, depth_m = self.action.get("point"), self.action.get("depth_m")
        numbers = [*point, depth_m] if isinstance(point, list) and len(point) == 2 else []
        valid = [float(n) for n in numbers if isinstance(n, int | float) and not isinstance(n, bool) and abs(n) < LARGE]
        return PointedGo(*valid) if len(valid) == 3 else None

    @property
    def action_words(self) -> str:
        """The action in a few words, such as `go (512, 700) 6.5 m` or `rotate 30° left`."""
        if self.action is None:
            return "no action"
        if (go := self.go) is not None:
            return f"go ({go.x:.0f}, {go.y:.0f}) {go.depth_m:.1f} m"
        angle_deg = self.action.get("angle_deg")
        if self.kind == ROTATE and isinstance(angle_deg, int | float):
            return f"rotate {abs(angle_deg):.0f}° {'left' if angle_deg < 0 else 'right'}"
        return f"{FINISHED} (report)" if self.kind == FINISHED and self.report is True else str(self.kind)

    def action_or_reason(self, width: int = 60) -> str:
        """Return `action_words`, or the reason why there is no action, cut to `width` characters."""
        if self.action is not None:
            return self.action_words
        return f"no action: {textwrap.shorten(self.error or 'the reply holds none', width, placeholder='…')}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Cause:
    """The reason for a question to the commander."""

    why: Annotated[Literal["start", "report", "stall", "time"], Meta(extra={"wrong": "is not a cause"})]
    drone: Annotated[DroneNumber | None, doc("whose report or stall it is")] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Order:
    """A commander's order to one drone."""

    drone: DroneNumber
    goal: Annotated[str, doc("instruction of the drone's agent, from its next question on")]


@dataclass(frozen=True, slots=True, kw_only=True)
class Exchange:
    """A question to the commander, its reply and the effect: a line of commander.jsonl, by the agent."""

    number: Annotated[Whole, doc("0 is the first")]
    t_asked: Annotated[Seconds, doc("s, time of the question, not before its newest picture")]
    t_answered: Annotated[Seconds | None, doc("s, time of the reply; null: the episode ended first")]
    causes: tuple[Cause, ...]
    roster: Annotated[str, doc("the question's text about the drones")]
    frames: Annotated[tuple[Whole, ...], doc("frame_id of each drone's picture, in the order of the drones")]
    reply: Annotated[str | None, doc("as received; null: no reply in time")]
    orders: Annotated[tuple[Order, ...], doc("orders that took effect")]
    confirms: Annotated[
        tuple[DroneNumber, ...], doc("drones whose report was confirmed; decisions.jsonl has a row for each")
    ]
    error: Annotated[str | None, doc("why the reply, or a part of it, had no effect")] = None
    latency_s: Annotated[Number | None, doc("s of vehicle time that the reply took")] = None
    tokens_in: int | None = None
    tokens_out: int | None = None
    model: Annotated[str, doc("its name")]
    served: ServedName = UNSET


@dataclass(frozen=True, slots=True, kw_only=True)
class LoggedPrompt:
    """The text of one question to a model: a line of prompts.jsonl, by the agent.

    A line has the whole `text`, or the difference from the last line with a `text` for the same role and drone: the
    first `head` lines of that text, then `lines`, then the last `tail` lines of that text.
    `foundation.run_folder.prompts` restores the text.
    """

    role: Annotated[Literal["pilot", "commander"], Meta(extra={"wrong": "is neither pilot nor commander"})]
    drone: Annotated[DroneNumber, doc("first drone of the question; 0 is drone 1")]
    number: Annotated[Whole, doc("number of earlier questions of this role about these drones")]
    t_asked: Annotated[Seconds, doc("s, time of the question")]
    frames: Annotated[tuple[Whole, ...], doc("frame_id of each picture, in the order sent")]
    labels: Annotated[tuple[str, ...], doc("line of text before each picture; empty: no such lines")]
    text: Annotated[str, doc("the whole text; missing: made from head, lines and tail")] | UnsetType = UNSET
    head: Annotated[Whole, doc("number of lines to repeat at the beginning")] | UnsetType = UNSET
    lines: Annotated[tuple[str, ...], doc("new lines between head and tail")] | UnsetType = UNSET
    tail: Annotated[Whole, doc("number of lines to repeat at the end")] | UnsetType = UNSET


@dataclass(frozen=True, slots=True, kw_only=True)
class EnvelopeRow:
    """The limits of a drone's safety envelope that act from this time on: a line of safety.jsonl, by the agent."""

    time_us: Annotated[int, doc("µs, vehicle clock")]
    drone: DroneNumber
    limits: Annotated[tuple[str, ...], doc("names of the limits; empty: no limit acts")]


class ActiveLimits:
    """Follows the rows of safety.jsonl, and keeps the limits that act on each drone."""

    def __init__(self) -> None:
        self._of_drone: dict[int, tuple[str, ...]] = {}

    def begun(self, row: EnvelopeRow) -> tuple[str, ...]:
        """Take the next row; return the limits in it that did not act in the previous row of the same drone."""
        before = self._of_drone.get(row.drone, ())
        self._of_drone[row.drone] = row.limits
        return tuple(name for name in row.limits if name not in before)


@dataclass(frozen=True, slots=True, kw_only=True)
class Begin:
    """The beginning of the episode, in truth.jsonl."""

    kind: Literal["begin"] = "begin"
    t: Seconds = 0.0
    t0_us: Annotated[int, doc("µs, the vehicle's clock at t = 0")]
    cap_s: Annotated[Cap | None, doc("s, the length of the flight")] = None
    source: Annotated[
        TraceSource | UnsetType | None, doc("estimate: the following rows are an autopilot's estimate")
    ] = UNSET
    contacts: Annotated[bool, doc("whether the log has hits; missing: no")] | UnsetType = UNSET
    resets: Annotated[
        bool | UnsetType, doc("whether the log has estimator resets; missing: the autopilot does not report them")
    ] = UNSET


@dataclass(frozen=True, slots=True, kw_only=True)
class Pose:
    """True pose of a drone, every half second, in truth.jsonl."""

    kind: Literal["pose"] = "pose"
    t: Seconds
    drone: DroneNumber
    position_ned: Annotated[Place, doc("m, NED, position of the body")]
    yaw_deg: Annotated[Number | None, doc("°, heading of the nose from north, + east")] = None
    target_ned: Annotated[Place | None, doc("m, NED, position of the target's centre")] = None
    distance_m: Annotated[Distance | None, doc("m, from the body to the target's centre, in three dimensions")]
    visible: Visible


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameTruth(TargetMeasurement):
    """The truth at the time of a frame, in truth.jsonl."""

    kind: Literal["frame"] = "frame"
    frame_id: Whole
    t: Seconds
    drone: DroneNumber
    position_ned: Annotated[Place | None, doc("m, NED, position of the body")] = None
    yaw_deg: Annotated[Number | None, doc("°, heading of the nose from north, + east")] = None
    camera_pitch_deg: Annotated[
        Number | UnsetType, doc("°, camera's pitch, up from the nose; with a gimbal, up from the horizon; missing: 0")
    ] = UNSET


@dataclass(frozen=True, slots=True, kw_only=True)
class Hit:
    """A drone hit something, in truth.jsonl. Each thing is logged once per contact.

    A contact that began below 0.15 m/s is logged only after it has lasted half a second.
    """

    kind: Literal["hit"] = "hit"
    t: Seconds
    drone: DroneNumber
    what: Annotated[str, doc("name on the map, 'another drone' or 'the ground'")]
    closing_speed: Annotated[Number | None, doc("m/s, speed at the start of the contact; null: the ground")] = None
    crash: Annotated[bool, doc("first hit of this drone hard enough to break something")]


@dataclass(frozen=True, slots=True, kw_only=True)
class Clear:
    """A drone has touched nothing for half a second, in truth.jsonl."""

    kind: Literal["clear"] = "clear"
    t: Seconds
    drone: DroneNumber
    contact_s: Annotated[Number, doc("s, from the first touch of the contact to its last")]


@dataclass(frozen=True, slots=True, kw_only=True)
class Reset:
    """The autopilot's estimator was reset, in truth.jsonl: its counter in ODOMETRY went up.

    A jump is the change of the estimate between two messages, minus the motion that its velocity and rates explain.
    """

    kind: Literal["reset"] = "reset"
    t: Seconds
    drone: DroneNumber
    count: Annotated[Whole, doc("resets since the previous message, 1 or more")]
    quantities: Annotated[tuple[ResetQuantity, ...], doc("quantities whose jump is too large for a motion")]
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
    """The source of an estimate, the first line of estimate.jsonl."""

    kind: Literal["estimate"] = "estimate"
    source: Annotated[str, doc("name of the log that contains the positions")] | UnsetType = UNSET
    origin: Annotated[
        Place | None, doc("origin of the local frame: latitude °, longitude °, altitude m above mean sea level")
    ] = None
    target: Annotated[Surveyed | None, doc("surveyed latitude_deg, longitude_deg, altitude_m, std_m")] = None
    target_ned: Annotated[Place | None, doc("m, NED in the local frame")] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class EstimatedPose:
    """The autopilot's estimated pose, smoothed, every half second, in estimate.jsonl."""

    kind: Literal["pose"] = "pose"
    t: Seconds
    drone: DroneNumber
    position_ned: Annotated[Place, doc("m, NED in the autopilot's local frame")]
    position_std_m: Annotated[Place | None, doc("m, standard deviation per axis")] = None
    yaw_deg: Annotated[Number | None, doc("°, heading of the nose from north, + east")] = None
    target_ned: Annotated[Place | None, doc("m, NED in the local frame")] = None
    distance_m: Annotated[Distance | None, doc("m, to the surveyed target; horizontal if it has no altitude")]
    distance_std_m: Annotated[Deviation | None, doc("m, standard deviation of the distance")] = None
    visible: Visible


@dataclass(frozen=True, slots=True, kw_only=True)
class EstimatedFrame:
    """The autopilot's estimated pose at the time of a frame, in estimate.jsonl."""

    kind: Literal["frame"] = "frame"
    frame_id: Whole
    t: Seconds
    drone: DroneNumber
    position_ned: Annotated[Place | None, doc("m, NED in the autopilot's local frame")] = None
    position_std_m: Annotated[Place | None, doc("m, standard deviation per axis")] = None
    yaw_deg: Annotated[Number | None, doc("°, heading of the nose from north, + east")] = None
    target_ned: Annotated[Place | None, doc("m, NED in the local frame")] = None
    distance_m: Annotated[Distance | None, doc("m, to the surveyed target; horizontal if it has no altitude")]
    distance_std_m: Annotated[Deviation | None, doc("m, standard deviation of the distance")] = None
    visible: Visible


@dataclass(frozen=True, slots=True, kw_only=True)
class FlownThing:
    """The place of a target or look-alike of the record."""

    position_ned: Annotated[Place | None, doc("m, NED, ground under its centre; null: it moves")] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class FlownRecord:
    """The part of episode.json that the judge needs for a fleet. The full record: `episodes.records.record`."""

    cell: str
    target: FlownThing
    candidates: tuple[FlownThing, ...] = ()


TRUTH_ROWS = {  # by `kind`
    "begin": Begin, "pose": Pose, "frame": FrameTruth, "hit": Hit, "clear": Clear, "reset": Reset, "end": End,
}  # fmt: skip
ESTIMATE_ROWS = {"estimate": EstimateHead, "pose": EstimatedPose, "frame": EstimatedFrame}
