"""Logs as a PX4 in our physics writes them on board, made of a flight's own tlog."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from autopilot.logging import ulog
from dronecats.flight.sitl.scenario import load_world, origin
from dronecats.view.film.track import DroneTrack, logged
from foundation.frames import Vec3
from foundation.run_folder import layout
from foundation.run_folder.reading import read

PLACE = (
    "uint64_t timestamp;float x;float y;float z;float vx;float vy;float vz;float heading;float eph;float epv;float evh;"
    "float evv;double ref_lat;double ref_lon;float ref_alt;uint8_t xy_global"
)
TURNED = "uint64_t timestamp;float[4] q"


def with_onboard_log(folder: Path, off: Vec3 = (0.0, 0.0, 0.0)) -> DroneTrack:
    """Write onboard.ulg into an episode's folder: its truth, and estimates that are off by so much (m).

    Return the true track.
    """
    map_origin = origin(load_world(str(folder / layout.EPISODE)))
    begin = read(folder).begin
    assert begin is not None
    track = logged(folder / layout.TLOG, begin.t0_us, map_origin)[0]
    topics = [(f"{name}{truth}", fields) for name, fields in (("vehicle_local_position", PLACE),
              ("vehicle_attitude", TURNED)) for truth in ("", "_groundtruth")]  # fmt: skip
    parts = [ulog.header(begin.t0_us), *(ulog.definition(*topic) for topic in topics)]
    parts += [ulog.subscription(number, name) for number, (name, _) in enumerate(topics)]
    packers = [ulog.DataPacker(number, fields) for number, (_, fields) in enumerate(topics)]
    velocity = np.gradient(track.position_ned, track.t, axis=0)
    headings = track.headings(track.t)
    for k, t in enumerate(track.t):
        at_us = begin.t0_us + round(float(t) * 1e6)
        x, y, z, w = track.attitude[k].as_quat()
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
