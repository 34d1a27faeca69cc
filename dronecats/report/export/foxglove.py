"""Foxglove's messages, made of what a flight holds: axes ENU and FLU, places in m, times since the episode began."""

from collections.abc import Iterable, Mapping
from typing import Any

from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
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

from dronecats.report.export.conventions import OPTICAL_IN_FLU, Array, enu, flu, nanoseconds, xyzw_flu_to_enu
from foundation.camera import CameraModel
from foundation.frames import Quat, Vec3

MAP = "map"  # the frame that everything is in: ENU, its origin the map's
OWN, JUDGES = Color(r=0.24, g=0.54, b=0.82, a=1.0), Color(r=1.0, g=0.62, b=0.17, a=1.0)
RING_PX = 48.0  # across, around a chosen point


def stamp(t_s: float) -> Timestamp:
    """Return a time of the episode, exact to the microsecond."""
    whole, rest = divmod(nanoseconds(t_s), 1_000_000_000)
    return Timestamp(seconds=whole, nanos=rest)


def transform(t_s: float, frame: str, place_ned: Array, attitude: Quat) -> FrameTransform:
    """Return where a body's frame is in the map's."""
    return FrameTransform(
        timestamp=stamp(t_s),
        parent_frame_id=MAP,
        child_frame_id=frame,
        translation=_vector(enu(place_ned)),
        rotation=_quaternion(xyzw_flu_to_enu(attitude)),
    )


def mounting(frame: str, camera: str, model: CameraModel) -> FrameTransform:
    """Return where a camera is on its body: optical axes, right-down-forward."""
    return FrameTransform(
        timestamp=stamp(0.0),
        parent_frame_id=frame,
        child_frame_id=camera,
        translation=_vector(flu(model.offset_frd)),
        rotation=_quaternion(OPTICAL_IN_FLU),
    )


def pose(t_s: float, place_ned: Array, attitude: Quat) -> PoseInFrame:
    """Return where a body is."""
    return PoseInFrame(timestamp=stamp(t_s), frame_id=MAP, pose=_pose(place_ned, attitude))


def image(t_s: float, camera: str, jpeg: bytes) -> CompressedImage:
    """Return a picture, its bytes as the pilot was shown them."""
    return CompressedImage(timestamp=stamp(t_s), frame_id=camera, data=jpeg, format="jpeg")


def calibration(t_s: float, camera: str, model: CameraModel, width: int, height: int) -> CameraCalibration:
    """Return a pinhole's calibration for pictures of this size in pixels."""
    fx, fy = model.focal_px * width / model.width, model.focal_px * height / model.height
    cx, cy = width / 2.0, height / 2.0
    return CameraCalibration(
        timestamp=stamp(t_s),
        frame_id=camera,
        width=width,
        height=height,
        distortion_model="plumb_bob",
        D=[0.0] * 5,
        K=[fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
        R=[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        P=[fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
    )


def ring(t_s: float, point_px: tuple[float, float] | None, words: str) -> ImageAnnotations:
    """Return a ring around the chosen point, none where none was chosen, and what was decided."""
    note = ImageAnnotations(timestamp=stamp(t_s))
    told = note.texts.add(timestamp=stamp(t_s), text=words, font_size=20.0, text_color=OWN)
    told.position.x, told.position.y = 12.0, 28.0
    if point_px is not None:
        circle = note.circles.add(timestamp=stamp(t_s), diameter=RING_PX, thickness=4.0, outline_color=OWN)
        circle.position.x, circle.position.y = point_px
    return note


def location(t_s: float, frame: str, lon_lat_alt: Vec3) -> LocationFix:
    """Return a place on earth, WGS84."""
    longitude, latitude, altitude = lon_lat_alt
    return LocationFix(timestamp=stamp(t_s), frame_id=frame, latitude=latitude, longitude=longitude, altitude=altitude)


def log(t_s: float, who: str, words: str, wrong: bool = False) -> Log:
    """Return a line of the log."""
    return Log(timestamp=stamp(t_s), level=Log.WARNING if wrong else Log.INFO, name=who, message=words)


def trail(t_s: float, id: str, places_ned: Array, judges: bool) -> SceneEntity:
    """Return the way that was flown, as a line in the map's frame."""
    line = LinePrimitive(type=LinePrimitive.LINE_STRIP, thickness=2.0, scale_invariant=True, color=_color(judges))
    line.points.extend(Point3(x=x, y=y, z=z) for x, y, z in enu(places_ned))
    line.pose.orientation.w = 1.0
    return _entity(t_s, id, MAP, lines=[line])


def ball(t_s: float, id: str, place_ned: Array, across_m: float, judges: bool, told: Mapping[str, Any]) -> SceneEntity:
    """Return a ball at a place, with what is told of it."""
    entity = _entity(t_s, id, MAP)
    one = entity.spheres.add(color=_color(judges), size=Vector3(x=across_m, y=across_m, z=across_m))
    one.pose.CopyFrom(_pose(place_ned, (1.0, 0.0, 0.0, 0.0)))
    entity.metadata.extend(KeyValuePair(key=key, value=str(value)) for key, value in told.items())
    return entity


def body(t_s: float, frame: str, judges: bool) -> SceneEntity:
    """Return an arrow that is where a drone is, and points where its nose does."""
    entity = _entity(t_s, frame, frame)
    entity.frame_locked = True
    arrow = entity.arrows.add(shaft_length=0.5, shaft_diameter=0.12, head_length=0.3, head_diameter=0.3)
    arrow.color.CopyFrom(_color(judges))
    arrow.pose.orientation.w = 1.0
    return entity


def scene(entities: Iterable[SceneEntity]) -> SceneUpdate:
    """Return an update of the scene."""
    return SceneUpdate(entities=list(entities))


def _entity(t_s: float, id: str, frame: str, **parts: Any) -> SceneEntity:
    return SceneEntity(timestamp=stamp(t_s), frame_id=frame, id=id, **parts)


def _pose(place_ned: Array, attitude: Quat) -> FoxglovePose:
    return FoxglovePose(position=_vector(enu(place_ned)), orientation=_quaternion(xyzw_flu_to_enu(attitude)))


def _vector(xyz: Array) -> Vector3:
    return Vector3(x=float(xyz[0]), y=float(xyz[1]), z=float(xyz[2]))


def _quaternion(xyzw: Quat) -> Quaternion:
    return Quaternion(x=xyzw[0], y=xyzw[1], z=xyzw[2], w=xyzw[3])


def _color(judges: bool) -> Color:
    return JUDGES if judges else OWN
