"""An agent and a ground station use their own UDP links at the same time. Neither disturbs the other.

The clients' streams follow the simulation's clock, so a busy machine delays the simulation and the setpoints equally.
"""

import socket
import threading
import time
from functools import partial

import pytest
from pymavlink import mavutil

from dronecats.flight.sitl.config import SimulatorConfig
from dronecats.flight.sitl.simulator_process import Simulator
from foundation.mavlink import dialect

SPEED = 4.0
PERIOD_US = 50_000  # period of the clients' streams, in the vehicle's time
PATIENCE_S = 30.0
ARM, SET_MODE, REQUEST_MESSAGE = 400, 176, 512
AUTOPILOT_VERSION = 148
OFFBOARD = 6  # PX4's main mode
HEALTHY = 0x10000000  # MAV_SYS_STATUS_PREARM_CHECK
POSITION_ONLY = 0x0DF8
NORTH, EAST, DOWN = 2.0, -1.0, -4.0
ITEMS = 40


class Client:
    """A typical pymavlink client that keeps every received message in order."""

    def __init__(self, port, system, component, kind):
        self.link = mavutil.mavlink_connection(
            f"udpout:127.0.0.1:{port}", source_system=system, source_component=component
        )
        self.me = (system, component)
        self._kind = kind
        self._setpoint = None
        self._ended = threading.Event()
        self._heard = []
        self._news = threading.Condition()
        self._sent = 0
        self._listener = threading.Thread(target=self._listen)
        self._listener.start()

    def stream(self):
        """Send the setpoint, and every tenth time a heartbeat. The simulation calls this every `PERIOD_US`."""
        if self._sent % 10 == 0:
            self.link.mav.heartbeat_send(self._kind, 8, 0, 0, 4)
        if self._setpoint is not None:
            self.link.mav.set_position_target_local_ned_send(
                0, 1, 1, 1, POSITION_ONLY, *self._setpoint, 0, 0, 0, 0, 0, 0, 0, 0
            )
        self._sent += 1

    def _listen(self):
        while not self._ended.is_set():
            message = self.link.recv_match(blocking=True, timeout=0.1)
            if message is not None:
                with self._news:
                    self._heard.append(message)
                    self._news.notify_all()

    def fly_to(self, north, east, down):
        self._setpoint = (north, east, down)

    def mark(self):
        """Return the position among the received messages, for `since`."""
        return len(self._heard)

    def _longer_than(self, count):
        return len(self._heard) > count

    def since(self, mark, *kinds):
        """Return the vehicle's messages of these kinds since `mark`, without forwarded heartbeats of other clients."""
        messages = self._heard[mark:]
        return [message for message in messages if message.get_srcSystem() == 1 and message.get_type() in kinds]

    def until(self, kind, wanted=lambda _: True, mark=None, system=1):
        """Return the first wanted message of a system after `mark` (default: from now on)."""
        at = self.mark() if mark is None else mark
        deadline = time.monotonic() + PATIENCE_S
        while True:
            with self._news:
                if not self._news.wait_for(partial(self._longer_than, at), deadline - time.monotonic()):
                    raise AssertionError(f"{kind} never became what it should")
                message, at = self._heard[at], at + 1
            if message.get_srcSystem() == system and message.get_type() == kind and wanted(message):
                return message

    def command(self, number, *parameters):
        mark = self.mark()
        self.link.mav.command_long_send(1, 1, number, 0, *parameters, *(0,) * (7 - len(parameters)))
        return self.until("COMMAND_ACK", lambda ack: ack.command == number, mark).result

    def close(self):
        self._ended.set()
        self._listener.join()
        self.link.close()


@pytest.fixture
def clients():
    """Clients whose streams the simulation calls. They are closed after it."""
    clients: list[Client] = []
    yield clients
    for client in clients:
        client.close()


@pytest.fixture
def simulator(clients):
    simulator = Simulator(SimulatorConfig(episode="residential-approaching-01", speed=SPEED, count=1))
    simulator.ready()
    ended = threading.Event()

    def turn():
        due_us = 0
        while not ended.is_set():
            if simulator.simulation.time_us >= due_us:
                due_us = simulator.simulation.time_us + PERIOD_US
                for client in list(clients):
                    client.stream()
            simulator.turn()

    thread = threading.Thread(target=turn)
    thread.start()
    yield simulator
    ended.set()
    thread.join()
    simulator.close()


@pytest.fixture
def agent(simulator, clients):
    client = Client(simulator.ports.agent[0].port, 245, 190, kind=18)
    clients.append(client)
    return client


@pytest.fixture
def ground(simulator, clients):
    client = Client(simulator.ports.gcs[0].port, 255, 190, kind=6)
    clients.append(client)
    return client


def list_parameters(client):
    """Return {index: name} of all parameters, and their reported count."""
    mark = client.mark()
    client.link.mav.param_request_list_send(1, 1)
    count = client.until("PARAM_VALUE", mark=mark).param_count
    client.until("PARAM_VALUE", lambda value: value.param_index == count - 1, mark)
    return {value.param_index: value.param_id for value in client.since(mark, "PARAM_VALUE")}, count


def upload_mission(client, count):
    """Upload `count` waypoints; return the type of the MISSION_ACK."""
    mark = client.mark()
    client.link.mav.mission_count_send(1, 1, count, 0)
    for seq in range(count):
        client.until("MISSION_REQUEST_INT", lambda request, seq=seq: request.seq == seq, mark)
        latitude = round((47.3977 + 1e-5 * seq) * 1e7)
        client.link.mav.mission_item_int_send(1, 1, seq, 6, 16, 0, 1, 0, 2, 0, float("nan"), latitude, 85456000, 20, 0)
    return client.until("MISSION_ACK", mark=mark).type


def test_a_ground_station_reads_parameters_and_uploads_a_mission_while_an_agent_flies(agent, ground):
    agent.until("SYS_STATUS", lambda status: status.onboard_control_sensors_health & HEALTHY)
    agent.fly_to(NORTH, EAST, DOWN)
    asked_ms = agent.until("ATTITUDE").time_boot_ms
    agent.until("ATTITUDE", lambda at: at.time_boot_ms > asked_ms + 200)  # PX4 requires a stream before the mode
    assert agent.command(ARM, 1) == 0
    assert agent.command(SET_MODE, 1, OFFBOARD) == 0
    agent.until("LOCAL_POSITION_NED", lambda at: abs(at.x - NORTH) + abs(at.y - EAST) + abs(at.z - DOWN) < 0.3)

    of_agent, of_ground = agent.mark(), ground.mark()
    acks: list[int] = []
    asking = threading.Thread(
        target=lambda: acks.extend(agent.command(REQUEST_MESSAGE, AUTOPILOT_VERSION) for _ in range(20))
    )
    asking.start()
    names, count = list_parameters(ground)
    mission = upload_mission(ground, ITEMS)
    asking.join()
    agent.until("HEARTBEAT")

    assert sorted(names) == list(range(count))
    assert len(set(names.values())) == count > 100
    assert mission == 0
    assert acks == [0] * 20
    assert len(agent.since(of_agent, "AUTOPILOT_VERSION")) == 20

    # a client does not receive the answers to the other client
    assert not agent.since(of_agent, "PARAM_VALUE", "MISSION_REQUEST_INT", "MISSION_REQUEST", "MISSION_ACK")
    assert not ground.since(of_ground, "AUTOPILOT_VERSION", "COMMAND_ACK")

    # the flight continues in the same mode at the same place
    assert {beat.custom_mode >> 16 for beat in agent.since(of_agent, "HEARTBEAT")} == {OFFBOARD}
    track = agent.since(of_agent, "LOCAL_POSITION_NED")
    assert len(track) > 10
    assert max(abs(at.x - NORTH) for at in track) < 1.0
    assert max(abs(at.z - DOWN) for at in track) < 1.0


def test_changes_by_one_client_are_read_by_the_other(agent, ground):
    agent.until("HEARTBEAT")
    ground.until("HEARTBEAT")
    assert upload_mission(ground, 3) == 0
    mark = agent.mark()
    agent.link.mav.mission_request_list_send(1, 1, 0)
    assert agent.until("MISSION_COUNT", mark=mark).count == 3

    agent.link.mav.param_set_send(1, 1, b"MIS_TAKEOFF_ALT", 3.5, 9)
    agent.until("PARAM_VALUE", lambda value: value.param_id == "MIS_TAKEOFF_ALT", mark)
    mark = ground.mark()
    ground.link.mav.param_request_read_send(1, 1, b"MIS_TAKEOFF_ALT", -1)
    # PARAM_VALUE may also be the announcement of the change: the same number either way
    assert ground.until("PARAM_VALUE", lambda value: value.param_id == "MIS_TAKEOFF_ALT", mark).param_value == 3.5


def test_a_client_that_begins_with_mavlink_1_does_not_disturb_other_clients(simulator, agent):
    agent.until("HEARTBEAT")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as old:
        packer = dialect.MAVLink(None, srcSystem=255, srcComponent=190)
        beat = dialect.MAVLink_heartbeat_message(dialect.MAV_TYPE_GCS, 8, 0, 0, 4, 3)
        old.sendto(beat.pack(packer, force_mavlink1=True), ("127.0.0.1", simulator.ports.gcs[0].port))
    heartbeat = agent.until("HEARTBEAT", lambda beat: beat.get_srcSystem() == 255, system=255)
    assert (heartbeat.get_srcComponent(), heartbeat.type) == (190, dialect.MAV_TYPE_GCS)
    agent.until("HEARTBEAT")  # the vehicle still sends heartbeats
