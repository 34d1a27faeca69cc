"""One flight as ULog, for PlotJuggler and pyulog: made of tlog and logs, not of the log on board.

Topics and fields are PX4's, NED and FRD, times the vehicle's µs since boot. What the judge knew is in PX4's own topics
for it, `…_groundtruth`, and in `judge_target` and `judge_declaration`; places of both are in the map's frame.
"""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from autopilot.logging import ulog
from dronecats import __version__
from dronecats.judge.judged_flight import FlightStep
from dronecats.report.export.conventions import JUDGE, Array, about, judged, microseconds
from dronecats.report.recorded.flight import RecordedFlight
from dronecats.report.recorded.tracks import FlightTrack
from foundation.frames import quat_yaw
from foundation.protocol import FINISHED, GO, ROTATE, THINK
from foundation.run_folder.rows import drone_label

VALID = ";bool xy_valid;bool z_valid;bool v_xy_valid;bool v_z_valid;bool xy_global"
PLACE = "float x;float y;float z;float vx;float vy;float vz;float heading;double ref_lat;double ref_lon;float ref_alt"
FIELDS = {  # topic → its fields behind `uint64_t timestamp`
    "vehicle_local_position": PLACE + VALID,
    "vehicle_attitude": "float[4] q",
    "trajectory_setpoint": "float[3] position;float[3] velocity;float yaw;float yawspeed",
    "agent_decision": "uint32_t step;uint32_t frame_id;uint64_t timestamp_frame;float point_x;float point_y;"
    "float depth_m;float angle_deg;float latency_s;uint8_t action",
    "vehicle_local_position_groundtruth": PLACE + VALID,
    "vehicle_attitude_groundtruth": "float[4] q",
    "judge_target": "float x;float y;float z",
    "judge_declaration": "uint32_t step;float distance_m;int8_t visible;int8_t qualifies",
}  # fmt: skip
ACTIONS = {None: 0, GO: 1, ROTATE: 2, THINK: 3, FINISHED: 4}  # agent_decision.action; 0: the reply held none
INFO, WARNING = 6, 4  # of syslog's severities


class Stamped(NamedTuple):
    """A sample or a text, and when it is."""

    t_s: float
    drone: int
    topic: str  # empty: a text
    values: tuple[Any, ...]


def write(flight: RecordedFlight, path: Path) -> int:
    """Write a flight; return how many samples and texts there are. Of a fleet each drone is an instance of a topic."""
    told = sorted(_samples(flight), key=lambda each: each.t_s)
    topics = sorted({(each.topic, each.drone) for each in told if each.topic}, key=lambda one: (one[1], one[0]))
    packers = {one: ulog.DataPacker(number, _fields(one[0])) for number, one in enumerate(topics)}
    parts = [ulog.header(flight.t0_us), ulog.information("sys_name", "DroneCATS")]
    parts += [ulog.information("ver_sw", __version__)]
    properties = {**about(flight), **judged(flight)}
    parts += [ulog.information(key.replace("/", "_"), value) for key, value in properties.items() if value]
    parts += [ulog.definition(name, _fields(name)) for name in sorted({name for name, _ in topics})]
    parts += [ulog.subscription(number, name, drone) for number, (name, drone) in enumerate(topics)]
    for t_s, drone, topic, values in told:
        at_us = flight.t0_us + microseconds(t_s)
        parts.append(packers[topic, drone].pack((at_us, *values)) if topic else ulog.text(values[0], at_us, values[1]))
    path.write_bytes(b"".join(parts))
    return len(told)


def _fields(name: str) -> str:
    return "uint64_t timestamp;" + FIELDS[name]


def _samples(flight: RecordedFlight) -> Iterator[Stamped]:
    for drone in flight.drone_tracks:
        if drone.estimate is not None:
            yield from _track(flight, drone.number, drone.estimate, "")
        if drone.truth is not None:
            yield from _track(flight, drone.number, drone.truth, "_groundtruth")
        for row in drone.setpoints if drone.setpoints is not None else ():
            yield Stamped(float(row[0]), drone.number, "trajectory_setpoint", _floats(row[1:]))
    yield Stamped(0.0, 0, "", (INFO, f"instruction: {flight.instruction}"))
    for step in flight.steps:
        yield from _decision(flight, step)
    yield from _judged(flight)


def _track(flight: RecordedFlight, drone: int, track: FlightTrack, suffix: str) -> Iterator[Stamped]:
    latitude, longitude, altitude = flight.origin or (math.nan,) * 3
    known = bool(np.isfinite(track.velocity_ned).all())
    for index, at in enumerate(track.t_s):
        w, x, y, z = (float(value) for value in track.attitude[index])
        moving = _floats(track.velocity_ned[index])
        place = (*_floats(track.position_ned[index]), *moving, quat_yaw((w, x, y, z)), latitude, longitude, altitude)
        valid = (True, True, known, known, flight.origin is not None)
        yield Stamped(float(at), drone, f"vehicle_local_position{suffix}", (*place, *valid))
        yield Stamped(float(at), drone, f"vehicle_attitude{suffix}", (w, x, y, z))


def _decision(flight: RecordedFlight, step: FlightStep) -> Iterator[Stamped]:
    said = step.decision
    angle_deg = (said.action or {}).get("angle_deg")
    point = (step.go.x, step.go.y, step.go.depth_m) if step.go else (math.nan,) * 3
    turn = float(angle_deg) if isinstance(angle_deg, int | float) else math.nan
    latency_s = math.nan if said.latency_s is None else said.latency_s
    frame_us = flight.t0_us + microseconds(said.t_frame)
    values = (said.step, said.frame_id, frame_us, *point, turn, latency_s, ACTIONS.get(said.kind, 0))
    yield Stamped(said.t_decided, said.drone, "agent_decision", values)
    reply = said.reply if isinstance(said.reply, str) else str(said.action)
    yield Stamped(
        said.t_decided,
        said.drone,
        "",
        (WARNING if said.error else INFO, f"{drone_label(said.drone)}, step {said.step}: {reply}"),
    )


def _judged(flight: RecordedFlight) -> Iterator[Stamped]:
    if flight.target_track is not None:
        for t_s, place in zip(flight.target_track.t_s, flight.target_track.position_ned, strict=True):
            yield Stamped(float(t_s), 0, "judge_target", _floats(place))
    for one in flight.all_declarations:
        distance_m = math.nan if one.distance_m is None else one.distance_m
        answers = (_answer(one.visible), _answer(one.qualifies(flight.delta_m)))
        yield Stamped(one.t, one.drone, "judge_declaration", (one.step, distance_m, *answers))
    yield Stamped(flight.end_s, 0, "", (INFO, f"{JUDGE}: {flight.verdict.outcome}"))


def _answer(known: bool | None) -> int:
    """Return 1 for yes, 0 for no, −1 where nobody knows."""
    return -1 if known is None else int(known)


def _floats(values: Array) -> tuple[float, ...]:
    return tuple(float(value) for value in values)
