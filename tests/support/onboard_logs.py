"""Writes the onboard log that a PX4 in this project's simulation writes, from the flight's own tlog."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from autopilot.logging import ulog
from dronecats.report.recorded.flight import RecordedFlight
from dronecats.report.recorded.tracks import FlightTrack
from foundation.frames import Vec3
from foundation.run_folder import layout

PLACE = (
    "uint64_t timestamp;float x;float y;float z;float vx;float vy;float vz;float heading;float eph;float epv;float evh;"
    "float evv;double ref_lat;double ref_lon;float ref_alt;uint8_t xy_global"
)
TURNED = "uint64_t timestamp;float[4] q"


def with_onboard_log(folder: Path, off: Vec3 = (0.0, 0.0, 0.0)) -> FlightTrack:
    """Write onboard.ulg into an episode's folder, and return the true track.

    The log has the true poses, and estimates whose position has the constant error `off` (m, NED).
    """
    flight = RecordedFlight.read(folder)
    map_origin, track = flight.map_origin, flight.tracks[0]
    assert map_origin is not None
    topics = [(f"{name}{truth}", fields) for name, fields in (("vehicle_local_position", PLACE),
              ("vehicle_attitude", TURNED)) for truth in ("", "_groundtruth")]  # fmt: skip
    parts = [ulog.header(flight.t0_us), *(ulog.definition(*topic) for topic in topics)]
    parts += [ulog.subscription(number, name) for number, (name, _) in enumerate(topics)]
    packers = [ulog.DataPacker(number, fields) for number, (_, fields) in enumerate(topics)]
    velocity = np.gradient(track.position_ned, track.t_s, axis=0)
    headings = track.headings(track.t_s)
    for k, t in enumerate(track.t_s):
        at_us = flight.t0_us + round(float(t) * 1e6)
        w, x, y, z = track.attitude[k]
        for packer, (name, _) in zip(packers, topics, strict=True):
            true = name.endswith("_groundtruth")
            place: Sequence[float] = track.position_ned[k] + (np.zeros(3) if true else np.array(off))
            row = (
                (at_us, w, x, y, z) if "attitude" in name
                else (at_us, *place, *velocity[k], headings[k], 0.5, 0.8, 0.1, 0.1, *map_origin, 1)
            )  # fmt: skip
            parts.append(packer.pack(row))
    (folder / layout.onboard_log_name()).write_bytes(b"".join(parts))
    return track
