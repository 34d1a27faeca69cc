"""Converts the project's names, frames and units to those of the export formats.

The project uses NED metres in the map's frame, attitudes (w, x, y, z) that rotate FRD into NED, and seconds of vehicle
time since the episode began. Foxglove, Rerun and ROS (REP 103) use right-handed axes with z up: ENU metres, bodies FLU
(forward, left, up), cameras right-down-forward, quaternions in the order x, y, z, w.
"""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from dronecats.report.recorded.flight import RecordedFlight
from dronecats.report.recorded.tracks import DroneTracks, FlightTrack
from foundation.camera import CameraModel
from foundation.errors import UsageError
from foundation.frames import Quat, Vec3, ned_to_geodetic, quat_multiply
from foundation.run_folder.rows import Decision

Array = NDArray[np.float64]

_ENU_OF_NED = (0.0, math.sqrt(0.5), math.sqrt(0.5), 0.0)  # rotation of 180° about the axis between north and east
_FRD_OF_FLU = (0.0, 1.0, 0.0, 0.0)  # rotation of 180° about the forward axis
JUDGE = "judge"  # prefix of data that only the judge has: true positions, targets, verdicts


def optical_in_flu(camera: CameraModel) -> Quat:
    """Return the rotation (x, y, z, w) from the camera's axes (right-down-forward) to the drone's body axes (FLU)."""
    half = math.radians(camera.pitch_deg) / 2.0  # pitch up is a negative rotation about the left axis
    w, x, y, z = quat_multiply((math.cos(half), 0.0, -math.sin(half), 0.0), (0.5, -0.5, 0.5, -0.5))
    return (x, y, z, w)


def enu(ned: Any) -> Array:
    """Return NED vectors (…, 3) as east, north, up."""
    vectors = np.asarray(ned, np.float64)
    return np.stack([vectors[..., 1], vectors[..., 0], -vectors[..., 2]], axis=-1)


def flu(frd: Any) -> Array:
    """Return FRD vectors (…, 3) as forward, left, up."""
    return np.asarray(frd, np.float64) * (1.0, -1.0, -1.0)


def xyzw_flu_to_enu(attitude: Quat) -> Quat:
    """Return the attitude that rotates FLU into ENU, in the order x, y, z, w with w ≥ 0."""
    w, x, y, z = quat_multiply(_ENU_OF_NED, quat_multiply(attitude, _FRD_OF_FLU))
    return (x, y, z, w) if w >= 0.0 else (-x, -y, -z, -w)


def nanoseconds(t_s: float) -> int:
    """Return seconds as integer nanoseconds, exact to the microsecond of the logs."""
    return round(t_s * 1e6) * 1000


def microseconds(t_s: float) -> int:
    return round(t_s * 1e6)


def lon_lat_alt(origin: Vec3, ned: Vec3) -> Vec3:
    """Return (longitude °, latitude °, m above mean sea level) of an NED position (m): the order of KML and GeoJSON.

    `origin` is the (latitude °, longitude °, altitude m) of the map's frame in WGS84. The projection is PX4's.
    """
    latitude, longitude, altitude = ned_to_geodetic(*origin, *ned)
    return (longitude, latitude, altitude)


def drone_name(number: int) -> str:
    """Return the name of a drone in the exported files."""
    return f"drone_{number}"


def named_tracks(drone: DroneTracks) -> Iterator[tuple[str, FlightTrack]]:
    """Yield (name, track) of a drone's estimated and true tracks, if any. Names of true tracks begin with `judge/`."""
    name = drone_name(drone.number)
    if drone.estimate is not None:
        yield name, drone.estimate
    if drone.truth is not None:
        yield f"{JUDGE}/{name}", drone.truth


def camera_body(drone: DroneTracks) -> str:
    """Return the name of the exported body that carries a drone's camera: the estimated one, or else the true one."""
    return drone_name(drone.number) if drone.estimate is not None else f"{JUDGE}/{drone_name(drone.number)}"


def reply_text(decision: Decision) -> str:
    """Return the reply of a decision; without a reply, its action as text."""
    return decision.reply if isinstance(decision.reply, str) else str(decision.action)


def read_picture(jpeg: Path) -> NDArray[np.uint8]:
    """Return a picture (h, w, 3), RGB. Raises UsageError when it is damaged."""
    picture = cv2.imread(str(jpeg), cv2.IMREAD_COLOR_RGB)
    if picture is None:
        raise UsageError(f"{jpeg} is damaged: it is not a picture")
    return np.asarray(picture, np.uint8)


def about(flight: RecordedFlight) -> dict[str, str]:
    """Return the names and settings of a flight's run and episode, as texts."""
    return {
        "run": flight.run.folder.resolve().name,
        "pilot": flight.run.pilot,
        "agent": flight.run.agent,
        "seed": str(flight.run.seed),
        "episode": flight.id,
        "map": flight.map,
        "cell": flight.cell,
        "instruction": flight.instruction,
    }


def judged(flight: RecordedFlight) -> dict[str, str]:
    """Return the verdict as texts. Each key begins with `judge/`."""
    verdict = flight.verdict
    values = {"outcome": verdict.outcome, "success": verdict.success, "ne_m": verdict.ne_m, "error": verdict.error}
    return {f"{JUDGE}/{key}": str(value) for key, value in values.items() if value is not None}
