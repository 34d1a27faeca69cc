"""One flight as the page has it: what was asked, decided and true, step by step, small enough for a browser.

Times are vehicle seconds since the episode began, places metres in the map's NED frame, headings degrees from north.
What is None is left out on the way to the page; numbers are rounded to what can be seen.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from dronecats.agent.action import Action, ActionError, action_from
from dronecats.agent.history import compact
from dronecats.judge.verdict import qualifies
from dronecats.report.kit.words import action_words
from dronecats.report.page.pictures import PictureAddress
from dronecats.report.recorded.flight import RecordedFlight
from dronecats.report.recorded.run import RecordedRun
from foundation.frames import Vec3
from foundation.protocol import CAP_S
from foundation.run_folder.prompts import prompts_of, read_prompts
from foundation.run_folder.reading import exchanges
from foundation.run_folder.rows import Decision, EstimatedFrame, EstimatedPose, FrameTruth, Pose, drone_label


@dataclass(frozen=True, slots=True, kw_only=True)
class ShownTrace:
    """Where a drone was, every half second."""

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
    """Where the target was; of one that stands, one sample."""

    t: tuple[float, ...]  # s
    north: tuple[float, ...]  # m
    east: tuple[float, ...]  # m


@dataclass(frozen=True, slots=True, kw_only=True)
class ShownThing:
    """A look-alike of the target."""

    name: str
    north: float  # m
    east: float  # m


@dataclass(frozen=True, slots=True, kw_only=True)
class ShownTruth:
    """What was true of a frame. The judge's: no model has seen it."""

    north: float | None  # m
    east: float | None  # m
    yaw: float | None  # °
    distance: float | None  # m, to the target's centre
    box: float | None  # m, to its box
    visible: bool | None
    share: float | None  # 0 … 1 of the target that is in view
    bearing: float | None  # °, + right
    depth: float | None  # m, along the optical axis
    qualifies: bool | None  # of a declaration: whether it was warranted


@dataclass(frozen=True, slots=True, kw_only=True)
class ShownStep:
    """One decision of one drone. Texts are numbers into the flight's."""

    step: int
    drone: int
    frame: int
    t: float  # s, of the picture
    decided: float  # s
    action: dict[str, Any] | None
    does: str  # the action in words
    says: str | None  # the action in the prompt's compact form
    error: str | None
    reply: int | None
    parts: tuple[int, ...] | None  # of the prompt, around what changes from step to step
    history: int | None  # what changes: the history
    picture: str | None
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
    """A question to a commander, and what came of it."""

    number: int
    asked: float  # s
    answered: float | None  # s
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
    """Everything that the page shows of one flight of one episode."""

    instruction: str
    named: str  # the target, in a few words
    drones: int
    estimated: bool  # nobody knew the truth: places are an autopilot's own
    delta: float  # m
    end: float  # s
    hfov: float  # °
    aspect: float  # width of a picture / its height
    traces: tuple[ShownTrace, ...]
    path: ShownPath | None
    candidates: tuple[ShownThing, ...]
    texts: tuple[str, ...]
    steps: tuple[ShownStep, ...]
    exchanges: tuple[ShownExchange, ...]


def shown_flight(run: RecordedRun, flown: RecordedFlight, picture: PictureAddress) -> ShownFlight:
    """Return a flight for the page. Raises UsageError when a log of its folder is damaged."""
    logs = flown.logs
    told = exchanges(flown.folder)
    camera = run.camera
    instruction = str(flown.record.get("instruction") or run.flight.get("instruction") or "")
    poses: Sequence[Pose | EstimatedPose] = (
        logs.poses if logs.true else logs.estimate.poses if logs.estimate is not None else ()
    )
    texts = _Texts()
    prompts = read_prompts(flown.folder)
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
                t=_to(2, decision.t_frame),
                decided=_to(2, decision.t_decided),
                action=decision.action,
                does=action_words(decision),
                says=None if action is None else compact(action),
                error=decision.error,
                reply=texts.number(decision.reply) if isinstance(decision.reply, str) else None,
                parts=None if prompt is None else tuple(texts.number(part) for part in (prompt.head, prompt.tail)),
                history=None if prompt is None else texts.number(prompt.changed),
                picture=picture(decision),
                latency=_known(3, decision.latency_s),
                tokens_in=decision.tokens_in,
                tokens_out=decision.tokens_out,
                thinking=decision.thinking or None,
                rate=_known(2, decision.rate_hz),
                finish=decision.finish if isinstance(decision.finish, str) else None,
                mended=decision.mended if isinstance(decision.mended, tuple) else None,
                report=True if decision.report is True else None,
                confirmed_by=decision.confirmed_by if isinstance(decision.confirmed_by, int) else None,
                truth=_truth(decision, flown),
            )
        )
    return ShownFlight(
        instruction=instruction,
        named=_named(flown.record.get("target")),
        drones=1 + max((each.drone for each in (*logs.decisions, *poses)), default=0),
        estimated=not logs.true,
        delta=flown.delta_m,
        end=_to(2, _end(flown, poses)),
        hfov=camera.hfov_deg,
        aspect=camera.width / camera.height,
        traces=tuple(_trace(drone, poses) for drone in sorted({pose.drone for pose in poses})),
        path=_path(poses),
        candidates=_things(flown.record.get("candidates")),
        texts=tuple(texts.all),
        steps=tuple(steps),
        exchanges=tuple(
            ShownExchange(
                number=each.number,
                asked=_to(2, each.t_asked),
                answered=_known(2, each.t_answered),
                causes=tuple(cause.why if cause.drone is None else f"{cause.why} of {drone_label(cause.drone)}"
                             for cause in each.causes),
                orders=tuple(f"{drone_label(order.drone).capitalize()}: {order.goal}" for order in each.orders),
                confirms=each.confirms,
                error=each.error,
                latency=_known(3, each.latency_s),
                tokens_in=each.tokens_in,
                tokens_out=each.tokens_out,
                model=each.model,
                reply=each.reply,
                prompt=commanded.get(each.number),
            )
            for each in told
        ),
    )  # fmt: skip


def action_of(decision: Decision) -> Action | None:
    """Return a decision's action; None where there is none, or none that this version knows."""
    try:
        return None if decision.action is None else action_from(decision.action)
    except ActionError:
        return None


class _Texts:
    """The texts of a flight, each once: a fleet has one reply, and most of a prompt is that of the step before."""

    def __init__(self) -> None:
        self.all: list[str] = []
        self._numbers: dict[str, int] = {}

    def number(self, text: str) -> int:
        """Return the number of a text, taking it in where it is new."""
        if text not in self._numbers:
            self._numbers[text] = len(self.all)
            self.all.append(text)
        return self._numbers[text]


def _truth(decision: Decision, flown: RecordedFlight) -> ShownTruth | None:
    at, logs = (decision.drone, decision.frame_id), flown.logs
    frame: FrameTruth | EstimatedFrame | None = logs.frames.get(at)
    if frame is None and logs.estimate is not None:
        frame = logs.estimate.frames.get(at)
    if frame is None:
        return None
    measured = frame if isinstance(frame, FrameTruth) else None
    place = frame.position_ned
    return ShownTruth(
        north=_known(2, place and place[0]),
        east=_known(2, place and place[1]),
        yaw=_known(1, frame.yaw_deg),
        distance=_known(2, frame.distance_m),
        box=_known(2, measured.distance_box_m if measured else None),
        visible=frame.visible,
        share=_known(3, measured.visible_fraction if measured else None),
        bearing=_known(1, measured.bearing_deg if measured else None),
        depth=_known(2, measured.oracle_depth_m if measured else None),
        qualifies=qualifies(decision, logs, flown.delta_m, flown.cap_s),
    )


def _trace(drone: int, poses: Sequence[Pose | EstimatedPose]) -> ShownTrace:
    own = sorted((pose for pose in poses if pose.drone == drone), key=lambda pose: pose.t)
    return ShownTrace(
        drone=drone,
        t=tuple(_to(2, pose.t) for pose in own),
        north=tuple(_to(2, pose.position_ned[0]) for pose in own),
        east=tuple(_to(2, pose.position_ned[1]) for pose in own),
        height=tuple(_to(1, -pose.position_ned[2]) for pose in own),
        yaw=tuple(_known(0, pose.yaw_deg) for pose in own),
        distance=tuple(_known(2, pose.distance_m) for pose in own),
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
        t=tuple(_to(2, t) for t in times),
        north=tuple(_to(2, seen[t][0]) for t in times),
        east=tuple(_to(2, seen[t][1]) for t in times),
    )


def _things(told: Any) -> tuple[ShownThing, ...]:
    """Return the look-alikes that a record tells of; one that cannot be placed is left out."""
    found = []
    for each in told if isinstance(told, list) else ():
        place = each.get("position_ned") if isinstance(each, dict) else None
        if isinstance(place, list) and len(place) == 3 and all(isinstance(x, int | float) for x in place):
            found.append(ShownThing(name=_named(each), north=float(place[0]), east=float(place[1])))
    return tuple(found)


def _named(told: Any) -> str:
    """Return a thing of a record in a few words."""
    if not isinstance(told, dict):
        return ""
    words = [str(told[key]) for key in ("paint", "asset", "native") if isinstance(told.get(key), str)]
    inscription = told.get("inscription")
    return " ".join([*words, *([f"“{inscription}”"] if inscription else [])])


def _end(flown: RecordedFlight, poses: Sequence[Pose | EstimatedPose]) -> float:
    times = [*(pose.t for pose in poses), *(decision.t_decided for decision in flown.logs.decisions)]
    return max(times, default=CAP_S)


def _known(digits: int, value: float | None) -> float | None:
    return None if value is None else _to(digits, value)


def _to(digits: int, value: float) -> float:
    """Return a number rounded, and whole where it is: 3 is shorter than 3.0 a million times over."""
    rounded = round(float(value), digits)
    return int(rounded) if rounded == int(rounded) else rounded
