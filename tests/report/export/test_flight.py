"""Tests flights read for export: the tracks of the drones, their frames, and the flights that are rejected."""

import shutil

import numpy as np
import pytest

from dronecats.report.export.formats import finished_flight
from dronecats.report.recorded.tracks import FlightTrack
from foundation.errors import UsageError
from foundation.frames import quat_yaw
from tests.report.export.conftest import ALONE


@pytest.mark.parametrize("which", ["alone", "fleet"])
def test_the_truth_track_has_every_position_of_the_logger(which, request):
    flight = request.getfixturevalue(which)
    rows = [*flight.logs.poses, *flight.logs.frames.values()]
    assert len(rows) > 40
    for row in rows:
        track = flight.drone_tracks[row.drone].truth
        index = track.newest(row.t)
        assert track.t_s[index] == pytest.approx(row.t, abs=2e-6)
        np.testing.assert_allclose(track.position_ned[index], row.position_ned, atol=1e-3)
        turned = np.degrees(quat_yaw(tuple(track.attitude[index]))) - row.yaw_deg
        assert (turned + 180.0) % 360.0 - 180.0 == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize("which", ["alone", "fleet"])
def test_the_autopilots_track_is_near_the_truth_but_not_equal(which, request):
    """Agreement is within GPS accuracy. A track in another local frame, or of another drone, is many metres off."""
    flight = request.getfixturevalue(which)
    for drone in flight.drone_tracks:
        there = drone.truth.position_ned[[drone.truth.newest(t) for t in drone.estimate.t_s]]
        off = np.linalg.norm((drone.estimate.position_ned - there)[:, :2], axis=1)
        assert off.max() < 3.0
        assert off.min() > 0.0
        ahead = np.array([quat_yaw(tuple(q)) for q in drone.estimate.attitude])
        true = np.array([quat_yaw(tuple(drone.truth.attitude[drone.truth.newest(t)])) for t in drone.estimate.t_s])
        assert np.abs((ahead - true + np.pi) % (2 * np.pi) - np.pi).max() < np.radians(10.0)


def test_velocity_integrates_to_the_change_of_position(alone):
    for track in (alone.drone_tracks[0].truth, alone.drone_tracks[0].estimate):
        moved = np.diff(track.position_ned, axis=0)
        mean = (track.velocity_ned[1:] + track.velocity_ned[:-1]) / 2 * np.diff(track.t_s)[:, None]
        np.testing.assert_allclose(moved.sum(axis=0), mean.sum(axis=0), atol=0.5)


def test_every_decision_has_its_picture(fleet):
    assert {(f.drone, f.frame_id) for f in fleet.frames} == {
        (s.decision.drone, s.decision.frame_id) for s in fleet.steps
    }
    assert [f.t_s for f in fleet.frames] == sorted(f.t_s for f in fleet.frames)


def test_a_missing_picture_is_an_error(run, tmp_path):
    shutil.copytree(run.folder / ALONE, tmp_path / ALONE)
    (tmp_path / ALONE / "frames" / "000002.jpg").unlink()
    with pytest.raises(UsageError, match=r"000002\.jpg"):
        finished_flight(tmp_path / ALONE)


def test_an_unfinished_episode_is_rejected(run, tmp_path):
    shutil.copytree(run.folder / ALONE, tmp_path / ALONE)
    truth = tmp_path / ALONE / "truth.jsonl"
    truth.write_text("".join(line for line in truth.open() if '"kind": "end"' not in line))
    with pytest.raises(UsageError, match=ALONE):
        finished_flight(tmp_path / ALONE)


def test_without_a_tlog_there_is_only_the_truth_track(run, tmp_path, alone):
    shutil.copytree(run.folder / ALONE, tmp_path / ALONE)
    (tmp_path / ALONE / "flight.tlog").unlink()
    flight = finished_flight(tmp_path / ALONE)
    drone = flight.drone_tracks[0]
    assert drone.estimate is None
    assert drone.setpoints is None
    assert drone.truth is not None
    assert np.isnan(drone.truth.velocity_ned).all()
    logs = flight.logs
    times = {pose.t for pose in logs.poses} | {frame.t for frame in logs.frames.values()}
    assert list(drone.truth.t_s) == sorted(times)
    assert flight.origin == alone.origin


def test_newest_is_the_last_sample_up_to_a_time_or_else_the_first():
    track = FlightTrack(np.array([0.5, 1.0]), np.zeros((2, 3)), np.zeros((2, 3)), np.zeros((2, 4)))
    assert [track.newest(t) for t in (0.0, 0.5, 0.9, 1.0, 3.0)] == [0, 0, 0, 1, 1]
