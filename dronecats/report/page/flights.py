"""Makes the data of one flight for the page: prompts, decisions and truth, step by step.

Times are in vehicle seconds since the episode began, positions in metres in the map's NED frame, headings in degrees
from north. Unknown fields are missing. Numbers are rounded to the digits that the page shows.
"""

import math
from collections.abc import Sequence
from typing import Any

from dronecats.judge.verdict import qualifies
from dronecats.report.page.pictures import PictureAddress
from dronecats.report.recorded.flight import RecordedFlight, action_of
from foundation.frames import Vec3
from foundation.protocol import CAP_S
from foundation.run_folder.prompts import SentPrompt, prompts_of, read_prompts
from foundation.run_folder.rows import Decision, EstimatedFrame, EstimatedPose, Exchange, FrameTruth, Pose, drone_label

PageObject = dict[str, Any]  # a JSON object of the page
Texts = dict[str, int]  # text → its index; drones of a fleet share replies, and successive prompts share parts


def fields(**values: Any) -> PageObject:
    """Return a JSON object without the fields that are None."""
    return {name: value for name, value in values.items() if value is not None}


def shown_flight(flight: RecordedFlight, picture: PictureAddress) -> PageObject:
    """Return a flight as JSON for the page. Raises UsageError if a log is damaged."""
    logs, camera = flight.logs, flight.camera
    poses: Sequence[Pose | EstimatedPose] = logs.poses if logs.true else flight.estimated_poses
    times = (*(pose.t for pose in poses), *(decision.t_decided for decision in logs.decisions))
    texts: Texts = {}
    prompts = read_prompts(flight.folder)
    answered = prompts_of(logs.decisions, prompts)
    commanded = {prompt.row.number: prompt.text for prompt in prompts if prompt.row.role == "commander"}
    steps = [_step(d, flight, answered.get((d.drone, d.step)), texts, picture) for d in logs.decisions]
    return fields(
        instruction=flight.instruction,
        named=_named(flight.record.get("target")),  # name of the target in a few words
        drones=1 + max((row.drone for row in (*logs.decisions, *poses)), default=0),
        estimated=not logs.true,  # True: no true positions were logged, positions are the autopilot's estimates
        delta=flight.delta_m,  # m, success radius
        end=_rounded(2, max(times, default=CAP_S)),  # s, end of the flight
        hfov=camera.hfov_deg,  # °
        aspect=camera.width / camera.height,  # of the pictures
        traces=[_trace(drone, poses) for drone in sorted({pose.drone for pose in poses})],
        path=_path(poses),
        candidates=_look_alikes(flight.record.get("candidates")),
        texts=list(texts),
        steps=steps,
        exchanges=[_exchange(exchange, commanded.get(exchange.number)) for exchange in flight.exchanges],
    )


def _step(
    decision: Decision, flight: RecordedFlight, prompt: SentPrompt | None, texts: Texts, picture: PictureAddress
) -> PageObject:
    """Return one decision of one drone. `reply`, `parts` and `history` are indices into the flight's texts."""

    def index(text: str) -> int:
        return texts.setdefault(text, len(texts))

    action = action_of(decision)
    return fields(
        step=decision.step,
        drone=decision.drone,
        frame=decision.frame_id,
        t=_rounded(2, decision.t_frame),  # s, time of the picture
        decided=_rounded(2, decision.t_decided),  # s, time of the decision
        action=decision.action,
        does=decision.action_words,  # the action in words
        says=None if action is None else action.line,  # the action in the prompt's compact form
        error=decision.error,
        reply=index(decision.reply) if isinstance(decision.reply, str) else None,
        # the parts of the prompt before and after the history
        parts=None if prompt is None else [index(part) for part in (prompt.head, prompt.tail)],
        history=None if prompt is None else index(prompt.changed),
        picture=picture(decision),  # address of the picture
        latency=_rounded(3, decision.latency_s),  # s
        tokens_in=decision.tokens_in,
        tokens_out=decision.tokens_out,
        thinking=decision.thinking or None,
        rate=_rounded(2, decision.rate_hz),  # Hz
        finish=decision.finish if isinstance(decision.finish, str) else None,
        mended=decision.mended if isinstance(decision.mended, tuple) else None,
        report=True if decision.report is True else None,
        confirmed_by=decision.confirmed_by if isinstance(decision.confirmed_by, int) else None,
        truth=_truth(decision, flight),
    )


def _exchange(exchange: Exchange, prompt: str | None) -> PageObject:
    """Return one question to a commander, with its answer and the orders in it."""
    return fields(
        number=exchange.number,
        asked=_rounded(2, exchange.t_asked),  # s, time of the question
        answered=_rounded(2, exchange.t_answered),  # s, time of the answer
        causes=[cause.why if cause.drone is None else f"{cause.why} of {drone_label(cause.drone)}"
                for cause in exchange.causes],
        orders=[f"{drone_label(order.drone).capitalize()}: {order.goal}" for order in exchange.orders],
        confirms=exchange.confirms,  # numbers of the drones whose reports the answer confirms
        error=exchange.error,
        latency=_rounded(3, exchange.latency_s),  # s
        tokens_in=exchange.tokens_in,
        tokens_out=exchange.tokens_out,
        model=exchange.model,
        reply=exchange.reply,
        prompt=prompt,
    )  # fmt: skip


def _truth(decision: Decision, flight: RecordedFlight) -> PageObject | None:
    """Return the true state at a frame, which only the judge knows; if none was logged, the estimated state."""
    at, logs = (decision.drone, decision.frame_id), flight.logs
    frame: FrameTruth | EstimatedFrame | None = logs.frames.get(at)
    if frame is None and logs.estimate is not None:
        frame = logs.estimate.frames.get(at)
    if frame is None:
        return None
    measured = frame if isinstance(frame, FrameTruth) else None
    place = frame.position_ned
    return fields(
        north=_rounded(2, place and place[0]),  # m
        east=_rounded(2, place and place[1]),  # m
        yaw=_rounded(1, frame.yaw_deg),  # °
        distance=_rounded(2, frame.distance_m),  # m, to the target's centre
        box=_rounded(2, measured.distance_box_m if measured else None),  # m, to the target's box
        visible=frame.visible,
        share=_rounded(3, measured.visible_fraction if measured else None),  # visible share, 0 … 1
        bearing=_rounded(1, measured.bearing_deg if measured else None),  # ° from the nose, + right
        depth=_rounded(2, measured.oracle_depth_m if measured else None),  # m, along the optical axis
        # whether the declaration is a success; missing: unknown, or not a declaration
        qualifies=qualifies(decision, logs, flight.delta_m, flight.cap_s),
    )


def _trace(drone: int, poses: Sequence[Pose | EstimatedPose]) -> PageObject:
    """Return the path of a drone, with a sample every half second. Unknown values are None."""
    own = sorted((pose for pose in poses if pose.drone == drone), key=lambda pose: pose.t)
    return {
        "drone": drone,
        "t": [_rounded(2, pose.t) for pose in own],  # s
        "north": [_rounded(2, pose.position_ned[0]) for pose in own],  # m
        "east": [_rounded(2, pose.position_ned[1]) for pose in own],  # m
        "height": [_rounded(1, -pose.position_ned[2]) for pose in own],  # m above the frame's origin
        "yaw": [_rounded(0, pose.yaw_deg) for pose in own],  # °
        "distance": [_rounded(2, pose.distance_m) for pose in own],  # m, to the target's centre
        "visible": [pose.visible for pose in own],  # whether the target was in view
    }


def _path(poses: Sequence[Pose | EstimatedPose]) -> PageObject | None:
    """Return the path of the target. It has one sample if the target does not move."""
    seen: dict[float, Vec3] = {pose.t: pose.target_ned for pose in poses if pose.target_ned is not None}
    if not seen:
        return None
    times = sorted(seen)
    first = seen[times[0]]
    if all(math.dist(first, place) < 0.05 for place in seen.values()):
        times = times[:1]
    return {
        "t": [_rounded(2, t) for t in times],  # s
        "north": [_rounded(2, seen[t][0]) for t in times],  # m
        "east": [_rounded(2, seen[t][1]) for t in times],  # m
    }


def _look_alikes(entries: Any) -> list[PageObject]:
    """Return the look-alikes that have a position (m). `entries`: the candidates in an episode record."""
    look_alikes = []
    for entry in entries if isinstance(entries, list) else ():
        place = entry.get("position_ned") if isinstance(entry, dict) else None
        if isinstance(place, list) and len(place) == 3 and all(isinstance(x, int | float) for x in place):
            look_alikes.append({"name": _named(entry), "north": float(place[0]), "east": float(place[1])})
    return look_alikes


def _named(entry: Any) -> str:
    """Return the name of a record's target or look-alike."""
    if not isinstance(entry, dict):
        return ""
    words = [str(entry[key]) for key in ("paint", "asset", "native") if isinstance(entry.get(key), str)]
    inscription = entry.get("inscription")
    return " ".join([*words, *([f"“{inscription}”"] if inscription else [])])


def _rounded(digits: int, value: float | None) -> float | None:
    """Return a rounded number, as an integer if possible: 3 is shorter than 3.0. None stays None."""
    if value is None:
        return None
    rounded = round(float(value), digits)
    return int(rounded) if rounded == int(rounded) else rounded
