"""Tracks of recorded drones, compared with independent readers of the same logs."""

import math
import shutil

import numpy as np
import pytest
from pymavlink import mavutil
from scipy.spatial.transform import Rotation

from dronecats.report.afterflight import derive
from dronecats.report.recorded.telemetry import telemetry
from dronecats.report.recorded.tracks import track_of_rows
from dronecats.view.film.plan import filmable
from foundation.frames import PX4_HOME
from foundation.mavlink import Packer, dialect
from foundation.run_folder import layout
from foundation.run_folder.reading import estimate, read
from foundation.truth import TRUTH_COMPONENT, truth_message
from tests.support.onboard_logs import with_onboard_log


@pytest.fixture(scope="module")
def messages(flight_folder):
    """The truth of the flight, as pymavlink reads it: [(time in µs, attitude)]."""
    log, samples = mavutil.mavlink_connection(str(flight_folder / layout.TLOG), dialect="development"), []
    while (message := log.recv_match(type="HIL_STATE_QUATERNION")) is not None:
        samples.append((message.time_usec, message.attitude_quaternion))
    return samples


def angle_deg(a, b):
    """Return the angle between two attitudes, each (w, x, y, z)."""
    same = abs(float(np.dot(a, b) / np.linalg.norm(a) / np.linalg.norm(b)))
    return math.degrees(2.0 * math.acos(min(1.0, same)))


def test_vehicles_with_and_without_truth_have_separate_numbers(tmp_path):
    """System 1 is on the truth bus, system 2 sends only its estimate."""
    truth = truth_message(
        1_000_000, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), (0.0,) * 3, (0.0,) * 3, PX4_HOME
    )
    estimate = dialect.MAVLink_local_position_ned_message(1000, 7.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    log = tmp_path / layout.TLOG
    frames = Packer(1, TRUTH_COMPONENT).pack(truth), Packer(2, dialect.MAV_COMP_ID_AUTOPILOT1).pack(estimate)
    log.write_bytes(b"".join((1_000_000).to_bytes(8, "big") + frame for frame in frames))
    drones = telemetry(log, 0)
    assert sorted(drones) == [0, 1]
    assert drones[1].places[0][1] == 7.0
    assert len(drones[0].places) == 0


def test_track_positions_equal_truth_jsonl(flight_folder, flight):
    logs, track = flight.logs, flight.tracks[0]
    places = [(each.t, each.position_ned) for each in logs.poses]
    places += [(each.t, each.position_ned) for each in logs.frames.values() if each.position_ned]
    assert len(places) > 12
    assert max(math.dist(track.at(t).position_ned, place) for t, place in places) < 0.05
    assert not track.level


def test_attitudes_equal_the_log_and_are_interpolated_evenly(flight_folder, flight, messages):
    begin_us, track = flight.t0_us, flight.tracks[0]
    during = [(us, q) for us, q in messages if us >= begin_us]
    assert len(during) > 250
    turned = 0.0
    for (us, q), (next_us, next_q) in zip(during[:-1:7], during[1::7], strict=False):
        t, halfway = (us - begin_us) / 1e6, (us + next_us) / 2e6 - begin_us / 1e6
        assert angle_deg(track.at(t).attitude, q) < 1e-3
        middle = track.at(halfway).attitude
        assert angle_deg(middle, q) == pytest.approx(angle_deg(middle, next_q), abs=1e-3)
        turned = max(turned, angle_deg(q, next_q))
    assert turned > 0.05  # it turns, so the attitude halfway is a different one


def test_without_a_tlog_the_track_is_level_and_passes_the_logged_poses(flight_folder, tmp_path):
    logs = read(flight_folder)
    assert telemetry(tmp_path / layout.TLOG, 0) == {}
    rows = track_of_rows(logs.poses)
    assert rows
    track = rows.drawn()
    assert track.level
    for pose in logs.poses:
        assert math.dist(track.at(pose.t).position_ned, pose.position_ned) < 0.06
        w, x, y, z = track.at(pose.t).attitude
        roll, pitch, yaw = Rotation.from_quat([x, y, z, w]).as_euler("xyz", degrees=True)
        assert abs(roll) < 1e-6
        assert abs(pitch) < 1e-6
        assert abs((yaw - pose.yaw_deg + 180.0) % 360.0 - 180.0) < 2.0


def test_the_track_is_constant_before_the_first_and_after_the_last_sample(flight_folder):
    rows = track_of_rows(read(flight_folder).poses)
    assert rows
    track = rows.drawn()
    assert track.at(-5.0) == track.at(float(track.t_s[0]))
    assert track.at(1e6) == track.at(float(track.t_s[-1]))


def test_without_a_tlog_the_attitude_comes_from_the_log_on_board(flight_folder, tmp_path):
    folder = tmp_path / flight_folder.parent.name / flight_folder.name
    shutil.copytree(flight_folder.parent, folder.parent)
    true = with_onboard_log(folder)
    (folder / layout.TLOG).unlink()
    track = filmable(folder).tracks[0]
    assert not track.level
    for t in np.arange(0.1, float(true.t_s[-1]) - 0.1, 0.31):
        assert math.dist(track.at(t).position_ned, true.at(t).position_ned) < 0.01
        assert angle_deg(track.at(t).attitude, true.at(t).attitude) < 0.1
    torn = folder / layout.onboard_log_name()
    torn.write_bytes(torn.read_bytes()[:40])
    assert filmable(folder).tracks[0].level


def test_the_estimate_comes_from_the_log_on_board_if_it_exists(flight_folder, tmp_path):
    folder = tmp_path / flight_folder.parent.name / flight_folder.name
    shutil.copytree(flight_folder.parent, folder.parent)
    derive(folder)
    trace = estimate(folder)
    assert trace is not None
    assert trace.head.source == layout.TLOG
    with_onboard_log(folder, off=(7.0, 0.0, 0.0))
    derive(folder)
    trace = estimate(folder)
    assert trace is not None
    assert trace.head.source == layout.onboard_log_name()
    true = {pose.t: pose.position_ned for pose in read(folder).poses}
    north = [pose.position_ned[0] - true[round(pose.t, 6)][0] for pose in trace.poses if round(pose.t, 6) in true]
    assert north
    assert np.median(north) == pytest.approx(7.0, abs=0.2)
