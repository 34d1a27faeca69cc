"""The truth of an external simulator is placed on our map, by pure functions and by a process over sockets."""

import itertools
import math
import socket
import threading

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dronecats.flight.processes.supervisor import ChildProcess
from dronecats.flight.sitl.config import TruthBridgeConfig
from dronecats.flight.sitl.episode_world import load_world, origin, placement_of
from dronecats.flight.sitl.simulation import boot_poses
from dronecats.flight.sitl.truth_bridge import TruthSource
from dronecats.flight.stages.stage import TRUTH_BRIDGE
from foundation.errors import UsageError
from foundation.frames import ned_to_geodetic, quat_from_euler, quat_to_euler, rotate, wrap_pi
from foundation.mavlink import Packer, Parser, dialect
from foundation.truth import NewestTruth, truth_message
from hil.link.transport import connect
from tests.support.ports import free_port

HOME = (47.397743, 8.545594, 489.4)  # the origin of PX4's own simulation
EPISODE = "residential-approaching-01"
ANGLE = st.floats(-math.pi, math.pi)
METRES = st.floats(-300.0, 300.0)


def truth_at(position=(0.0, 0.0, 0.0), yaw=0.0, velocity=(0.0, 0.0, 0.0), time_us=0, roll=0.0):
    """Return the truth message of a vehicle at `position` (m NED from HOME)."""
    still = (0.0, 0.0, 0.0)
    return truth_message(time_us, position, velocity, quat_from_euler(roll, 0.0, yaw), still, still, HOME)


def test_the_first_pose_maps_to_the_start_of_the_episode():
    placement = placement_of(truth_at(yaw=0.7), (12.0, -5.0, 1.5), 2.0)
    sample = placement.sample(truth_at(yaw=0.7), 4_000)
    assert sample.position_ned == pytest.approx((12.0, -5.0, 1.5), abs=0.02)
    assert quat_to_euler(sample.attitude)[2] == pytest.approx(2.0, abs=1e-6)
    assert (sample.drone, sample.time_us) == (0, 4_000)


@given(METRES, METRES, st.floats(-50.0, 0.0), ANGLE, ANGLE, ANGLE)
def test_placement_preserves_the_vehicles_motion(north, east, down, stood, began, yaw):
    """Distances, heights and turns are the same, and so is the forward direction."""
    placement = placement_of(truth_at(yaw=stood), (3.0, 4.0, 0.5), began)
    sample = placement.sample(truth_at((north, east, down), yaw, (1.0, 0.0, -0.5), roll=0.2), 0)
    moved = [a - b for a, b in zip(sample.position_ned, (3.0, 4.0, 0.5), strict=True)]
    assert math.dist(moved, (0.0, 0.0, 0.0)) == pytest.approx(math.hypot(north, east, down), abs=0.03)
    assert moved[2] == pytest.approx(down, abs=0.002)
    roll, _, here = quat_to_euler(sample.attitude)
    assert wrap_pi(here - began - (yaw - stood)) == pytest.approx(0.0, abs=1e-5)
    assert roll == pytest.approx(0.2, abs=1e-5)
    assert sample.velocity_ned == pytest.approx((math.cos(began - stood), math.sin(began - stood), -0.5), abs=1e-5)
    ahead = rotate(quat_from_euler(0.0, 0.0, began - stood), (north, east, down))
    assert moved == pytest.approx(list(ahead), abs=0.03)


def test_truth_without_a_time_uses_the_time_of_the_actuators():
    source, packer = TruthSource(f"udpin://127.0.0.1:{free_port()}"), Packer(6, 1)
    actuators = dialect.MAVLink_hil_actuator_controls_message(38_904_250, [0.0] * 16, 1, 0)
    for message in (truth_at(), actuators, truth_at(), truth_at(time_us=7_654_321)):  # the first one has no time yet
        source._feed(packer.pack(message))
    assert [time_us for time_us, _ in source.read(0.0)] == [38_904_000, 7_654_000]
    source.close()


class ReportingVehicle:
    """A vehicle that reports its position like PX4's own simulation: 25 Hz, a separate time message, system 6."""

    def __init__(self, port, *, speed=0.0, timed=True):
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._to, self._speed, self._timed = ("127.0.0.1", port), speed, timed
        self.north = 0.0
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._speak)
        self._thread.start()

    def _speak(self):
        packer = Packer(6, 1)
        for tick in itertools.count(1):
            if self._stop.wait(0.04):
                return
            actuators = dialect.MAVLink_hil_actuator_controls_message(tick * 40_000, [0.0] * 16, 1, 0)
            where = truth_at((self.north, 0.0, 0.0), 0.3, (self._speed, 0.0, 0.0))
            for message in (actuators, where) if self._timed else (where,):
                self._socket.sendto(packer.pack(message), self._to)

    def close(self):
        self._stop.set()
        self._thread.join()
        self._socket.close()


@pytest.fixture
def port():
    return free_port()


def test_the_bridge_sends_poses_on_our_map_to_all_clients_of_its_bus(tmp_path, port):
    vehicle = ReportingVehicle(port)
    world = load_world(EPISODE)
    bridge = ChildProcess(
        TRUTH_BRIDGE, TruthBridgeConfig(episode=EPISODE, truth=f"udpin://127.0.0.1:{port}"), tmp_path / "bridge.log"
    )
    try:
        ready = bridge.ready()
        turn = boot_poses(world)[0].yaw - 0.3
        assert math.cos(ready["placement"]["turn"] - turn) == pytest.approx(1.0, abs=1e-9)
        camera, logger = (connect(f"udpout://127.0.0.1:{ready['truth']}") for _ in range(2))
        hello = Packer(246, 191)
        heartbeat = dialect.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3)
        logger.send(hello.pack(heartbeat))
        place = boot_poses(world)[0]
        vehicle.north = 10.0
        newest = NewestTruth(origin(world))
        ahead = (
            place.position_ned[0] + 10.0 * math.cos(place.yaw - 0.3),
            place.position_ned[1] + 10.0 * math.sin(place.yaw - 0.3),
        )
        for _ in range(100):
            newest.feed(logger.receive(0.1))
            sample = newest.of(0)
            if sample and math.dist(sample.position_ned[:2], ahead) < 0.05:
                break
        assert sample is not None
        assert sample.position_ned[:2] == pytest.approx(ahead, abs=0.05)
        assert sample.position_ned[2] == pytest.approx(place.position_ned[2], abs=0.02)
        assert sample.time_us % 1000 == 0
        camera.send(hello.pack(heartbeat) + hello.pack(dialect.MAVLink_camera_image_captured_message(
            1, 0, 0, 0, 0, 0, 0, [1.0, 0.0, 0.0, 0.0], 17, 1, b"")))  # fmt: skip
        parser, image_indices = Parser(), []
        for _ in range(100):
            image_indices += [m.image_index for m in parser.feed(logger.receive(0.1)) if hasattr(m, "image_index")]
            if image_indices:
                break
        assert image_indices == [17]  # the camera's messages reach the logger
    finally:
        bridge.close()
        vehicle.close()


def test_a_vehicle_that_moves_at_the_start_is_rejected(port):
    vehicle = ReportingVehicle(port, speed=2.0)
    source = TruthSource(f"udpin://127.0.0.1:{port}")
    with pytest.raises(UsageError, match=r"2\.0 m/s"):
        source.first()
    source.close()
    vehicle.close()


@pytest.mark.slow
@pytest.mark.parametrize("timed", [None, False])
def test_a_stream_without_truth_or_without_time_is_reported(tmp_path, port, timed):
    vehicle = None if timed is None else ReportingVehicle(port, timed=timed)
    config = TruthBridgeConfig(episode=EPISODE, truth=f"udpin://127.0.0.1:{port}")
    bridge = ChildProcess(TRUTH_BRIDGE, config, tmp_path / "bridge.log")
    with pytest.raises(UsageError, match=rf"--truth udpin://127\.0\.0\.1:{port}"):
        bridge.ready()
    bridge.close()
    if vehicle:
        vehicle.close()


def test_the_home_of_a_placement_is_the_vehicles_geodetic_position():
    lat, lon, alt = ned_to_geodetic(*HOME, 100.0, -50.0, -20.0)
    placement = placement_of(truth_at((100.0, -50.0, -20.0)), (0.0, 0.0, 0.0), 0.0)
    assert placement.home == pytest.approx((lat, lon, alt), abs=1e-6)
