"""Makes the data of one flight for the page: prompts, decisions and truth, step by step.

Times are in vehicle seconds since the episode began, positions in metres in the map's NED frame, headings in degrees
from north. The page's JSON omits fields that are None. Numbers are rounded to the digits that the page shows.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from dronecats.agent.prompt import compact
from dronecats.judge.verdict import qualifies
from dronecats.report.kit.shell import action_words
from dronecats.report.page.pictures import PictureAddress
from dronecats.report.recorded.flight import RecordedFlight, action_of
from foundation.frames import Vec3
from foundation.protocol import CAP_S
from foundation.run_folder.prompts import prompts_of, read_prompts
from foundation.run_folder.rows import Decision, EstimatedFrame, EstimatedPose, FrameTruth, Pose, drone_label


@dataclass(frozen=True, slots=True, kw_only=True)
class ShownTrace:
    """The path of a drone, with a sample every half second."""

    drone: int
    t: tuple[float, ...]  # s
    north: tuple[float, ...]  # m
    east: tuple[float, ...]  # m
    height: tuple[float, ...]  # m above the frame's origin
    yaw: tuple[float | None, ...]  # °
    distance: tuple[float | None, ...]  # m, to the target's centre
    visible: tuple[bool | None, ...]  # whether the target was in view


@dataclass(frozen=True, slots=True, kw_only=True)
class ShownPath:
    """The path of the target. It has one sample if the target does not move."""

    t: tuple[float, ...]  # s
    north: tuple[float, ...]  # m
    east: tuple[float, ...]  # m


@dataclass(frozen=True, slots=True, kw_only=True)
class ShownLookAlike:
    """A look-alike of the target."""

    name: str
    north: float  # m
    east: float  # m


@dataclass(frozen=True, slots=True, kw_only=True)
class ShownTruth:
    """The truth of a frame, which only the judge knows; in a flight without truth, the estimate."""

    north: float | None  # m
    east: float | None  # m
    yaw: float | None  # °
    distance: float | None  # m, to the target's centre
    box: float | None  # m, to the nearest point of the target's box
    visible: bool | None
    share: float | None  # 0 … 1, visible share of the target
    bearing: float | None  # ° from the nose to the target's centre, + right
    depth: float | None  # m, to the target's visible surface along the optical axis
    qualifies: bool | None  # whether the declaration is a success; None: unknown, or not a declaration


@dataclass(frozen=True, slots=True, kw_only=True)
class ShownStep:
    """One decision of one drone. `reply`, `parts` and `history` are indices into the flight's texts."""

    step: int
    drone: int
    frame: int
    t: float  # s, time of the picture
    decided: float  # s, time of the decision
    action: dict[str, Any] | None
    does: str  # the action in words
    says: str | None  # the action in the prompt's compact form
    error: str | None
    reply: int | None
    parts: tuple[int, ...] | None  # the parts of the prompt before and after the history
    history: int | None
    picture: str | None  # address of the picture
    latency: float | None  # s
    tokens_in: int | None
    tokens_out: int | None
    thinking: bool | None
    rate: float | None  # Hz
    finish: str | None
    mended: tuple[str, ...] | None
    report: bool | None
    confirmed_by: int | None
    truth: ShownTruth | None


@dataclass(frozen=True, slots=True, kw_only=True)
class ShownExchange:
    """One question to a commander, with its answer and the orders in it."""

    number: int
    asked: float  # s, time of the question
    answered: float | None  # s, time of the answer
    causes: tuple[str, ...]
    orders: tuple[str, ...]
    confirms: tuple[int, ...]
    error: str | None
    latency: float | None  # s
    tokens_in: int | None
    tokens_out: int | None
    model: str
    reply: str | None
    prompt: str | None


@dataclass(frozen=True, slots=True, kw_only=True)
class ShownFlight:
    """The data of one flight of one episode for the page."""

    instruction: str
    named: str  # name of the target in a few words
    drones: int
    estimated: bool  # True: flight without truth, positions are the autopilot's estimates
    delta: float  # m, success radius
    end: float  # s, end of the flight
    hfov: float  # °
    aspect: float  # width / height of a picture
    traces: tuple[ShownTrace, ...]
    path: ShownPath | None
    candidates: tuple[ShownLookAlike, ...]
    texts: tuple[str, ...]
    steps: tuple[ShownStep, ...]
    exchanges: tuple[ShownExchange, ...]


def shown_flight(flight: RecordedFlight, picture: PictureAddress) -> ShownFlight:
    """Return a flight for the page. Raises UsageError if a log is damaged."""
    logs, camera = flight.logs, flight.camera
    poses: Sequence[Pose | EstimatedPose] = logs.poses if logs.true else flight.estimated_poses
    times = (*(pose.t for pose in poses), *(decision.t_decided for decision in logs.decisions))
    texts = _Texts()
    prompts = read_prompts(flight.folder)
    answered = prompts_of(logs.decisions, prompts)
    commanded = {prompt.row.number: prompt.text for prompt in prompts if prompt.row.role == "commander"}
    steps = []
    for decision in logs.decisions:
        action, prompt = action_of(decision), answered.get((decision.drone, decision.step))
        steps.append(
            ShownStep(
                step=decision.step,
                drone=decision.drone,
                frame=decision.frame_id,
                t=_rounded(2, decision.t_frame),
                decided=_rounded(2, decision.t_decided),
                action=decision.action,
                does=action_words(decision),
                says=None if action is None else compact(action),
                error=decision.error,
                reply=texts.number(decision.reply) if isinstance(decision.reply, str) else None,
                parts=None if prompt is None else tuple(texts.number(part) for part in (prompt.head, prompt.tail)),
                history=None if prompt is None else texts.number(prompt.changed),
                picture=picture(decision),
                latency=_rounded_or_none(3, decision.latency_s),
                tokens_in=decision.tokens_in,
                tokens_out=decision.tokens_out,
                thinking=decision.thinking or None,
                rate=_rounded_or_none(2, decision.rate_hz),
                finish=decision.finish if isinstance(decision.finish, str) else None,
                mended=decision.mended if isinstance(decision.mended, tuple) else None,
                report=True if decision.report is True else None,
                confirmed_by=decision.confirmed_by if isinstance(decision.confirmed_by, int) else None,
                truth=_truth(decision, flight),
            )
        )
    return ShownFlight(
        instruction=flight.instruction,
        named=_named(flight.record.get("target")),
        drones=1 + max((row.drone for row in (*logs.decisions, *poses)), default=0),
        estimated=not logs.true,
        delta=flight.delta_m,
        end=_rounded(2, max(times, default=CAP_S)),
        hfov=camera.hfov_deg,
        aspect=camera.width / camera.height,
        traces=tuple(_trace(drone, poses) for drone in sorted({pose.drone for pose in poses})),
        path=_path(poses),
        candidates=_look_alikes(flight.record.get("candidates")),
        texts=tuple(texts.all),
        steps=tuple(steps),
        exchanges=tuple(
            ShownExchange(
                number=exchange.number,
                asked=_rounded(2, exchange.t_asked),
                answered=_rounded_or_none(2, exchange.t_answered),
                causes=tuple(cause.why if cause.drone is None else f"{cause.why} of {drone_label(cause.drone)}"
                             for cause in exchange.causes),
                orders=tuple(f"{drone_label(order.drone).capitalize()}: {order.goal}" for order in exchange.orders),
                confirms=exchange.confirms,
                error=exchange.error,
                latency=_rounded_or_none(3, exchange.latency_s),
                tokens_in=exchange.tokens_in,
                tokens_out=exchange.tokens_out,
                model=exchange.model,
                reply=exchange.reply,
                prompt=commanded.get(exchange.number),
            )
            for exchange in flight.exchanges
        ),
    )  # fmt: skip


class _Texts:
    """The texts of a flight, each stored once: drones of a fleet share replies, and successive prompts share parts."""

    def __init__(self) -> None:
        self.all: list[str] = []
        self._numbers: dict[str, int] = {}

    def number(self, text: str) -> int:
        """Return the index of a text. Adds a new text."""
        if text not in self._numbers:
            self._numbers[text] = len(self.all)
            self.all.append(text)
        return self._numbers[text]


def _truth(decision: Decision, flight: RecordedFlight) -> ShownTruth | None:
    at, logs = (decision.drone, decision.frame_id), flight.logs
    frame: FrameTruth | EstimatedFrame | None = logs.frames.get(at)
    if frame is None and logs.estimate is not None:
        frame = logs.estimate.frames.get(at)
    if frame is None:
        return None
    measured = frame if isinstance(frame, FrameTruth) else None
    place = frame.position_ned
    return ShownTruth(
        north=_rounded_or_none(2, place and place[0]),
        east=_rounded_or_none(2, place and place[1]),
        yaw=_rounded_or_none(1, frame.yaw_deg),
        distance=_rounded_or_none(2, frame.distance_m),
        box=_rounded_or_none(2, measured.distance_box_m if measured else None),
        visible=frame.visible,
        share=_rounded_or_none(3, measured.visible_fraction if measured else None),
        bearing=_rounded_or_none(1, measured.bearing_deg if measured else None),
        depth=_rounded_or_none(2, measured.oracle_depth_m if measured else None),
        qualifies=qualifies(decision, logs, flight.delta_m, flight.cap_s),
    )


def _trace(drone: int, poses: Sequence[Pose | EstimatedPose]) -> ShownTrace:
    own = sorted((pose for pose in poses if pose.drone == drone), key=lambda pose: pose.t)
    return ShownTrace(
        drone=drone,
        t=tuple(_rounded(2, pose.t) for pose in own),
        north=tuple(_rounded(2, pose.position_ned[0]) for pose in own),
        east=tuple(_rounded(2, pose.position_ned[1]) for pose in own),
        height=tuple(_rounded(1, -pose.position_ned[2]) for pose in own),
        yaw=tuple(_rounded_or_none(0, pose.yaw_deg) for pose in own),
        distance=tuple(_rounded_or_none(2, pose.distance_m) for pose in own),
        visible=tuple(pose.visible for pose in own),
    )


def _path(poses: Sequence[Pose | EstimatedPose]) -> ShownPath | None:
    seen: dict[float, Vec3] = {pose.t: pose.target_ned for pose in poses if pose.target_ned is not None}
    if not seen:
        return None
    times = sorted(seen)
    first = seen[times[0]]
    if all(math.dist(first, place) < 0.05 for place in seen.values()):
        times = times[:1]
    return ShownPath(
        t=tuple(_rounded(2, t) for t in times),
        north=tuple(_rounded(2, seen[t][0]) for t in times),
        east=tuple(_rounded(2, seen[t][1]) for t in times),
    )


def _look_alikes(entries: Any) -> tuple[ShownLookAlike, ...]:
    """Return the look-alikes that have a position. `entries`: the candidates in an episode record."""
    look_alikes = []
    for entry in entries if isinstance(entries, list) else ():
        place = entry.get("position_ned") if isinstance(entry, dict) else None
        if isinstance(place, list) and len(place) == 3 and all(isinstance(x, int | float) for x in place):
            look_alikes.append(ShownLookAlike(name=_named(entry), north=float(place[0]), east=float(place[1])))
    return tuple(look_alikes)


def _named(entry: Any) -> str:
    """Return the name of a record's target or look-alike."""
    if not isinstance(entry, dict):
        return ""
    words = [str(entry[key]) for key in ("paint", "asset", "native") if isinstance(entry.get(key), str)]
    inscription = entry.get("inscription")
    return " ".join([*words, *([f"“{inscription}”"] if inscription else [])])


def _rounded_or_none(digits: int, value: float | None) -> float | None:
    return None if value is None else _rounded(digits, value)


def _rounded(digits: int, value: float) -> float:
    """Return a rounded number, as an integer if possible: 3 is shorter than 3.0."""
    rounded = round(float(value), digits)
    return int(rounded) if rounded == int(rounded) else rounded
