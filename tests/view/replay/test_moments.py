"""Moments of a run folder, compared with other readers of truth.jsonl, decisions.jsonl and the tlog."""

import json
import math
import shutil

import numpy as np
import pytest
from pymavlink import mavutil

from dronecats.report.recorded.telemetry import KINDS, telemetry
from dronecats.report.recorded.tracks import estimated_track
from dronecats.view.replay import moments
from dronecats.view.replay.moments import check_same_episode, flight_moments
from foundation.camera import CameraModel
from foundation.errors import UsageError
from foundation.frames import quat_conjugate, quat_multiply, quat_to_euler, rotate_inverse
from foundation.mavlink import Packer, dialect
from foundation.run_folder import layout
from foundation.run_folder.writing import TelemetryLog
from tests.support.json_lines import rows
from tests.support.logged_messages import logged_messages
from tests.support.onboard_logs import with_onboard_log
from tests.support.run_folders import run_folder

SOON = 1e-4  # s


def places(folder):
    """Return (t, place, yaw in degrees, distance) of every line of truth.jsonl with a position."""
    placed_rows = [row for row in rows(folder / layout.TRUTH) if row.get("position_ned")]
    return [(row["t"], row["position_ned"], row["yaw_deg"], row["distance_m"]) for row in placed_rows]


def test_poses_and_distances_equal_truth_jsonl(flight, folder):
    true_places = places(folder)
    assert len(true_places) > 12
    for t, place, yaw_deg, distance_m in true_places:
        moment = flight.moment(t)
        drone = moment.drones[0]
        assert math.dist(drone.position_ned, place) < 0.02
        turned = math.degrees(quat_to_euler(drone.attitude)[2]) - yaw_deg
        assert abs((turned + 180.0) % 360.0 - 180.0) < 0.5
        assert drone.true
        assert moment.judge.distance_m[0] == pytest.approx(distance_m, abs=0.02)
    assert flight.missing == ()


def test_velocities_equal_the_truth_bus(flight, folder):
    log = mavutil.mavlink_connection(str(folder / layout.TLOG), dialect="development")
    t0_us, worst, speed = rows(folder / layout.TRUTH, "begin")[0]["t0_us"], 0.0, 0.0
    while (m := log.recv_match(type="HIL_STATE_QUATERNION")) is not None:
        t = (m.time_usec - t0_us) / 1e6
        if 0.0 <= t <= flight.end_s:
            shown = flight.moment(t).drones[0].velocity_ned
            worst = max(worst, math.dist(shown, (m.vx / 100, m.vy / 100, m.vz / 100)))
            speed = max(speed, math.hypot(*shown))
    assert worst < 1e-6
    assert speed > 0.5


def test_pictures_and_decisions_appear_at_their_logged_times(flight, folder):
    decisions = rows(folder / layout.DECISIONS)
    assert len(decisions) > 1
    for before, one in zip([None, *decisions], decisions, strict=False):
        name = layout.frame_name(one["frame_id"])
        for t, decided in ((one["t_frame"], before), (one["t_decided"] - SOON, before), (one["t_decided"], one)):
            drone = flight.moment(t).drones[0]
            assert drone.picture.jpeg == (folder / layout.FRAMES / name).read_bytes()
            assert drone.picture.t_s == one["t_frame"]
            assert (drone.decision.step if drone.decision else None) == (decided["step"] if decided else None)
            assert (drone.decided_on.frame_id if drone.decided_on else None) == (decided and decided["frame_id"])
        assert flight.moment(one["t_decided"]).rate_hz == one["rate_hz"]
    assert flight.moment(decisions[0]["t_frame"] - SOON).drones[0].picture is None


def test_the_chosen_position_projects_to_its_pixel_and_depth(flight):
    gos = [one for one in flight.recorded.logs.decisions if one.kind == "go"]
    assert gos
    camera = CameraModel()
    for go in gos:
        drone = flight.moment(go.t_decided).drones[0]
        away = np.subtract(drone.chosen_ned, drone.lens_ned)
        n, e, d = map(float, away)
        ahead, right, below = rotate_inverse(flight.pose(0, go.t_frame).attitude, (n, e, d))
        assert ahead == pytest.approx(go.action["depth_m"])
        assert right / ahead * camera.focal_px + camera.width / 2 == pytest.approx(go.action["point"][0] * 1.280)
        assert below / ahead * camera.focal_px + camera.height / 2 == pytest.approx(go.action["point"][1] * 0.720)


def test_a_moment_shows_the_autopilots_own_state(flight):
    drone = flight.moment(3.0).drones[0]
    assert (drone.mode, drone.armed) == ("OFFBOARD", True)
    assert 0.5 < drone.battery <= 1.0
    setpoints = [flight.moment(t).drones[0].setpoint_ned for t in np.arange(0.0, flight.end_s, 0.25)]
    assert max(math.hypot(*setpoint) for setpoint in setpoints if setpoint) > 0.5
    north, east, down = drone.position_ned
    assert drone.height_m == pytest.approx(flight.world.scene.terrain.at(north, east) - down, abs=0.05)


def test_the_judge_shows_no_message_at_the_start_and_the_verdict_at_the_end(flight):
    assert flight.moment(0.0).judge.messages == ()
    end = flight.moment(flight.end_s)
    assert flight.recorded.verdict.outcome in end.judge.messages[-1]
    assert "cap" in end.state
    assert "air" in flight.moment(1.0).state
    assert flight.moment(1e6) == end
    assert flight.moment(-5.0) == flight.moment(0.0)
    moved = math.dist(flight.moment(0.0).judge.target_ned, end.judge.target_ned)
    assert moved > 1.0  # it follows a moving target


def test_a_copy_of_the_folder_gives_the_same_moments(flight, copied):
    again = flight_moments(copied)
    for t in (0.0, 2.0, flight.end_s):
        assert again.moment(t) == flight.moment(t)


def test_without_a_tlog_the_drone_is_level_and_the_missing_file_is_reported(copied, folder):
    (copied / layout.TLOG).unlink()
    flight = flight_moments(copied)
    assert flight.missing == (moments.NO_TLOG,)
    for t, place, _, _ in places(folder):
        drone = flight.moment(t).drones[0]
        assert drone.position_ned == pytest.approx(place, abs=0.06)
        roll, pitch, _ = quat_to_euler(drone.attitude)
        assert abs(roll) + abs(pitch) < 1e-6
    assert (drone.mode, drone.armed, drone.setpoint_ned, drone.velocity_ned) == ("", None, None, None)


def test_a_truncated_tlog_is_read_up_to_its_end(copied, flight):
    tlog = copied / layout.TLOG
    tlog.write_bytes(tlog.read_bytes()[: tlog.stat().st_size * 9 // 10 + 1])
    assert math.dist(flight_moments(copied).pose(0, 1.0).position_ned, flight.pose(0, 1.0).position_ned) < 0.02


def test_missing_pictures_are_reported(copied, runs):
    shutil.rmtree(copied / layout.FRAMES)
    flight = flight_moments(copied)
    assert flight.missing == (moments.NO_PICTURES,)
    assert flight.moment(3.0).drones[0].picture is None
    assert flight.moment(3.0).drones[0].decision is not None
    assert flight_moments(runs / "other").missing == (moments.NOT_DRAWN,)


def test_without_truth_the_pose_is_the_autopilot_estimate(copied, flight, rewrite):
    def unknown(row):
        return {**row, "source": "estimate"} if row["kind"] == "begin" else row if row["kind"] == "end" else None

    rewrite(copied / layout.TRUTH, unknown)
    (copied / layout.EPISODE).unlink()
    own = flight_moments(copied)
    assert own.missing == (moments.NO_TRUTH,)
    assert own.world is None
    for t in (1.0, 3.0, 5.0):
        shown = own.moment(t)
        assert not shown.drones[0].true
        assert shown.judge.target_ned is None
        assert shown.judge.messages == ()
        assert shown.drones[0].position_ned == own.pose(0, t).position_ned
        displacement = np.subtract(own.pose(0, t).position_ned, own.pose(0, 0.0).position_ned)
        truly = np.subtract(flight.pose(0, t).position_ned, flight.pose(0, 0.0).position_ned)
        assert math.dist(displacement, truly) < 0.5  # the estimate may wander by half a metre
        leans = quat_multiply(quat_conjugate(flight.pose(0, t).attitude), own.pose(0, t).attitude)
        assert 2.0 * math.acos(min(1.0, abs(leans[0]))) < math.radians(4.0)
        assert shown.drones[0].velocity_ned is not None
    with pytest.raises(UsageError, match=r"\btruth\b"):
        check_same_episode([flight, own])


def test_a_vehicle_with_another_system_id_is_the_first_drone(copied, flight):
    """Our system ids are 1, 2, …; a real vehicle may have any."""
    path = copied / layout.TLOG
    autopilot, packer = [m for m in logged_messages(path, KINDS) if m.get_srcComponent() == 1], Packer(42, 1)
    path.unlink()
    log = TelemetryLog(path)
    for message in autopilot:
        log.write(0, packer.pack(message))
    log.write(0, Packer(255, 1).pack(dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)))  # a ground station
    log.close()
    logs = telemetry(path, flight.recorded.t0_us)
    assert list(logs) == [0]
    assert logs[0].setpoint_velocity == flight.recorded.telemetry[0].setpoint_velocity
    assert logs[0].states.values == flight.recorded.telemetry[0].states.values


def test_an_unknown_map_is_reported_and_leaves_the_flight_without_a_world(copied, folder):
    record = json.loads((copied / layout.EPISODE).read_text())
    (copied / layout.EPISODE).write_text(json.dumps({**record, "map": "somebodys-own"}))
    flight = flight_moments(copied)
    assert flight.world is None
    assert len(flight.missing) == 1
    assert "somebodys-own" in flight.missing[0]
    for t, place, _, distance_m in places(folder):
        assert flight.moment(t).drones[0].position_ned == pytest.approx(place, abs=0.06)
        assert flight.moment(t).judge.distance_m[0] == pytest.approx(distance_m, abs=0.2)


def test_a_fleet_is_read_from_log_rows_alone(tmp_path):
    run = run_folder(tmp_path / "run", {"nowhere-commanding-01": "go there"}, drones=3)
    flight = flight_moments(run)
    assert flight.drones == (0, 1, 2)
    moment = flight.moment(4.0)
    assert [drone.position_ned for drone in moment.drones] == [pytest.approx((5.2, 2.0 * k, -2.0)) for k in range(3)]
    assert len({drone.picture.jpeg for drone in moment.drones if drone.picture}) == 3
    assert len(moment.judge.distance_m) == 3


def test_a_flight_without_a_begin_row_is_rejected(copied, rewrite):
    rewrite(copied / layout.TRUTH, lambda row: None if row["kind"] == "begin" else row)
    with pytest.raises(UsageError, match=r"truth\.jsonl"):
        flight_moments(copied)


def test_a_killed_flight_is_shown_up_to_the_end_of_its_logs(flight, copied):
    """The logs end in the middle of a line, after two thirds of their bytes. Earlier rows are unchanged."""
    for name in (layout.TRUTH, layout.DECISIONS):
        whole = (copied / name).read_bytes()
        (copied / name).write_bytes(whole[: 2 * len(whole) // 3])
    for name in (layout.VERDICT, layout.IDENTITY):
        (copied / name).unlink(missing_ok=True)
    killed = flight_moments(copied)
    assert 0.0 < killed.end_s < flight.end_s
    assert moments.NO_END in killed.missing
    t = 0.5 * killed.end_s
    assert killed.moment(t).drones[0].position_ned == flight.moment(t).drones[0].position_ned
    last = killed.moment(killed.end_s)
    assert "air" in last.state
    assert not any(flight.recorded.verdict.outcome in message for message in last.judge.messages)


def test_damaged_and_invalid_flights_are_rejected(copied, tmp_path):
    with pytest.raises(UsageError, match="nothing"):
        flight_moments(tmp_path / "nothing")
    with pytest.raises(UsageError, match=str(tmp_path)):
        flight_moments(tmp_path)
    (copied / layout.SAFETY).write_text('{"time_us": "late", "drone": 0, "limits": []}\n')
    with pytest.raises(UsageError, match=r"safety\.jsonl line 1\b"):
        flight_moments(copied)
    (copied / layout.SAFETY).unlink()
    text = (copied / layout.TRUTH).read_text().splitlines()
    (copied / layout.TRUTH).write_text("\n".join([text[0], '{"kind": "pose"', *text[1:]]) + "\n")
    with pytest.raises(UsageError, match=r"truth\.jsonl line 2\b"):
        flight_moments(copied)


def test_flights_of_different_episodes_cannot_be_combined(flight, copied, tmp_path, runs):
    check_same_episode([flight, flight_moments(runs / "other")])
    stranger = flight_moments(run_folder(tmp_path / "stranger", {"nowhere-approaching-07": "go there"}))
    with pytest.raises(UsageError, match=r"residential-tracking-01 and .*nowhere-approaching-07"):
        check_same_episode([flight, stranger])
    record = json.loads((copied / layout.EPISODE).read_text())
    (copied / layout.EPISODE).write_text(json.dumps({**record, "instruction": "go elsewhere"}))
    with pytest.raises(UsageError, match="residential-tracking-01"):
        check_same_episode([flight, flight_moments(copied)])


def test_ignored_axes_of_a_setpoint_are_zero(tmp_path):
    """The live page does the same. A velocity with a NaN climb must not leave the previous setpoint on the page."""
    log, vehicle = TelemetryLog(tmp_path / layout.TLOG), Packer(1, 1)
    for time_ms, down, mask in ((1000, 0.3, 0), (2000, math.nan, 0b100000)):
        log.write(0, vehicle.pack(dialect.MAVLink_local_position_ned_message(time_ms, 0, 0, -2, 0, 0, 0)))
        log.write(0, vehicle.pack(dialect.MAVLink_position_target_local_ned_message(
            time_ms, 1, mask, 0, 0, 0, 1.0, 0.5, down, 0, 0, 0, 0, 0)))  # fmt: skip
    log.close()
    messages = telemetry(tmp_path / layout.TLOG, 0)[0]
    track = estimated_track(messages)
    assert track is not None
    assert track.level  # it never reported its attitude
    velocity = messages.setpoint_velocity
    assert velocity.t_s == (1.0, 2.0)
    assert velocity.values[0] == pytest.approx((1.0, 0.5, 0.3))
    assert velocity.values[1] == (1.0, 0.5, 0.0)


def test_the_estimate_comes_from_the_log_on_board_if_it_exists(flight, copied):
    true = with_onboard_log(copied, off=(7.0, 0.0, 0.0))
    with_log = flight_moments(copied)
    own, wire = with_log.recorded.estimated_tracks[0], flight.recorded.estimated_tracks[0]
    assert len(own) > 5 * len(wire)
    for t in (1.0, 2.0, 3.0):
        assert own.at(t).position_ned[0] - true.at(t).position_ned[0] == pytest.approx(7.0, abs=0.01)
        assert with_log.recorded.tracks[0].at(t) == flight.recorded.tracks[0].at(t)
    assert with_log.recorded.telemetry[0].states == flight.recorded.telemetry[0].states
