"""Writes one flight as MCAP with Foxglove's own schemas. Needs the extra `export`.

Times are ns since the episode began, so viewers show dates in 1970. The frame `map` is ENU. The frame `drone_0` is the
body (FLU) at its estimated pose, `judge/drone_0` is the body at its true pose, and `drone_0/camera` is the camera
(right-down-forward).
"""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.ImageAnnotations_pb2 import ImageAnnotations
from foxglove_schemas_protobuf.KeyValuePair_pb2 import KeyValuePair
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.LocationFix_pb2 import LocationFix
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.Point3_pb2 import Point3
from foxglove_schemas_protobuf.Pose_pb2 import Pose as FoxglovePose
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.timestamp_pb2 import Timestamp
from mcap_protobuf.writer import Writer

from dronecats.report.export.conventions import (
    JUDGE,
    Array,
    about,
    camera_body,
    drone_name,
    enu,
    flu,
    judged,
    lon_lat_alt,
    named_tracks,
    nanoseconds,
    optical_in_flu,
    read_picture,
    reply_text,
    xyzw_flu_to_enu,
)
from dronecats.report.recorded.flight import RecordedFlight
from dronecats.report.recorded.tracks import DroneTracks, FlightTrack
from foundation.camera import CameraModel
from foundation.frames import Quat
from foundation.protocol import POINT_SPAN
from foundation.truth import Origin

MAP = "map"  # the root frame: ENU, with the map's origin
ESTIMATE_COLOR, JUDGE_COLOR = Color(r=0.24, g=0.54, b=0.82, a=1.0), Color(r=1.0, g=0.62, b=0.17, a=1.0)
RING_PX = 48.0  # diameter of the ring around a chosen point
TRAIL_S = 1.0  # s of vehicle time between two updates of a trail
BALL_M = 0.8  # m, diameter of the ball that marks a target


class TimedMessage(NamedTuple):
    """A message with its time and topic."""

    t_s: float
    topic: str
    message: Any


def write(flight: RecordedFlight, path: Path) -> int:
    """Write a flight; return the number of messages. Raises UsageError for a damaged picture."""
    ordered = sorted(messages(flight), key=lambda message: message.t_s)
    with path.open("wb") as file:
        writer = Writer(file)
        for sequence, (t_s, topic, message) in enumerate(ordered):
            time_ns = max(0, nanoseconds(t_s))  # MCAP's times are unsigned; the first picture may precede the episode
            writer.write_message(topic, message, log_time=time_ns, publish_time=time_ns, sequence=sequence)
        writer._writer.add_metadata("dronecats", about(flight))  # the wrapper has no method for metadata
        writer._writer.add_metadata(f"dronecats/{JUDGE}", judged(flight))
        writer.finish()
    return len(ordered)


def messages(flight: RecordedFlight) -> Iterator[TimedMessage]:
    """Yield all messages of a flight, topic by topic."""
    for drone in flight.drone_tracks:
        name = drone_name(drone.number)
        for body, track in named_tracks(drone):
            yield from _track(body, track, flight.origin)
        for t_s, camera in flight.camera_changes(drone.number):
            mounted = FrameTransform(
                timestamp=_stamp(t_s),
                parent_frame_id=camera_body(drone),
                child_frame_id=f"{name}/camera",
                translation=_vector(flu(camera.offset_frd)),
                rotation=_quaternion(optical_in_flu(camera)),
            )
            yield TimedMessage(t_s, "/tf", FrameTransforms(transforms=[mounted]))
        yield from _pictures(flight, drone)
    yield from _logs(flight)
    yield from _targets(flight)


def _track(name: str, track: FlightTrack, origin: Origin | None) -> Iterator[TimedMessage]:
    """Yield a drone's poses, geodetic positions and trail. `name` is also the name of the drone's frame."""
    judges = name.startswith(JUDGE)
    begin_s = float(track.t_s[0])
    yield _scene(begin_s, _body_arrow(begin_s, name, judges), judges)
    drawn_s = -TRAIL_S
    for index, at in enumerate(track.t_s):
        t_s, place, (w, x, y, z) = float(at), track.position_ned[index], map(float, track.attitude[index])
        pose = _pose(place, (w, x, y, z))
        turned = FrameTransform(
            timestamp=_stamp(t_s), parent_frame_id=MAP, child_frame_id=name, translation=_vector(enu(place)),
            rotation=pose.orientation,
        )  # fmt: skip
        yield TimedMessage(t_s, "/tf", FrameTransforms(transforms=[turned]))
        yield TimedMessage(t_s, f"/{name}/pose", PoseInFrame(timestamp=_stamp(t_s), frame_id=MAP, pose=pose))
        if origin is not None:
            lon, lat, alt = lon_lat_alt(origin, (float(place[0]), float(place[1]), float(place[2])))
            fix = LocationFix(timestamp=_stamp(t_s), frame_id=name, latitude=lat, longitude=lon, altitude=alt)
            yield TimedMessage(t_s, f"/{name}/location", fix)
        if t_s - drawn_s >= TRAIL_S or index == len(track) - 1:
            drawn_s = t_s
            places = track.position_ned[: index + 1 : _trail_stride(track)]
            yield _scene(t_s, _trail_line(t_s, f"{name}/trail", places, judges), judges)


def _trail_stride(track: FlightTrack) -> int:
    """Return n such that every n-th sample of a track gives a trail of about ten samples per second."""
    seconds = float(track.t_s[-1] - track.t_s[0])
    return max(1, int(len(track) / (10.0 * seconds))) if seconds > 0.0 else 1


def _pictures(flight: RecordedFlight, drone: DroneTracks) -> Iterator[TimedMessage]:
    """Yield a drone's pictures with their calibrations, and each decision at the time of its picture."""
    camera, sizes = f"{drone_name(drone.number)}/camera", {}
    for frame in (frame for frame in flight.frames if frame.drone == drone.number):
        jpeg = frame.jpeg.read_bytes()
        height, width = read_picture(frame.jpeg).shape[:2]
        sizes[frame.frame_id] = (width, height)
        image = CompressedImage(timestamp=_stamp(frame.t_s), frame_id=camera, data=jpeg, format="jpeg")
        yield TimedMessage(frame.t_s, f"/{camera}/image", image)
        calibration = _calibration(frame.t_s, camera, flight.camera, width, height)
        yield TimedMessage(frame.t_s, f"/{camera}/calibration", calibration)
    for step in flight.steps:
        size, t_s = sizes.get(step.decision.frame_id), step.decision.t_frame
        if step.decision.drone != drone.number or size is None:
            continue
        point = (step.go.x / POINT_SPAN * size[0], step.go.y / POINT_SPAN * size[1]) if step.go else None
        words = f"step {step.decision.step}: {step.decision.kind or 'no action'}"
        yield TimedMessage(t_s, f"/{camera}/chosen", _ring(t_s, point, words))


def _logs(flight: RecordedFlight) -> Iterator[TimedMessage]:
    """Yield the instruction, every reply, the declarations and the verdict, as log messages."""

    def log(t_s: float, topic: str, name: str, text: str, level: Any = Log.INFO) -> TimedMessage:
        return TimedMessage(t_s, topic, Log(timestamp=_stamp(t_s), level=level, name=name, message=text))

    yield log(0.0, "/log", "instruction", flight.instruction)
    for decision in (step.decision for step in flight.steps):
        text = f"step {decision.step}: {reply_text(decision)}" + (f" ({decision.error})" if decision.error else "")
        level = Log.WARNING if decision.error else Log.INFO
        yield log(decision.t_decided, "/log", drone_name(decision.drone), text, level)
    for declaration in flight.all_declarations:
        text = f"declaration of step {declaration.step} at {declaration.distance_m} m, in view: {declaration.visible}"
        yield log(declaration.t, f"/{JUDGE}/log", f"{JUDGE}/{drone_name(declaration.drone)}", text)
    verdict = ", ".join(f"{key.removeprefix(f'{JUDGE}/')} {value}" for key, value in judged(flight).items())
    yield log(flight.end_s, f"/{JUDGE}/log", JUDGE, verdict)


def _targets(flight: RecordedFlight) -> Iterator[TimedMessage]:
    """Yield the target's positions (only the first if it does not move) and the positions of the declarations."""
    track = flight.target_track
    if track is not None:
        for index in range(len(track) if track.moves() else 1):
            t_s = float(track.t_s[index])
            yield _scene(t_s, _ball(t_s, f"{JUDGE}/target", track.position_ned[index], BALL_M, {}), True)
    for declaration in flight.all_declarations:
        truth = flight.drone_tracks[declaration.drone].truth
        if truth is not None:
            metadata = {name: getattr(declaration, name) for name in ("step", "distance_m", "visible")}
            place = truth.position_ned[truth.newest(declaration.t)]
            name = f"{JUDGE}/declaration/{declaration.step}"
            yield _scene(declaration.t, _ball(declaration.t, name, place, BALL_M / 2, metadata), True)


def _calibration(t_s: float, camera: str, model: CameraModel, width: int, height: int) -> CameraCalibration:
    """Return the calibration of a pinhole camera for pictures of `width` × `height` pixels."""
    fx, fy = model.focal_px * width / model.width, model.focal_px * height / model.height
    cx, cy = width / 2.0, height / 2.0
    return CameraCalibration(
        timestamp=_stamp(t_s),
        frame_id=camera,
        width=width,
        height=height,
        distortion_model="plumb_bob",
        D=[0.0] * 5,
        K=[fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
        R=[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        P=[fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
    )


def _ring(t_s: float, point_px: tuple[float, float] | None, words: str) -> ImageAnnotations:
    """Return an annotation: a ring around the chosen point, if any, and the decision as text."""
    note = ImageAnnotations(timestamp=_stamp(t_s))
    text = note.texts.add(timestamp=_stamp(t_s), text=words, font_size=20.0, text_color=ESTIMATE_COLOR)
    text.position.x, text.position.y = 12.0, 28.0
    if point_px is not None:
        circle = note.circles.add(
            timestamp=_stamp(t_s), diameter=RING_PX, thickness=4.0, outline_color=ESTIMATE_COLOR
        )  # fmt: skip
        circle.position.x, circle.position.y = point_px
    return note


def _scene(t_s: float, entity: SceneEntity, judges: bool) -> TimedMessage:
    return TimedMessage(t_s, f"/{JUDGE}/scene" if judges else "/scene", SceneUpdate(entities=[entity]))


def _trail_line(t_s: float, name: str, places_ned: Array, judges: bool) -> SceneEntity:
    """Return a drone's path as a line in the map's frame."""
    line = LinePrimitive(type=LinePrimitive.LINE_STRIP, thickness=2.0, scale_invariant=True, color=_color(judges))
    line.points.extend(Point3(x=x, y=y, z=z) for x, y, z in enu(places_ned))
    line.pose.orientation.w = 1.0
    return SceneEntity(timestamp=_stamp(t_s), frame_id=MAP, id=name, lines=[line])


def _ball(t_s: float, name: str, place_ned: Array, diameter_m: float, metadata: Mapping[str, Any]) -> SceneEntity:
    """Return a ball in the judge's colour at a position, with metadata."""
    entity = SceneEntity(timestamp=_stamp(t_s), frame_id=MAP, id=name)
    ball = entity.spheres.add(color=JUDGE_COLOR, size=Vector3(x=diameter_m, y=diameter_m, z=diameter_m))
    ball.pose.CopyFrom(_pose(place_ned, (1.0, 0.0, 0.0, 0.0)))
    entity.metadata.extend(KeyValuePair(key=key, value=str(value)) for key, value in metadata.items())
    return entity


def _body_arrow(t_s: float, frame: str, judges: bool) -> SceneEntity:
    """Return an arrow at a drone's position that points along its nose."""
    entity = SceneEntity(timestamp=_stamp(t_s), frame_id=frame, id=frame, frame_locked=True)
    arrow = entity.arrows.add(shaft_length=0.5, shaft_diameter=0.12, head_length=0.3, head_diameter=0.3)
    arrow.color.CopyFrom(_color(judges))
    arrow.pose.orientation.w = 1.0
    return entity


def _stamp(t_s: float) -> Timestamp:
    """Return a time of the episode (s) as a Timestamp, exact to the microsecond."""
    seconds, nanos = divmod(nanoseconds(t_s), 1_000_000_000)
    return Timestamp(seconds=seconds, nanos=nanos)


def _pose(place_ned: Array, attitude: Quat) -> FoxglovePose:
    return FoxglovePose(position=_vector(enu(place_ned)), orientation=_quaternion(xyzw_flu_to_enu(attitude)))


def _vector(xyz: Array) -> Vector3:
    return Vector3(x=float(xyz[0]), y=float(xyz[1]), z=float(xyz[2]))


def _quaternion(xyzw: Quat) -> Quaternion:
    return Quaternion(x=xyzw[0], y=xyzw[1], z=xyzw[2], w=xyzw[3])


def _color(judges: bool) -> Color:
    return JUDGE_COLOR if judges else ESTIMATE_COLOR
