"""`dronecats sitl --sign`: every port of the vehicle requires the key, from boot and after a reboot."""

import threading

import pytest

from dronecats.flight.sitl.config import SimulatorConfig
from dronecats.flight.sitl.simulator_process import Simulator
from foundation.errors import LinkError
from foundation.mavlink import dialect
from hil.link.link import Link
from hil.link.transport import connect

KEY = bytes(range(1, 33))


@pytest.fixture
def ports(tmp_path):
    """Ports of a running simulator, ten times as fast as the wall clock."""
    (tmp_path / "key").write_text(KEY.hex())
    simulator = Simulator(SimulatorConfig(episode="open-ground", count=1, speed=10.0, sign=str(tmp_path / "key")))
    ready_ports, ended = simulator.ready(), threading.Event()

    def turn():
        while not ended.is_set():
            simulator.turn()

    thread = threading.Thread(target=turn)
    thread.start()
    yield ready_ports
    ended.set()
    thread.join()
    simulator.close()


def test_only_clients_with_the_key_are_obeyed_before_and_after_a_reboot(ports):
    url = f"udpout://127.0.0.1:{ports['agent'][0]}"
    stranger = Link(connect(url))
    stranger.connect()
    with pytest.raises(LinkError, match="--sign"):
        stranger.set_mode("HOLD")
    stranger.close()
    thief = Link(connect(url), key=KEY[::-1])
    with pytest.raises(LinkError, match="another key"):
        thief.connect(0.5)
    thief.close()
    owner = Link(connect(url), key=KEY)
    owner.connect()
    owner.command(dialect.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1)
    owner.close()
    again = Link(connect(url), key=KEY)
    again.connect()
    again.set_mode("HOLD")
    again.close()
    log = Link(connect(f"udpout://127.0.0.1:{ports['log'][0]}"))
    with pytest.raises(LinkError):
        log.connect(0.5)
    log.close()
