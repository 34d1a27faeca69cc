"""A fleet on the truth bus: pictures and logs use an instant at which the poses of all drones are known."""

import math

import numpy as np
import pytest

from dronecats.flight.logger.logger_process import measured_in
from dronecats.flight.logger.recorder import Recorder
from dronecats.flight.sitl.camera import WorldCamera
from dronecats.flight.sitl.episode_world import load_world, origin
from episodes.camera.optics.options import Exposure, Optics
from foundation.camera import CameraModel
from foundation.frames import quat_from_euler
from foundation.mavlink import Packer
from foundation.truth import FrameTaken, NewestTruth, TruthSample, frame_message, nearest, truth_message
from tests.support.json_lines import rows

EPISODE = "blocks-commanding-01"
HALF = CameraModel(640, 360)
STILL = (0.0, 0.0, 0.0)
GAP_M = 0.35  # from a lens to the centre of a drone that hides everything behind it


@pytest.fixture(scope="module")
def world():
    return load_world(EPISODE)


class Bus:
    """Truth messages of a fleet: drone 0 faces its target, and drone 1 is in front of its lens or far away."""

    def __init__(self, world):
        self.world, self._packers = world, {}
        goal = np.array(world.target_centre(0.0))
        start = np.array(world.record.starts[0].position_ned)
        self._way = (goal - start) / np.linalg.norm(goal - start)
        yaw, pitch = math.atan2(self._way[1], self._way[0]), -math.asin(self._way[2])
        self.attitude = quat_from_euler(0.0, pitch, yaw)
        forward, down = self._way, np.array((math.sin(pitch) * math.cos(yaw), math.sin(pitch) * math.sin(yaw), 1.0))
        down[2] = math.cos(pitch)
        lever = HALF.offset_frd[0] * forward + HALF.offset_frd[2] * down
        lens = goal - 12.0 * forward
        self.facing = tuple((lens - lever).tolist())
        self.in_the_way = tuple((lens + GAP_M * forward).tolist())
        self.away = tuple((lens - 6.0 * forward).tolist())

    def pose(self, drone, time_us, place, velocity=STILL):
        packer = self._packers.setdefault(drone, Packer(drone + 1, 51))
        return packer.pack(truth_message(time_us, place, velocity, self.attitude, STILL, STILL, origin(self.world)))

    def all(self, time_us, other):
        """Return every drone's sample of one time, with drone 1 at `other`."""
        data = self.pose(0, time_us, self.facing) + self.pose(1, time_us, other)
        return data + b"".join(self.pose(k, time_us, self.world.record.starts[k].position_ned) for k in (2, 3))


@pytest.fixture
def bus(world):
    return Bus(world)


@pytest.fixture
def log(world, tmp_path):
    """A recorder that has begun at one second, and its written rows by kind."""
    recorder = Recorder(tmp_path, origin(world), measured_in(world), HALF)
    recorder.begin(1_000_000)

    def written(kind):
        return rows(tmp_path / "truth.jsonl", kind)

    yield recorder, written
    recorder.close()


def test_a_drone_in_front_of_the_lens_makes_the_target_invisible_in_the_log(bus, log, world):
    recorder, written = log
    packer = Packer(1, 100)
    for k, (other, visible) in enumerate(((bus.away, True), (bus.in_the_way, False))):
        time_us = 1_000_000 + 500_000 * k
        recorder.truth(bus.all(time_us, other))
        sample = TruthSample(0, time_us, bus.facing, STILL, bus.attitude)
        recorder.truth(packer.pack(frame_message(FrameTaken(0, k, time_us), sample, origin(world))))
        assert [p["visible"] for p in written("pose") if p["drone"] == 0][k] is visible
        frame = written("frame")[k]
        assert frame["visible"] is visible
        assert (frame["visible_fraction"] > 0.9) is visible
        assert (frame["oracle_depth_m"] is not None) is visible
        x0, y0, x1, y1 = frame["target_box"]  # hidden or not
        assert 0.0 <= x0 < x1 <= 1000.0
        assert 0.0 <= y0 < y1 <= 1000.0
        assert frame["target_frd"][0] > 0.0


def test_a_pose_waits_for_the_other_drones_poses_of_the_same_time(bus, log):
    recorder, written = log
    recorder.truth(bus.all(980_000, bus.away))
    recorder.truth(bus.pose(0, 1_000_000, bus.facing))
    assert written("pose") == []
    recorder.truth(bus.pose(1, 1_000_000, bus.in_the_way))
    for k in (2, 3):
        recorder.truth(bus.pose(k, 1_000_000, bus.away))
    poses = written("pose")
    assert [p["drone"] for p in poses] == [0, 1, 2, 3]
    assert not poses[0]["visible"]
    assert all(p["t"] == 0.0 for p in poses)


def test_a_frame_announced_late_is_measured_with_the_poses_of_its_own_time(bus, log, world):
    recorder, written = log
    recorder.truth(bus.all(1_000_000, bus.in_the_way) + bus.all(1_020_000, bus.away))
    sample = TruthSample(0, 1_000_000, bus.facing, STILL, bus.attitude)
    recorder.truth(Packer(1, 100).pack(frame_message(FrameTaken(0, 0, 1_000_000), sample, origin(world))))
    assert written("frame")[0]["visible_fraction"] == 0.0


def test_a_silent_drone_does_not_block_the_pose_rows(bus, log):
    recorder, written = log
    recorder.truth(bus.all(990_000, bus.away))
    for k in range(10):
        recorder.truth(bus.pose(0, 1_000_000 + 20_000 * k, bus.facing))
    assert [p["t"] for p in written("pose")] == [0.0]


def test_waiting_rows_are_written_before_the_end(bus, log):
    recorder, written = log
    recorder.truth(bus.all(990_000, bus.away) + bus.pose(0, 1_010_000, bus.facing))
    assert written("pose") == []
    recorder.end("cap")
    assert [p["drone"] for p in written("pose")] == [0]
    assert len(written("end")) == 1


def test_a_frame_uses_the_newest_instant_that_all_drones_have_reached(bus, world):
    newest = NewestTruth(origin(world))
    assert newest.together(0) is None
    newest.feed(bus.all(0, bus.in_the_way) + bus.all(20_000, bus.away) + bus.pose(0, 40_000, bus.facing))
    together = newest.together(0)
    assert together is not None
    sample, others = together
    assert sample.time_us == 20_000
    assert {k: one.time_us for k, one in others.items()} == {1: 20_000, 2: 20_000, 3: 20_000}
    of_one = newest.of(0)
    assert of_one is not None
    assert of_one.time_us == 40_000
    newest.feed(bus.pose(0, 130_000, bus.facing))  # the others are silent by now
    together = newest.together(0)
    assert together is not None
    sample, others = together
    assert sample.time_us == 130_000
    assert others[1].time_us == 20_000


def test_rare_readers_get_the_same_truth_as_frequent_ones(bus, world):
    """A late reader loses nothing: neither the newest sample, nor the last position of a drone that went silent."""
    always, seldom = NewestTruth(origin(world)), NewestTruth(origin(world))
    chunks = [bus.all(0, bus.in_the_way)] + [bus.pose(0, 20_000 * k, bus.facing) for k in range(1, 3000)]
    for data in chunks:
        always.feed(data)
        always.of(0)
        seldom.feed(data)
    assert always.together(0) == seldom.together(0)
    assert [always.of(k) for k in range(4)] == [seldom.of(k) for k in range(4)]
    assert always.of(3) is not None


def test_the_earlier_of_two_equally_near_samples_is_chosen(world):
    def at(time_us):
        return TruthSample(0, time_us, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))

    samples = [at(t) for t in (0, 20, 40, 60, 60)]
    for wanted_us in range(-5, 70):
        assert nearest(samples, wanted_us) is min(samples, key=lambda sample: abs(sample.time_us - wanted_us))
    with pytest.raises(ValueError, match="sample"):
        nearest([], 0)


def picture(world, truth, drone=0, optics=None):
    camera = WorldCamera(world, HALF, lambda data: None, optics=optics)
    camera.feed(truth)
    return camera.newest(drone).image_rgb


def test_the_camera_of_a_rear_drone_shows_the_drone_ahead():
    """The square of the record's starts faces the goal: one drone is 2 m ahead, in the middle of the picture."""
    world = load_world("v1-residential-commanding-01")
    bus = Bus(world)
    starts = [one.position_ned for one in world.record.starts]
    yaw = math.radians(world.record.starts[0].yaw_deg)
    bus.attitude = quat_from_euler(0.0, 0.0, yaw)
    along = [n * math.cos(yaw) + e * math.sin(yaw) for n, e, _ in starts]
    rear = int(np.argmin(along))
    truth = b"".join(bus.pose(k, 20_000, place) for k, place in enumerate(starts))
    alone = picture(world, bus.pose(rear, 20_000, starts[rear]), rear)
    shown = picture(world, truth, rear)
    differs = np.abs(shown.astype(int) - alone).max(axis=2) > 24
    assert differs[120:240, 240:400].sum() > 800
    front = int(np.argmax(along))
    np.testing.assert_array_equal(picture(world, truth, front)[:150], picture(
        world, bus.pose(front, 20_000, starts[front]), front)[:150])  # fmt: skip


def test_a_passing_drone_is_blurred_by_its_own_motion(bus, world):
    across = (3.0 * bus._way[1], -3.0 * bus._way[0], 0.0)
    beyond = tuple((np.array(bus.in_the_way) + 2.0 * bus._way + (0.0, 0.0, -0.8)).tolist())
    optics, wide = Optics(exposure=Exposure(0.1, 8)), []
    for velocity in (STILL, across):
        truth = bus.pose(0, 20_000, bus.facing) + bus.pose(1, 20_000, beyond, velocity)
        shown, bare = picture(world, truth, 0, optics), picture(world, bus.pose(0, 20_000, bus.facing), 0, optics)
        wide.append(np.ptp(np.nonzero(np.abs(shown[:170].astype(int) - bare[:170]).max(axis=2) > 8)[1]))
    assert wide[0] > 60  # px; 0.6 m at 2.35 m are 82 px, and 3 m/s during 7/8 of 0.1 s add 36 px
    assert wide[1] == pytest.approx(wide[0] + 36, abs=12)
