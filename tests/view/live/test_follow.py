"""The current moment of a folder, from files that are still being written."""

import json
import math
import re

import numpy as np
import pytest

from dronecats.agent.action import Go
from dronecats.flight.logger.logger_process import measured_in
from dronecats.flight.logger.recorder import EstimateRecorder, Recorder
from dronecats.flight.sitl.episode_world import origin
from dronecats.view.live.folder import FrameTail, load_world
from dronecats.view.live.follow import FlightFollower
from dronecats.view.live.moment import chosen_go, sight
from episodes.records import catalogue
from episodes.world.world import World
from foundation.camera import CameraModel, encode
from foundation.frames import quat_from_euler
from foundation.mavlink import Packer, dialect
from foundation.run_folder import layout
from foundation.run_folder.rows import Begin, Decision, End, FrameTruth, Pose
from foundation.run_folder.writing import LineLog, TelemetryLog
from foundation.truth import TRUTH_COMPONENT, truth_message

EPISODE = "residential-approaching-03"
T0_US = 24_000_000


class Writer:
    """Writes a flight like the logger and the agent."""

    def __init__(self, folder, world) -> None:
        self.folder, self.origin = folder, origin(world)
        (folder / layout.FRAMES).mkdir(parents=True)
        (folder / layout.EPISODE).write_text(world.record.to_json())
        self.tlog = TelemetryLog(folder / layout.TLOG)
        self.truth, self.decisions = LineLog(folder / layout.TRUTH), LineLog(folder / layout.DECISIONS)
        self._bus, self._autopilot = Packer(1, TRUTH_COMPONENT), Packer(1, 1)

    def pose(self, time_us, place, attitude, velocity=(0.0, 0.0, 0.0)) -> None:
        message = truth_message(time_us, place, velocity, attitude, (0.0,) * 3, (0.0,) * 3, self.origin)
        self.tlog.write(time_us, self._bus.pack(message))

    def says(self, time_us, message) -> None:
        self.tlog.write(time_us, self._autopilot.pack(message))

    def picture(self, frame_id) -> bytes:
        jpeg = encode(np.full((36, 64, 3), 40 + frame_id, np.uint8))
        (self.folder / layout.FRAMES / layout.frame_name(frame_id)).write_bytes(jpeg)
        return jpeg

    def decide(self, step, action, t_frame) -> None:
        self.decisions.write(
            Decision(step=step, drone=0, frame_id=step, t_frame=t_frame, t_decided=t_frame + 0.5, reply="{}",
                     action=action, rate_hz=0.4 if step else None, latency_s=0.5)
        )  # fmt: skip

    def flush(self) -> None:
        self.tlog.flush()


@pytest.fixture(scope="module")
def world():
    return World(catalogue.load(EPISODE))


@pytest.fixture
def writer(tmp_path, world):
    return Writer(tmp_path / EPISODE, world)


@pytest.fixture
def follower(writer, world):
    return FlightFollower(writer.folder, world, 1)


def test_without_messages_the_position_is_unknown(follower, world):
    moment = follower.turn()
    assert moment.drones[0].position_ned is None
    assert "ready" in moment.state
    assert moment.instruction == world.record.instruction


def test_a_moment_has_the_true_pose_and_the_autopilot_state(writer, follower):
    attitude = quat_from_euler(0.1, -0.05, 0.7)
    writer.pose(T0_US + 500_000, (-41.0, -1.0, -2.2), attitude, (0.5, 0.25, 0.0))
    writer.says(T0_US, dialect.MAVLink_heartbeat_message(2, 12, 128 + 29, 6 << 16, 4, 3))
    writer.says(T0_US, dialect.MAVLink_statustext_message(6, b"Armed", 0, 0))
    mask = 0b100100100011  # position, climb and yaw are ignored
    target = dialect.MAVLink_position_target_local_ned_message(
        24_000, 1, mask, math.nan, math.nan, -2.2, 1.0, 0.4, math.nan, 0, 0, 0, 0, 0
    )
    writer.says(T0_US, target)
    writer.truth.write(Begin(t0_us=T0_US, cap_s=300.0))
    writer.flush()
    moment = follower.turn()
    (drone,) = moment.drones
    assert drone.true
    assert drone.position_ned == pytest.approx((-41.0, -1.0, -2.2), abs=0.012)  # resolution of transmitted positions
    assert drone.attitude == pytest.approx(attitude, abs=1e-6)
    assert drone.velocity_ned == pytest.approx((0.5, 0.25, 0.0))
    assert drone.setpoint_ned == pytest.approx((1.0, 0.4, 0.0))
    assert (drone.armed, drone.mode) == (True, "OFFBOARD")
    assert drone.messages == ("Armed",)
    assert moment.t_s == pytest.approx(0.5)
    assert "air" in moment.state


def test_the_ray_of_a_go_starts_at_the_pose_of_its_picture(writer, follower):
    """The drone has moved since then. The ray starts at the position and attitude of the picture."""
    then, attitude = (-41.0, -1.0, -2.2), quat_from_euler(0.05, -0.1, 0.9)
    writer.truth.write(Begin(t0_us=T0_US, cap_s=300.0))
    writer.pose(T0_US + 100_000, then, attitude)
    writer.pose(T0_US + 900_000, (-39.0, 1.0, -2.2), (1.0, 0.0, 0.0, 0.0))
    jpeg = writer.picture(0)
    writer.decide(0, {"action": "go", "point": [500.0, 500.0], "depth_m": 8.0}, 0.1)
    writer.flush()
    (drone,) = follower.turn().drones
    assert drone.decided_on is not None
    assert drone.decided_on.jpeg == jpeg
    assert drone.lens_ned is not None
    assert drone.chosen_ned is not None
    go = chosen_go(drone.decision) if drone.decision else None
    assert go is not None
    expected = sight(go, then, attitude, CameraModel())
    assert drone.lens_ned == pytest.approx(expected.lens_ned, abs=0.012)
    assert drone.chosen_ned == pytest.approx(expected.place_ned, abs=0.012)
    assert math.dist(drone.lens_ned, drone.chosen_ned) == pytest.approx(8.0, abs=1e-3)  # at the picture's centre


def test_a_go_at_the_targets_pixel_and_depth_leads_to_the_target(world):
    """Point and depth come from the judge's measurement of the target's centre."""
    attitude = quat_from_euler(0.08, -0.12, math.radians(20.0))
    place = (-41.0, 0.5, -2.5)
    lens = CameraModel()
    measured = world.measure(0.0, place, attitude, lens)
    forward, right, down = measured.target_frd
    point = [1000.0 * (0.5 + lens.focal_px * right / forward / lens.width),
             1000.0 * (0.5 + lens.focal_px * down / forward / lens.height)]  # fmt: skip
    decision = Decision(step=0, drone=0, frame_id=0, t_frame=0.0, t_decided=0.5,
                    action={"action": "go", "point": point, "depth_m": forward})  # fmt: skip
    go = chosen_go(decision)
    assert go is not None
    assert sight(go, place, attitude, lens).place_ned == pytest.approx(measured.target_ned, abs=1e-6)


def test_the_ray_of_a_camera_on_a_gimbal_does_not_tilt_with_the_body():
    tilted = quat_from_euler(0.1, -0.2, 0.3)
    ray = sight(Go(500.0, 500.0, 10.0), (0.0, 0.0, -3.0), tilted, CameraModel(gimballed=True))
    assert ray.place_ned[2] == pytest.approx(ray.lens_ned[2])
    ahead = [place - lens for place, lens in zip(ray.place_ned, ray.lens_ned, strict=True)]
    assert math.atan2(ahead[1], ahead[0]) == pytest.approx(0.3)


def test_a_flight_that_failed_before_its_episode_is_over(follower):
    (follower.folder / layout.VERDICT).write_text('{"success": null, "outcome": "error"}')
    moment = follower.turn()
    assert moment.state.startswith("over")


def test_an_action_other_than_go_has_no_chosen_position(writer, follower):
    writer.truth.write(Begin(t0_us=T0_US, cap_s=300.0))
    writer.pose(T0_US, (-41.0, -1.0, -2.2), (1.0, 0.0, 0.0, 0.0))
    writer.decide(0, {"action": "rotate", "angle_deg": 30.0}, 0.1)
    writer.flush()
    (drone,) = follower.turn().drones
    assert drone.decision is not None
    assert drone.chosen_ned is None


def test_an_incomplete_picture_is_not_shown(writer, follower):
    jpeg = writer.picture(0)
    path = writer.folder / layout.FRAMES / layout.frame_name(0)
    path.write_bytes(jpeg[:-40])
    assert follower.turn().drones[0].picture is None
    path.write_bytes(jpeg)
    shown = follower.turn().drones[0].picture
    assert shown is not None
    assert shown.jpeg == jpeg


def test_damaged_lines_are_skipped(writer, follower):
    with (writer.folder / layout.DECISIONS).open("ab") as file:
        file.write(b'{"step": 0}\n[1]\nnot JSON\n\xff\xfe\n')
    writer.decide(1, {"action": "think"}, 3.0)
    (drone,) = follower.turn().drones
    assert drone.decision is not None
    assert drone.decision.step == 1


def test_the_judge_shows_distance_declaration_and_verdict(writer, follower, world):
    writer.truth.write(Begin(t0_us=T0_US, cap_s=300.0))
    place = (-30.0, 0.0, -2.0)
    writer.pose(T0_US + 4_000_000, place, (1.0, 0.0, 0.0, 0.0))
    writer.truth.write(FrameTruth(frame_id=0, t=4.0, drone=0, distance_m=4.75, visible=True))
    writer.truth.write(Pose(t=4.0, drone=0, position_ned=place, distance_m=4.75, visible=True))
    writer.decide(0, {"action": "finished"}, 4.0)
    writer.flush()
    judge = follower.turn().judge
    assert judge.target_ned == pytest.approx(world.target_centre(4.0))
    assert judge.distance_m[0] == pytest.approx(math.dist(place, world.target_centre(4.0)), abs=0.02)
    (declared,) = judge.messages
    assert "4.75 m" in declared
    flying = follower.turn().state
    writer.truth.write(End(t=4.6, reason="decided"))
    (writer.folder / layout.VERDICT).write_text(json.dumps({"success": True, "ne_m": 4.75}))
    moment = follower.turn()
    assert re.search(r"\bsuccess\b.*4\.75 m", moment.judge.messages[-1])
    assert "decided" in moment.state
    assert "decided" not in flying


def test_envelope_and_autopilot_messages_are_in_time_order(writer, follower):
    for k, text in ((1, b"one"), (3, b"three")):
        writer.says(T0_US + k, dialect.MAVLink_statustext_message(6, text, 0, 0))
    line = {"time_us": T0_US + 2, "drone": 0, "limits": ["speed", "height"]}
    (writer.folder / layout.SAFETY).write_text(json.dumps(line) + "\n")
    writer.flush()
    (drone,) = follower.turn().drones
    first, between, last = drone.messages
    assert (first, last) == ("one", "three")
    assert "speed, height" in between


def test_repeated_limits_are_one_line_with_a_count(writer, follower):
    writer.says(T0_US, dialect.MAVLink_statustext_message(6, b"one", 0, 0))
    with (writer.folder / layout.SAFETY).open("w") as file:
        for k in range(70):
            for at, limits in ((0, ["climb"]), (1, [])):
                file.write(json.dumps({"time_us": T0_US + 2 * k + at, "drone": 0, "limits": limits}) + "\n")
    writer.flush()
    (drone,) = follower.turn().drones
    first, counted = drone.messages
    assert first == "one"
    assert "climb" in counted
    assert "70" in counted


def test_recorded_frames_are_readable_immediately(tmp_path, world):
    """With a buffer of 8 kB, the page would be a second late."""
    recorder = Recorder(tmp_path, origin(world), measured_in(world), CameraModel())
    bus, autopilot = Packer(1, TRUTH_COMPONENT), Packer(1, 1)
    tail = FrameTail(tmp_path / layout.TLOG)
    still = ((0.0,) * 3, (1.0, 0.0, 0.0, 0.0), (0.0,) * 3, (0.0,) * 3)
    for k in range(3):
        frame = bus.pack(truth_message(T0_US + 20_000 * k, (0.0, 0.0, -2.0), *still, origin(world)))
        recorder.truth(frame)
        assert [got for _, got in tail.read()] == [frame]
        frame = autopilot.pack(dialect.MAVLink_statustext_message(6, b"Armed", 0, 0))
        recorder.telemetry(frame)
        assert [got for _, got in tail.read()] == [frame]
    recorder.close()


def test_recorded_estimates_are_readable_immediately(tmp_path):
    recorder, tail = EstimateRecorder(tmp_path), FrameTail(tmp_path / layout.TLOG)
    frame = Packer(1, 1).pack(dialect.MAVLink_local_position_ned_message(1000, 1, 2, -3, 0, 0, 0))
    recorder.telemetry(frame)
    assert [got for _, got in tail.read()] == [frame]
    recorder.close()


def test_without_truth_the_pose_is_the_autopilot_estimate(tmp_path):
    """The vehicle is a connected one. Its system id may be any, and there is no judge."""
    folder = tmp_path / "connected"
    (folder / layout.FRAMES).mkdir(parents=True)
    (folder / layout.EPISODE).write_text(json.dumps({"id": "connected", "instruction": "look"}))
    tlog, vehicle = TelemetryLog(folder / layout.TLOG), Packer(7, 1)
    for time_ms, north in ((1000, 1.0), (1200, 1.5)):
        for message in (
            dialect.MAVLink_attitude_message(time_ms, 0.1, 0.0, 0.5, 0, 0, 0),
            dialect.MAVLink_local_position_ned_message(time_ms, north, 2.0, -3.0, 0.5, 0.0, 0.0),
        ):
            tlog.write(1000 * time_ms, vehicle.pack(message))
        tlog.flush()
        if north == 1.0:
            follower = FlightFollower(folder, load_world(folder), 1)
            follower.turn()
    moment = follower.turn()
    (drone,) = moment.drones
    assert drone.true is False
    assert drone.position_ned == pytest.approx((1.5, 2.0, -3.0))
    assert drone.attitude == pytest.approx(quat_from_euler(0.1, 0.0, 0.5), abs=1e-6)
    assert drone.height_m == pytest.approx(3.0)
    assert moment.instruction == "look"
    assert moment.judge.target_ned is None
