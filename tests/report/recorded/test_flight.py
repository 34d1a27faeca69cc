"""Tests flights that film, replay, export and the post-flight estimate used to read differently."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from dronecats.report.afterflight import derive
from dronecats.report.export.conventions import about
from dronecats.report.recorded.flight import RecordedFlight
from dronecats.view.replay.moments import flight_moments
from episodes import maps
from foundation.frames import quat_from_euler, quat_yaw
from foundation.mavlink import Packer, dialect
from foundation.run_folder import layout
from foundation.run_folder.reading import estimate
from foundation.run_folder.writing import TelemetryLog
from foundation.truth import TRUTH_COMPONENT, truth_message
from tests.support.json_lines import rows
from tests.support.run_folders import lines, measured, run_folder

EPISODE, FLEET = "residential-approaching-77", "residential-commanding-77"
T0_US = 5  # the start time that `run_folder` writes


def flight_folder(tmp_path: Path, name: str = EPISODE, **settings) -> Path:
    return run_folder(tmp_path / "run", {name: "go there"}, **settings) / name


def change(path: Path, how) -> None:
    """Rewrite the rows of a log. `how` returns None for a row to omit."""
    lines(path, [changed for row in rows(path) if (changed := how(row)) is not None])


def truth_frame(system: int, t: float) -> bytes:
    """Return a truth bus message with the pose that `measured` gives to that system's drone."""
    scene = maps.build("residential", 1)
    origin = (scene.latitude_deg, scene.longitude_deg, scene.altitude_m)
    place = measured(t, system - 1)["position_ned"]
    message = truth_message(
        round(t * 1e6) + T0_US, place, (1.3, 0.0, 0.0), quat_from_euler(0.1, 0.0, math.radians(5.0)), (0.0, 0.0, 0.0),
        (0.0, 0.0, 0.0), origin,
    )  # fmt: skip
    return Packer(system, TRUTH_COMPONENT).pack(message)


def test_a_drone_without_telemetry_does_not_get_the_track_of_the_next_drone(tmp_path):
    """The export used to count systems. Without the second system, the second drone got the third drone's track."""
    folder = flight_folder(tmp_path, FLEET, drones=3)
    log = TelemetryLog(folder / layout.TLOG)
    for k in range(40):
        for system in (1, 3):
            log.write(0, truth_frame(system, 0.2 * k))
    log.close()
    flight = RecordedFlight.read(folder)
    for drone in (0, 1, 2):
        track = flight.drone_tracks[drone].truth
        assert track is not None
        assert track.level is (drone == 1)
        east = track.position_ned[:, 1]
        np.testing.assert_allclose(east, 2.0 * drone, atol=0.02)
        place = measured(3.0, drone)["position_ned"]
        assert flight.tracks[drone].at(3.0).position_ned == pytest.approx(place, abs=0.03)


def test_a_row_without_a_heading_keeps_the_last_heading(tmp_path):
    """Films and replays used to turn the drone to the north at such a row."""
    folder = flight_folder(tmp_path, "nowhere-approaching-77")
    change(folder / layout.TRUTH, lambda row: {**row, "yaw_deg": None} if row["kind"] == "frame" else row)
    track = RecordedFlight.read(folder).tracks[0]
    headings = [math.degrees(quat_yaw(track.at(t).attitude)) for t in np.arange(1.0, 12.0, 0.1)]
    assert headings == pytest.approx([5.0] * len(headings), abs=1e-6)


def test_a_flight_without_a_record_has_the_instruction_of_its_run(tmp_path):
    """Exports and films used to omit the instruction."""
    folder = flight_folder(tmp_path)
    (folder / layout.EPISODE).unlink()
    configuration = json.loads((folder.parent / layout.RUN).read_text())
    configuration["flight"]["instruction"] = "go to the church"
    (folder.parent / layout.RUN).write_text(json.dumps(configuration))
    assert about(RecordedFlight.read(folder))["instruction"] == "go to the church"


@pytest.mark.parametrize(
    ("announced", "camera"),
    [
        ({"width": 640, "height": 480, "hfov_deg": 60.0}, (640, 480, 60.0)),
        ({"hfov_deg": 60.0}, (1280, 720, 60.0)),
        ({"width": "wide"}, (1280, 720, 90.0)),
        (None, (1280, 720, 90.0)),
    ],
)
def test_the_camera_is_the_one_in_run_json(tmp_path, announced, camera):
    """Films and drawn views used the benchmark's camera. So did replays if run.json had only a part of the camera."""
    flight = RecordedFlight.read(flight_folder(tmp_path, camera=announced))
    assert (flight.camera.width, flight.camera.height, flight.camera.hfov_deg) == camera


def test_a_killed_flight_ends_with_the_last_row_of_any_log(tmp_path):
    """Films used to end with the last pose. The post-flight estimate ended at once: such a flight has no pose."""
    folder = flight_folder(tmp_path, steps=2)
    change(folder / layout.TRUTH, lambda row: row if row["kind"] == "begin" or row.get("t", 99.0) < 2.0 else None)
    assert RecordedFlight.read(folder).end_s == rows(folder / layout.DECISIONS)[-1]["t_decided"] == 3.2

    change(folder / layout.TRUTH, lambda row: {**row, "source": "estimate"} if row["kind"] == "begin" else None)
    log, autopilot = TelemetryLog(folder / layout.TLOG), Packer(1, 1)
    for k in range(60):
        place = dialect.MAVLink_local_position_ned_message(100 * k, 0.1 * k, 0.0, -2.0, 1.0, 0.0, 0.0)
        log.write(0, autopilot.pack(place))
    log.close()
    derive(folder)
    trace = estimate(folder)
    assert trace is not None
    assert [pose.t for pose in trace.poses] == [0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0]


def test_a_setpoint_that_arrives_after_a_newer_one_is_not_the_newest(tmp_path):
    """Replays used to show the late setpoint."""
    folder = flight_folder(tmp_path)
    log, autopilot = TelemetryLog(folder / layout.TLOG), Packer(1, 1)
    for time_ms, north in ((1000, 0.1), (1200, 0.2), (1100, 0.3), (2000, 0.4)):
        log.write(0, autopilot.pack(dialect.MAVLink_local_position_ned_message(time_ms, 0, 0, -2, 0, 0, 0)))
        log.write(0, autopilot.pack(dialect.MAVLink_position_target_local_ned_message(
            time_ms, 1, 0, 0, 0, 0, north, 0, 0, 0, 0, 0, 0, 0)))  # fmt: skip
    log.close()
    moments = flight_moments(folder)
    assert moments.moment(1.5).drones[0].setpoint_ned == pytest.approx((0.2, 0.0, 0.0))
    assert moments.moment(2.5).drones[0].setpoint_ned == pytest.approx((0.4, 0.0, 0.0))


def test_the_later_of_two_decisions_on_one_picture_is_the_newest(tmp_path):
    """A commander's confirmation is a new decision on an earlier image. Films used to show the first decision."""
    folder = flight_folder(tmp_path, steps=2)
    change(folder / layout.DECISIONS, lambda row: {**row, "frame_id": 0, "t_frame": 0.1})
    newest = RecordedFlight.read(folder).latest_decision(0, 1.0, "t_frame")
    assert newest is not None
    assert newest.step == 1


def test_a_resumed_tlog_is_read_before_and_after_its_torn_frame(tmp_path):
    folder = flight_folder(tmp_path)
    path = folder / layout.TLOG
    for first, last in ((0, 20), (20, 40)):  # the second half is written after a kill in the middle of a frame
        log = TelemetryLog(path)
        for k in range(first, last):
            log.write(1_700_000_000_000_000 + k, truth_frame(1, 0.2 * k))
        log.close()
        if first == 0:
            path.write_bytes(path.read_bytes()[:-30])
    track = RecordedFlight.read(folder).true_tracks[0]
    assert not track.level
    assert 38 <= len(track) <= 39  # lost: the torn frame, and the frame that its length field covers
    assert track.t_s[-1] == pytest.approx(7.8)
