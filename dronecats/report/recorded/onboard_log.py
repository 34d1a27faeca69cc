"""The log that an autopilot wrote itself, a ULog of PX4's topics. Needs pyulog."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from dronecats.report.recorded.tracks import FlightTrack
from foundation.errors import UsageError
from foundation.extras import is_installed
from foundation.frames import geodetic_to_ned
from foundation.run_folder import layout
from foundation.truth import Origin

Array = NDArray[np.float64]


def kept_ulog(folder: Path, drone: int = 0) -> Path | None:
    """Return the log that a drone's autopilot wrote on board; None where it was not kept, or pyulog is missing."""
    path = folder / layout.onboard_log_name(drone)
    return path if path.is_file() and is_installed("pyulog") else None


def ulog_topics(path: Path, *names: str) -> dict[str, dict[str, Any]]:
    """Return the columns of these topics of a ULog, those that it has. Raises UsageError when the file is none."""
    from pyulog import ULog

    try:
        return {d.name: d.data for d in reversed(ULog(str(path), list(names)).data_list)}  # instance 0 of each stays
    except OSError as error:
        raise UsageError(f"{path} cannot be read: {error.strerror}") from None
    except Exception as error:  # a damaged file raises errors of many classes in pyulog
        raise UsageError(f"{path} is no ULog: {type(error).__name__} {error}") from None


def estimated_track(path: Path, t0_us: int) -> FlightTrack | None:
    """Return the estimate, in the autopilot's local frame; None where the log holds none. Raises UsageError."""
    return _track(ulog_topics(path, "vehicle_local_position", "vehicle_attitude"), "", t0_us)


def true_track(path: Path, t0_us: int, map_origin: Origin) -> FlightTrack | None:
    """Return the truth that a simulated PX4 wrote, in the map's frame; None where it wrote none, as a real one.

    Raises UsageError when the file is no ULog.
    """
    topics = ulog_topics(path, "vehicle_local_position_groundtruth", "vehicle_attitude_groundtruth")
    track, place = _track(topics, "_groundtruth", t0_us), topics.get("vehicle_local_position_groundtruth")
    if track is None or place is None:
        return None
    first = geodetic_to_ned(*map_origin, *(float(place[name][-1]) for name in ("ref_lat", "ref_lon", "ref_alt")))
    return FlightTrack(track.t_s, track.position_ned + np.array(first), track.velocity_ned, track.attitude)


def _track(topics: dict[str, dict[str, Any]], suffix: str, t0_us: int) -> FlightTrack | None:
    place, turned = topics.get(f"vehicle_local_position{suffix}"), topics.get(f"vehicle_attitude{suffix}")
    if place is None or turned is None or len(turned["timestamp"]) < 2:
        return None
    names = ("x", "y", "z", "vx", "vy", "vz")
    rows = np.column_stack([place["timestamp"].astype(float), *(place[name] for name in names)])
    rows = rows[np.isfinite(rows).all(axis=1)]
    at_us = turned["timestamp"].astype(float)
    rows = rows[(rows[:, 0] >= at_us[0]) & (rows[:, 0] <= at_us[-1])]
    if not len(rows):
        return None
    turns = Rotation.from_quat(np.column_stack([turned[f"q[{k}]"] for k in (1, 2, 3, 0)]))
    attitude = Slerp(at_us, turns)(rows[:, 0]).as_quat()[:, [3, 0, 1, 2]]
    return FlightTrack((rows[:, 0] - t0_us) / 1e6, rows[:, 1:4], rows[:, 4:], attitude)
