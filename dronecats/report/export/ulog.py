"""Writes one flight as ULog, for PlotJuggler and pyulog. The estimates come from flight.tlog, not from onboard.ulg.

Topics and fields are PX4's (NED and FRD, times in µs since the vehicle's boot), except `agent_decision`, `judge_target`
and `judge_declaration`. The topics `judge_…` and PX4's topics `…_groundtruth` have data that the pilot never has. All
positions are in the map's frame.
"""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from autopilot.logging import ulog
from dronecats import __version__
from dronecats.judge.judged_flight import FlightStep
from dronecats.report.export.conventions import JUDGE, Array, about, judged, microseconds, named_tracks, reply_text
from dronecats.report.recorded.flight import RecordedFlight
from dronecats.report.recorded.tracks import FlightTrack
from foundation.frames import quat_yaw
from foundation.protocol import ACTIONS
from foundation.run_folder.rows import drone_label

VALID = ";bool xy_valid;bool z_valid;bool v_xy_valid;bool v_z_valid;bool xy_global"
PLACE = "float x;float y;float z;float vx;float vy;float vz;float heading;double ref_lat;double ref_lon;float ref_alt"
FIELDS = {  # topic → its fields after `uint64_t timestamp`
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
ACTION_NUMBERS = {name: number for number, name in enumerate(ACTIONS, 1)}  # agent_decision.action; 0: no action
INFO, WARNING = 6, 4  # syslog severities


class Stamped(NamedTuple):
    """A sample of a topic, or a text for the log, with its time and drone."""

    t_s: float
    drone: int
    topic: str  # empty for a text
    values: tuple[Any, ...]  # fields of the sample, or (syslog severity, text)


def write(flight: RecordedFlight, path: Path) -> int:
    """Write a flight; return the number of samples and texts. Each drone of a fleet has its own topic instances."""
    ordered = sorted(_samples(flight), key=lambda sample: sample.t_s)
    keys = sorted(
        {(sample.topic, sample.drone) for sample in ordered if sample.topic}, key=lambda key: (key[1], key[0])
    )
    packers = {key: ulog.DataPacker(number, _fields(key[0])) for number, key in enumerate(keys)}
    chunks = [ulog.header(flight.t0_us), ulog.information("sys_name", "DroneCATS")]
    chunks += [ulog.information("ver_sw", __version__)]
    properties = {**about(flight), **judged(flight)}
    chunks += [ulog.information(key.replace("/", "_"), value) for key, value in properties.items() if value]
    chunks += [ulog.definition(topic, _fields(topic)) for topic in sorted({topic for topic, _ in keys})]
    chunks += [ulog.subscription(number, topic, drone) for number, (topic, drone) in enumerate(keys)]
    for t_s, drone, topic, values in ordered:
        at_us = flight.t0_us + microseconds(t_s)
        chunks.append(packers[topic, drone].pack((at_us, *values)) if topic else ulog.text(values[0], at_us, values[1]))
    path.write_bytes(b"".join(chunks))
    return len(ordered)


def _fields(name: str) -> str:
    return "uint64_t timestamp;" + FIELDS[name]


def _samples(flight: RecordedFlight) -> Iterator[Stamped]:
    for drone in flight.drone_tracks:
        for name, track in named_tracks(drone):
            yield from _track(flight, drone.number, track, "_groundtruth" if name.startswith(JUDGE) else "")
        for row in drone.setpoints if drone.setpoints is not None else ():
            yield Stamped(float(row[0]), drone.number, "trajectory_setpoint", _floats(row[1:]))
    yield Stamped(0.0, 0, "", (INFO, f"instruction: {flight.instruction}"))
    for step in flight.steps:
        yield from _decision(flight, step)
    yield from _judged(flight)


def _track(flight: RecordedFlight, drone: int, track: FlightTrack, suffix: str) -> Iterator[Stamped]:
    latitude, longitude, altitude = flight.origin or (math.nan,) * 3
    velocity_known = bool(np.isfinite(track.velocity_ned).all())
    for index, at in enumerate(track.t_s):
        w, x, y, z = (float(value) for value in track.attitude[index])
        moving = _floats(track.velocity_ned[index])
        place = (*_floats(track.position_ned[index]), *moving, quat_yaw((w, x, y, z)), latitude, longitude, altitude)
        valid = (True, True, velocity_known, velocity_known, flight.origin is not None)
        yield Stamped(float(at), drone, f"vehicle_local_position{suffix}", (*place, *valid))
        yield Stamped(float(at), drone, f"vehicle_attitude{suffix}", (w, x, y, z))


def _decision(flight: RecordedFlight, step: FlightStep) -> Iterator[Stamped]:
    decision = step.decision
    angle_deg = (decision.action or {}).get("angle_deg")
    point = (step.go.x, step.go.y, step.go.depth_m) if step.go else (math.nan,) * 3
    turn = float(angle_deg) if isinstance(angle_deg, int | float) else math.nan
    latency_s = math.nan if decision.latency_s is None else decision.latency_s
    frame_us = flight.t0_us + microseconds(decision.t_frame)
    action = ACTION_NUMBERS.get(decision.kind or "", 0)
    values = (decision.step, decision.frame_id, frame_us, *point, turn, latency_s, action)
    yield Stamped(decision.t_decided, decision.drone, "agent_decision", values)
    yield Stamped(
        decision.t_decided,
        decision.drone,
        "",
        (
            WARNING if decision.error else INFO,
            f"{drone_label(decision.drone)}, step {decision.step}: {reply_text(decision)}",
        ),
    )


def _judged(flight: RecordedFlight) -> Iterator[Stamped]:
    if flight.target_track is not None:
        for t_s, place in zip(flight.target_track.t_s, flight.target_track.position_ned, strict=True):
            yield Stamped(float(t_s), 0, "judge_target", _floats(place))
    for declaration in flight.all_declarations:
        distance_m = math.nan if declaration.distance_m is None else declaration.distance_m
        answers = (_answer(declaration.visible), _answer(declaration.qualifies(flight.delta_m)))
        yield Stamped(declaration.t, declaration.drone, "judge_declaration", (declaration.step, distance_m, *answers))
    yield Stamped(flight.end_s, 0, "", (INFO, f"{JUDGE}: {flight.verdict.outcome}"))


def _answer(answer: bool | None) -> int:
    """Return 1 for yes, 0 for no, −1 for unknown."""
    return -1 if answer is None else int(answer)


def _floats(values: Array) -> tuple[float, ...]:
    return tuple(float(value) for value in values)
