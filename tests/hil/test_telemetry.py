from hypothesis import given
from hypothesis import strategies as st

from dronecats.border.mavlink import MODES, Packer, Parser, dialect, mode_name
from hil.telemetry import VehicleClock, VehicleState, update


def test_clock_survives_the_wrap_of_49_days():
    clock = VehicleClock()
    clock.see((1 << 32) - 50)
    before = clock.time_us
    clock.see(30)
    assert clock.time_us == before + 80_000


def test_clock_ignores_late_packets_and_notices_a_reboot():
    clock = VehicleClock()
    clock.see(100_000)
    clock.see(99_900)
    assert clock.time_us == 100_000_000
    clock.see(700)
    assert clock.time_us == 700_000
    assert clock.reboots == 1


@given(st.lists(st.integers(0, (1 << 32) - 1), max_size=30))
def test_clock_never_runs_backwards_without_a_reboot(stamps):
    clock = VehicleClock()
    for stamp in stamps:
        before, reboots = clock.time_us, clock.reboots
        clock.see(stamp)
        assert clock.time_us >= before or clock.reboots > reboots


def test_mode_names_are_a_bijection():
    assert {mode_name(mode.custom_mode) for mode in MODES.values()} == set(MODES)
    assert MODES["HOLD"].custom_mode == 50593792
    assert MODES["OFFBOARD"].custom_mode == 393216
    assert mode_name(0x07000000 | 9 << 16) == "9/7"


def test_state_follows_the_messages():
    state = VehicleState()
    beat = dialect.MAVLink_heartbeat_message(2, 12, 129, MODES["OFFBOARD"].custom_mode, 4, 3)
    state = update(state, beat)
    assert state.armed
    assert state.mode == "OFFBOARD"
    state = update(state, dialect.MAVLink_statustext_message(6, b"all is well"))
    assert state.status_text == ""
    state = update(state, dialect.MAVLink_statustext_message(2, b"Arming denied: no GPS"))
    assert state.status_text == "Arming denied: no GPS"


@given(st.binary(max_size=300), st.integers(1, 20))
def test_garbage_between_messages_is_skipped(garbage, count):
    packer, parser = Packer(1, 1), Parser()
    beat = dialect.MAVLink_heartbeat_message(2, 12, 129, 0, 4, 3)
    parser.feed(garbage)
    got = 0
    for _ in range(count + 25):  # a false start may swallow at most one frame of 280 bytes
        got += len([m for m in parser.feed(packer.pack(beat)) if m.get_type() == "HEARTBEAT"])
    assert got >= count
