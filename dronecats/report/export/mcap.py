"""One flight as MCAP with Foxglove's own schemas, for Foxglove and whatever else reads it. Needs the extra `export`.

Times are ns since the episode began, so that it begins at 1970. The frame `map` is ENU; `drone_0` is the body (FLU) as
its autopilot thought, `judge/drone_0` as it truly was, `drone_0/camera` the camera (right-down-forward).
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import cv2
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from mcap_protobuf.writer import Writer

from dronecats.report.export import foxglove
from dronecats.report.export.conventions import JUDGE, about, drone_name, judged, lon_lat_alt, nanoseconds
from dronecats.report.recorded.flight import RecordedFlight, SeenFrame
from dronecats.report.recorded.tracks import DroneTracks, FlightTrack
from foundation.errors import UsageError
from foundation.frames import Quat
from foundation.protocol import POINT_SPAN
from foundation.truth import Origin

TRAIL_S = 1.0  # s of vehicle time after which a trail is drawn anew
ACROSS_M = 0.8  # m, of the ball that stands for a target


class TimedMessage(NamedTuple):
    """A message, when it is and where it goes."""

    t_s: float
    topic: str
    message: Any


def write(flight: RecordedFlight, path: Path) -> int:
    """Write a flight; return how many messages there are. Raises UsageError where a picture cannot be read."""
    told = sorted(messages(flight), key=lambda each: each.t_s)
    with path.open("wb") as file:
        writer = Writer(file)
        for sequence, (t_s, topic, message) in enumerate(told):
            at = nanoseconds(t_s)
            writer.write_message(topic, message, log_time=at, publish_time=at, sequence=sequence)
        writer._writer.add_metadata("dronecats", about(flight))  # the wrapper has no call of its own for it
        writer._writer.add_metadata(f"dronecats/{JUDGE}", judged(flight))
        writer.finish()
    return len(told)


def messages(flight: RecordedFlight) -> Iterator[TimedMessage]:
    """Yield all that a flight has to tell, topic by topic."""
    for drone in flight.drone_tracks:
        name = drone_name(drone.number)
        if drone.estimate is not None:
            yield from _track(name, name, drone.estimate, flight.origin)
        if drone.truth is not None:
            yield from _track(f"{JUDGE}/{name}", f"{JUDGE}/{name}", drone.truth, flight.origin)
        body = name if drone.estimate is not None else f"{JUDGE}/{name}"
        mounted = foxglove.mounting(body, f"{name}/camera", flight.camera)
        yield TimedMessage(0.0, "/tf", FrameTransforms(transforms=[mounted]))
        yield from _pictures(flight, drone)
    yield from _words(flight)
    yield from _target(flight)


def _track(name: str, frame: str, track: FlightTrack, origin: Origin | None) -> Iterator[TimedMessage]:
    """Yield a drone's poses, its places on earth, and its trail."""
    judges = name.startswith(JUDGE)
    scene = f"/{JUDGE}/scene" if judges else "/scene"
    yield TimedMessage(float(track.t_s[0]), scene, foxglove.scene([foxglove.body(float(track.t_s[0]), frame, judges)]))
    drawn_s = -TRAIL_S
    for index, at in enumerate(track.t_s):
        t_s, place, attitude = float(at), track.position_ned[index], _attitude(track, index)
        yield TimedMessage(t_s, "/tf", FrameTransforms(transforms=[foxglove.transform(t_s, frame, place, attitude)]))
        yield TimedMessage(t_s, f"/{name}/pose", foxglove.pose(t_s, place, attitude))
        if origin is not None:
            on_earth = lon_lat_alt(origin, (float(place[0]), float(place[1]), float(place[2])))
            yield TimedMessage(t_s, f"/{name}/location", foxglove.location(t_s, frame, on_earth))
        if t_s - drawn_s >= TRAIL_S or index == len(track) - 1:
            drawn_s = t_s
            trail = foxglove.trail(t_s, f"{name}/trail", track.position_ned[: index + 1 : _every(track)], judges)
            yield TimedMessage(t_s, scene, foxglove.scene([trail]))


def _every(track: FlightTrack) -> int:
    """Return which samples a trail is drawn through: ten a second are enough."""
    seconds = float(track.t_s[-1] - track.t_s[0])
    return max(1, int(len(track) / (10.0 * seconds))) if seconds > 0.0 else 1


def _pictures(flight: RecordedFlight, drone: DroneTracks) -> Iterator[TimedMessage]:
    """Yield a drone's pictures, each with its calibration, and what was decided on it when that was."""
    name = drone_name(drone.number)
    camera, sizes = f"{name}/camera", {}
    for frame in (frame for frame in flight.frames if frame.drone == drone.number):
        jpeg = frame.jpeg.read_bytes()
        width, height = sizes[frame.frame_id] = _size(frame)
        yield TimedMessage(frame.t_s, f"/{camera}/image", foxglove.image(frame.t_s, camera, jpeg))
        calibrated = foxglove.calibration(frame.t_s, camera, flight.camera, width, height)
        yield TimedMessage(frame.t_s, f"/{camera}/calibration", calibrated)
    for step in flight.steps:
        size = sizes.get(step.decision.frame_id)
        if step.decision.drone != drone.number or size is None:
            continue
        point = (step.go.x / POINT_SPAN * size[0], step.go.y / POINT_SPAN * size[1]) if step.go else None
        words = f"step {step.decision.step}: {step.decision.kind or 'no action'}"
        yield TimedMessage(
            step.decision.t_frame, f"/{camera}/chosen", foxglove.ring(step.decision.t_frame, point, words)
        )


def _size(frame: SeenFrame) -> tuple[int, int]:
    """Return width and height in pixels. Raises UsageError."""
    picture = cv2.imread(str(frame.jpeg), cv2.IMREAD_UNCHANGED)
    if picture is None:
        raise UsageError(f"{frame.jpeg} is damaged: it is no picture")
    return int(picture.shape[1]), int(picture.shape[0])


def _words(flight: RecordedFlight) -> Iterator[TimedMessage]:
    """Yield the instruction, every reply, and what the judge made of it."""
    yield TimedMessage(0.0, "/log", foxglove.log(0.0, "instruction", flight.instruction))
    for step in flight.steps:
        said = step.decision
        reply = said.reply if isinstance(said.reply, str) else str(said.action)
        words = f"step {said.step}: {reply}" + (f" ({said.error})" if said.error else "")
        yield TimedMessage(said.t_decided, "/log",
                    foxglove.log(said.t_decided, drone_name(said.drone), words, said.action is None))  # fmt: skip
    for one in flight.all_declarations:
        words = f"declaration of step {one.step} at {one.distance_m} m, in view: {one.visible}"
        yield TimedMessage(one.t, f"/{JUDGE}/log", foxglove.log(one.t, f"{JUDGE}/{drone_name(one.drone)}", words))
    verdict = ", ".join(f"{key.removeprefix(f'{JUDGE}/')} {value}" for key, value in judged(flight).items())
    yield TimedMessage(flight.end_s, f"/{JUDGE}/log", foxglove.log(flight.end_s, JUDGE, verdict))


def _target(flight: RecordedFlight) -> Iterator[TimedMessage]:
    """Yield where the target was, over and over where it moves, and where arrival was declared."""
    if flight.target_track is not None:
        for index in range(len(flight.target_track) if flight.target_track.moves() else 1):
            t_s, place = float(flight.target_track.t_s[index]), flight.target_track.position_ned[index]
            entity = foxglove.ball(t_s, f"{JUDGE}/target", place, ACROSS_M, True, {})
            yield TimedMessage(t_s, f"/{JUDGE}/scene", foxglove.scene([entity]))
    for one in flight.all_declarations:
        truth = flight.drone_tracks[one.drone].truth
        if truth is not None:
            told = {"step": one.step, "distance_m": one.distance_m, "visible": one.visible}
            place = truth.position_ned[truth.newest(one.t)]
            entity = foxglove.ball(one.t, f"{JUDGE}/declaration/{one.step}", place, ACROSS_M / 2, True, told)
            yield TimedMessage(one.t, f"/{JUDGE}/scene", foxglove.scene([entity]))


def _attitude(track: FlightTrack, index: int) -> Quat:
    w, x, y, z = (float(value) for value in track.attitude[index])
    return (w, x, y, z)
