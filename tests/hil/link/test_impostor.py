"""Other programs send to the link's port with the vehicle's system id. The flight continues and reports this."""

import pytest

from foundation.errors import LinkError
from foundation.mavlink import MODES, Packer, Parser, dialect
from foundation.setpoints import Velocity
from hil.link.link import Link, TakeoverError
from hil.link.transport import MemoryTransport, UdpTransport
from tests.hil.link import listening
from tests.hil.link.scripted_vehicle import ScriptedVehicle

VEHICLE, STRANGER = "127.0.0.1:14580", "127.0.0.1:40404"


class SharedPort(MemoryTransport):
    """A UDP port that receives the vehicle's messages and, before each of them, the stranger's data if there is any."""

    def __init__(self, vehicle):
        def step():
            vehicle.step()

        super().__init__("udpin://:14540", vehicle.take, vehicle.give, step, lambda: vehicle.time_ms / 1000)
        self.vehicle_at = VEHICLE
        self.stranger = b""
        self.followed = []

    def receive(self, timeout_s):
        if self.stranger and self.peer != STRANGER and timeout_s > 0.0:
            self.peer = STRANGER
            return self.stranger
        data, self.peer = super().receive(timeout_s), self.vehicle_at
        return data

    def follow(self, peer):
        self.followed.append(peer)


@pytest.fixture
def vehicle():
    return ScriptedVehicle()


@pytest.fixture
def port(vehicle):
    return SharedPort(vehicle)


def flying(port):
    """Return a link that has flown the vehicle forward for 1 s, and the list of its notices since then."""
    link = Link(port)
    notices: list[str] = []
    link.connect(10.0)
    link.fly(Velocity(1.2, None), 60.0)
    link.start_offboard()
    link.wait(1.0)
    link.on_notice = notices.append
    return link, notices


def attitude(time_ms):
    return dialect.MAVLink_attitude_message(time_ms, 0, 0, 0, 0, 0, 0)


def beat(mode, armed):
    return dialect.MAVLink_heartbeat_message(2, 12, 1 | 128 * armed, MODES[mode].custom_mode, 4, 3)


ATTACKS = {
    "a reboot": [attitude(500 + 20 * n) for n in range(8)],
    "a disarming": [beat("OFFBOARD", armed=False)],
    "a pilot's hand": [beat("POSCTL", armed=True)],
    "another place": [dialect.MAVLink_local_position_ned_message(1 << 31, 900, 0, -2, 0, 0, 0)],
}


@pytest.mark.parametrize("attack", ATTACKS.values(), ids=ATTACKS.keys())
def test_messages_of_another_sender_do_not_affect_a_flight(vehicle, port, attack):
    link, notices = flying(port)
    forger = Packer(1, 1)
    port.stranger = b"".join(map(forger.pack, attack))
    sent = len(vehicle.setpoints)
    link.wait(5.0)
    assert link.taken_by is None
    assert link.state.armed
    assert link.state.mode == "OFFBOARD"
    assert link.state.position_ned == pytest.approx(vehicle.position, abs=0.2)
    assert len(vehicle.setpoints) > sent + 90
    assert notices  # at least one, but not one per message
    assert len(notices) < 5
    assert STRANGER in notices[0]
    assert port.followed == [VEHICLE]


def test_an_incomplete_frame_of_another_sender_does_not_delay_telemetry(vehicle, port):
    link, _ = flying(port)
    port.stranger, late = Packer(1, 1).pack(attitude(500))[:20], []
    link.on_wait = lambda: late.append(vehicle.time_ms * 1000 - link.state.position_us)
    link.wait(2.0)
    assert max(late) <= 40_000


def test_a_camera_of_the_same_system_at_another_address_causes_no_notice(vehicle, port):
    link, notices = flying(port)
    components, camera = [], Packer(1, 100)
    link.listeners.append(lambda message: components.append(message.get_srcComponent()))
    port.stranger = camera.pack(beat("HOLD", armed=False))
    link.wait(1.0)
    assert notices == []
    assert 100 in components


def test_copies_have_no_messages_of_other_vehicles_on_the_port(vehicle, port):
    link, parser = Link(port), Parser()
    systems: list[int] = []

    def keep(data):
        systems.extend(message.get_srcSystem() for message in parser.feed(data))

    link.copy_to(MemoryTransport("memory://", bytes, keep, lambda: None, lambda: 0.0))
    port.stranger = Packer(2, 1).pack(dialect.MAVLink_local_position_ned_message(500, 9, 9, -9, 0, 0, 0))
    link.connect()
    link.wait(1.0)
    assert set(systems) == {1}


def test_the_link_follows_a_vehicle_whose_address_changes_after_a_gap(vehicle, port):
    link, notices = flying(port)
    streamed, vehicle.silent = vehicle.silent, {30, 32, 0, 1, 245, 242}
    back_ms = vehicle.time_ms + 4000

    def bridge():
        if vehicle.time_ms >= back_ms:
            vehicle.silent, port.vehicle_at = streamed, STRANGER

    link.on_wait = bridge
    link.wait(6.0)
    assert link.taken_by is None
    assert port.followed == [VEHICLE, STRANGER]
    assert len(notices) == 1


def test_a_udp_read_holds_data_of_one_address_and_replies_go_to_the_followed_address():
    server = listening.udp()
    vehicle, stranger = (UdpTransport("udpout://", "127.0.0.1", server.port, listen=False) for _ in "12")
    for end, word in ((vehicle, b"one "), (vehicle, b"two"), (stranger, b"three"), (vehicle, b"four")):
        end.send(word)
    reads = [(server.receive(2.0), server.peer) for _ in range(3)]
    assert [data for data, _ in reads] == [b"one two", b"three", b"four"]
    addresses = [f"127.0.0.1:{end.port}" for end in (vehicle, stranger)]
    assert [peer for _, peer in reads] == [addresses[0], addresses[1], addresses[0]]
    server.follow(addresses[0])
    server.send(b"setpoint")
    assert [vehicle.receive(2.0), stranger.receive(0.0)] == [b"setpoint", b""]
    for wire in (server, vehicle, stranger):
        wire.close()


# -- the vehicle's own address ------------------------------------------------------------------------------------


def test_a_single_disarmed_heartbeat_in_flight_is_ignored(vehicle, port):
    link, _ = flying(port)
    vehicle.out += vehicle.packer.pack(beat("OFFBOARD", armed=False))
    sent = len(vehicle.setpoints)
    link.wait(5.0)
    assert link.taken_by is None
    assert len(vehicle.setpoints) > sent + 90


def test_repeated_disarmed_heartbeats_end_control(vehicle, port):
    link, _ = flying(port)
    vehicle.armed = False
    said_ms = vehicle.time_ms
    with pytest.raises(TakeoverError, match="disarmed"):
        link.wait(10.0)
    assert vehicle.time_ms - said_ms < 4000
    sent = len(vehicle.setpoints)
    with pytest.raises(TakeoverError):
        link.tick()
    assert len(vehicle.setpoints) == sent


def test_bursts_of_old_timestamps_between_current_ones_are_not_a_reboot(vehicle, port):
    link, _ = flying(port)

    def burst(step=vehicle.step):
        step()
        if vehicle.time_ms % 200 == 0:
            vehicle.out += b"".join(vehicle.packer.pack(attitude(500 + 20 * n)) for n in range(10))

    vehicle.step = burst
    link.wait(3.0)
    assert link.clock.reboots == 0
    assert link.time_us == pytest.approx(vehicle.time_ms * 1000, abs=60_000)


@pytest.mark.parametrize("handed_over", [True, False])
def test_after_a_reboot_in_flight_give_up_can_still_hold_the_vehicle(vehicle, port, handed_over):
    link = Link(port)
    link.connect(10.0)
    if not handed_over:
        link.arm()
    vehicle.time_ms = 30_000
    link.fly(Velocity(1.2, None), 60.0)
    link.start_offboard()
    link.wait(1.0)
    vehicle.refuses = {dialect.MAV_CMD_COMPONENT_ARM_DISARM: (2, "")}  # the vehicle flies
    vehicle.time_ms, vehicle.mode = 100, "OFFBOARD"
    with pytest.raises(LinkError, match="rebooted"):
        link.wait(10.0)
    assert vehicle.time_ms < 3000
    assert link.may_fly()
    link.give_up("hold")
    assert vehicle.mode == "HOLD"
