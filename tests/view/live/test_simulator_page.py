"""`sitl --view`: the page follows a simulator's wires."""

import pytest

from dronecats.flight.processes.supervisor import ChildKind, ChildProcess
from dronecats.flight.sitl.config import SimulatorConfig
from dronecats.view.live.config import WatchedWires
from dronecats.view.live.wire_state import WireFollower
from episodes.records import catalogue
from episodes.world.world import World

pytestmark = pytest.mark.slow
TURNS = 3000


def test_the_page_follows_two_drones_on_the_ground(tmp_path):
    kind = ChildKind("simulator", "dronecats.flight.sitl.simulator_process:create", SimulatorConfig)
    simulator = ChildProcess(kind, SimulatorConfig(episode=catalogue.DEFAULT, count=2), tmp_path / "log")
    follower = None
    try:
        ports = simulator.ready()
        world = World(catalogue.load(catalogue.DEFAULT))
        follower = WireFollower(
            WatchedWires(
                episode=catalogue.DEFAULT,
                drones=2,
                truth=f"udpout://127.0.0.1:{ports['truth']}",
                telemetry=tuple(f"udpout://127.0.0.1:{port}" for port in ports["log"]),
            ),
            world,
        )
        for _ in range(TURNS):
            follower._listeners[0].read(0.02)  # waits for the bus; a page waits for its next update
            moment = follower.turn()
            if all(drone.true and drone.mode and drone.battery for drone in moment.drones):
                break
        for drone in moment.drones:
            assert drone.height_m == pytest.approx(0.21, abs=0.1)  # upright
            assert drone.armed is False
        first, second = (drone.position_ned for drone in moment.drones)
        assert first is not None
        assert second is not None
        assert second[1] - first[1] == pytest.approx(2.0, abs=0.05)  # side by side
        assert "ground" in moment.state
    finally:
        if follower is not None:
            follower.close()
        simulator.close()
