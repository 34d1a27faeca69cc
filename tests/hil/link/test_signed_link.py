"""A link with a key signs its messages (MAVLink 2) and accepts only messages signed with the same key."""

import pytest

from dronecats.flight.sitl.simulation import BootPose, SimulatedVehicle, Simulation
from dronecats.flight.stages.lockstep import Lockstep
from foundation.errors import LinkError
from foundation.mavlink import Packer, dialect
from foundation.setpoints import Velocity
from hil.link.link import Link
from tests.hil.link.scripted_vehicle import ScriptedVehicle
from tests.hil.link.test_impostor import ATTACKS
from vehicles import airframe

KEY, OTHER = bytes(range(1, 33)), bytes(range(2, 34))
NO_KEY = bytes(32)  # PX4 1.17 signs with this key until it gets another one, and accepts every sender
UNIX_S = 1_790_000_000.0


class SigningVehicle(ScriptedVehicle):
    """A scripted vehicle that signs and verifies with pymavlink, independently of our implementation."""

    def __init__(self, key=KEY):
        super().__init__()
        self.mav = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
        self.mav.robust_parsing = True
        self.mav.signing.secret_key, self.mav.signing.sign_outgoing = key, True
        self.mav.signing.timestamp = round((UNIX_S - 1_420_070_400 - 20) * 1e5)
        self.mav.signing.link_id = 1

    def say(self, message):
        if message.get_msgId() not in self.silent:
            self.out += message.pack(self.mav)

    def give(self, data):
        for message in self.mav.parse_buffer(data) or []:
            if message.get_type() == "COMMAND_LONG":
                self.command(message)
            elif message.get_type() == "SET_POSITION_TARGET_LOCAL_NED":
                self.setpoints.append((self.time_ms, message))


def link_to(vehicle, key=KEY):
    return Link(vehicle.transport(), key=key, unix_s=lambda: UNIX_S)


def test_a_signing_vehicle_flies_and_receives_only_validly_signed_messages():
    vehicle = SigningVehicle()
    link = link_to(vehicle)
    link.connect(10.0)
    link.fly(Velocity(1.2, None), 60.0)
    link.start_offboard()
    link.wait(3.0)
    signing = vehicle.mav.signing
    assert vehicle.position[0] > 3.0
    assert signing.goodsig_count > 60
    assert (signing.badsig_count, signing.reject_count) == (0, 0)


@pytest.mark.parametrize("attack", ATTACKS.values(), ids=ATTACKS.keys())
@pytest.mark.parametrize("key", [None, OTHER])
def test_messages_not_signed_with_the_key_are_ignored(attack, key):
    vehicle = SigningVehicle()
    link = link_to(vehicle)
    link.connect(10.0)
    link.fly(Velocity(1.2, None), 60.0)
    link.start_offboard()
    link.wait(1.0)
    forger = SigningVehicle(key=key).mav if key else None
    plain = Packer(1, 1)

    def step(step=vehicle.step):
        step()
        vehicle.out += b"".join(message.pack(forger) if forger else plain.pack(message) for message in attack)

    link.transport._pump = step
    link.wait(3.0)
    assert link.taken_by is None
    assert link.clock.reboots == 0
    assert link.state.position_ned == pytest.approx(vehicle.position, abs=0.2)


def test_a_replayed_message_is_ignored():
    vehicle = SigningVehicle()
    link = link_to(vehicle)
    link.connect(10.0)
    vehicle.mode = "LAND"
    vehicle.out = b""
    vehicle.say(vehicle.heartbeat())
    recorded = vehicle.out
    vehicle.mode = "HOLD"
    link.wait(3.0)
    assert link.state.mode == "HOLD"
    vehicle.out += recorded
    link.wait(0.1)
    assert link.state.mode == "HOLD"


def test_a_forged_timestamp_does_not_block_the_vehicle():
    vehicle = SigningVehicle()
    link = link_to(vehicle)
    link.connect(10.0)
    forger = SigningVehicle(key=OTHER)
    forger.mav.signing.timestamp *= 100
    vehicle.out += forger.heartbeat().pack(forger.mav)
    link.wait(10.0)
    assert link.state.heartbeat_us > link.time_us - 1_500_000


@pytest.mark.parametrize(
    ("vehicle", "key", "expected"),
    [
        (ScriptedVehicle(), KEY, "does not sign"),
        (SigningVehicle(key=NO_KEY), KEY, "does not sign"),
        (SigningVehicle(key=OTHER), KEY, "another key"),
    ],
    ids=["no key", "PX4 without a key", "another key"],
)
def test_the_connect_error_states_the_signing_problem_without_the_key(vehicle, key, expected):
    with pytest.raises(LinkError, match=expected) as refusal:
        link_to(vehicle, key).connect(5.0)
    assert all(str(part) not in str(refusal.value) for part in (KEY, KEY.hex(), OTHER.hex()))


def test_an_unsigned_link_to_a_signing_vehicle_raises_an_error_that_names_the_option():
    vehicle = SigningVehicle()
    link = link_to(vehicle, key=b"")
    link.connect(10.0)
    with pytest.raises(LinkError, match="--sign"):
        link.set_mode("HOLD")


def test_an_unsigned_link_to_a_px4_without_a_key_raises_no_signing_error():
    vehicle = SigningVehicle(key=NO_KEY)
    link = link_to(vehicle, key=b"")
    link.connect(10.0)
    with pytest.raises(LinkError) as refusal:
        link.set_mode("HOLD")
    assert "--sign" not in str(refusal.value)


def simulated():
    vehicle = SimulatedVehicle(0, airframe.load("x500"), BootPose((0, 0, 0), 0.0), seed=4, origin=(47.4, 8.5, 488.0))
    return vehicle, Lockstep(Simulation([vehicle])).transport(0)


def test_the_simulator_accepts_a_key_and_then_obeys_only_its_owner():
    vehicle, transport = simulated()
    link = Link(transport, unix_s=lambda: UNIX_S)
    link.connect()
    link.give_key(KEY)
    stranger = Packer(246, 1)
    link.wait_for(lambda state: state.healthy, 60.0, "becoming ready")
    link.arm()
    link.order("take-off", dialect.MAV_CMD_NAV_TAKEOFF)
    link.wait(6.0)
    assert vehicle.plant.truth["position_ned"][2] < -1.0
    transport.send(stranger.pack(dialect.MAVLink_command_long_message(1, 1, 400, 0, 0, 21196, 0, 0, 0, 0, 0)))
    link.wait(2.0)
    assert link.state.armed
    another = Link(transport, key=OTHER, unix_s=lambda: UNIX_S)
    with pytest.raises(LinkError, match="another key"):
        another.connect(3.0)
    again = Link(transport, key=KEY, unix_s=lambda: UNIX_S + 60.0)
    again.connect()


def test_a_vehicle_that_rejects_the_key_is_reported():
    vehicle = ScriptedVehicle()
    vehicle.armed = False
    link = link_to(vehicle, key=b"")
    link.connect(10.0)
    with pytest.raises(LinkError, match=r"1\.17"):
        link.give_key(KEY)


def test_no_key_is_sent_to_an_armed_vehicle():
    vehicle = ScriptedVehicle()
    link = link_to(vehicle, key=b"")
    link.connect(10.0)
    link.wait(1.5)
    with pytest.raises(LinkError, match="armed"):
        link.give_key(KEY)


def test_no_key_is_sent_to_a_vehicle_that_was_armed_since_the_last_message():
    vehicle = ScriptedVehicle()
    vehicle.armed = False
    link = link_to(vehicle, key=b"")
    link.connect(10.0)
    link.wait(1.5)
    vehicle.armed = True
    with pytest.raises(LinkError, match="armed"):
        link.give_key(KEY)
    assert not link.has_key


def test_a_vehicle_that_sends_no_heartbeat_gets_no_key():
    vehicle = ScriptedVehicle()
    link = link_to(vehicle, key=b"")
    link.connect(10.0)
    vehicle.silent.add(dialect.MAVLINK_MSG_ID_HEARTBEAT)
    with pytest.raises(LinkError, match="no heartbeat"):
        link.give_key(KEY)
    assert not link.has_key
