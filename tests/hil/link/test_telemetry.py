import pytest
from hypothesis import given
from hypothesis import strategies as st

from foundation.errors import LinkError
from foundation.mavlink import MODES, Packer, Parser, dialect, mode_name
from hil.link.link import Link
from hil.link.telemetry import VehicleClock, VehicleState, update
from tests.hil.link.scripted_vehicle import ScriptedVehicle


def test_clock_handles_the_wrap_after_49_days():
    clock = VehicleClock()
    clock.see((1 << 32) - 50, 0.0)
    before = clock.time_us
    clock.see(30, 0.1)
    assert clock.time_us == before + 80_000


def test_clock_ignores_late_packets_and_detects_a_reboot():
    clock = VehicleClock()
    clock.see(100_000, 0.0)
    clock.see(99_900, 0.1)
    assert clock.time_us == 100_000_000
    for n in range(10):
        clock.see(700 + 50 * n, 1.0 + 0.05 * n)
    assert clock.time_us == 1_150_000
    assert clock.reboots == 1


DAY_MS = 24 * 3600 * 1000


@pytest.mark.parametrize("before_ms", [600_000, 30 * DAY_MS, 49 * DAY_MS])  # the uint32 wraps after 49.7 days
@pytest.mark.parametrize(("away_s", "up_ms"), [(310.0, 300_000), (30.0, 25_000), (2.0, 700)])
def test_a_vehicle_that_rebooted_before_it_is_seen_again_is_recognised(before_ms, away_s, up_ms):
    clock = VehicleClock()
    clock.see(before_ms, 0.0)
    for n in range(10):
        clock.see(up_ms + 50 * n, away_s + 0.05 * n)
    assert clock.reboots == 1
    assert clock.time_us == (up_ms + 450) * 1000


@pytest.mark.parametrize("before_ms", [600_000, 30 * DAY_MS])
def test_a_recording_shows_a_reboot_with_any_uptime(before_ms):
    clock = VehicleClock()
    for stamp in (before_ms, *range(300_000, 300_500, 50)):
        clock.see(stamp)
    assert clock.reboots == 1
    assert clock.time_us == 300_450_000


def test_delayed_messages_are_not_a_reboot():
    clock = VehicleClock()
    clock.see(600_000, 0.0)
    for n in range(2400):  # another path brings what was sent eight minutes ago, at its own pace
        clock.see(120_000 + 50 * n, 0.05 * n)
    assert clock.reboots == 0
    assert clock.time_us == 600_000_000


def test_a_wrap_during_a_gap_is_not_a_reboot():
    clock = VehicleClock()
    clock.see((1 << 32) - 30_000, 0.0)
    for n in range(10):
        clock.see(570_000 + 50 * n, 600.0 + 0.05 * n)
    assert clock.reboots == 0
    assert clock.time_us == ((1 << 32) + 570_450) * 1000


@pytest.mark.parametrize("claimed_ms", [700, 300_000])
def test_contradicting_timestamps_are_ignored_while_consistent_ones_arrive(claimed_ms):
    clock = VehicleClock()
    for n in range(200):
        clock.see(100_000 + 50 * n, 0.05 * n)
        for k in range(9):
            clock.see(claimed_ms + 10 * k, 0.05 * n)
    assert clock.time_us == (100_000 + 50 * 199) * 1000
    assert clock.reboots == 0


def test_a_burst_of_timestamps_does_not_confirm_a_reboot():
    clock = VehicleClock()
    clock.see(100_000, 0.0)
    for n in range(100):
        clock.see(700 + n, 0.1)
    assert clock.reboots == 0


@pytest.mark.parametrize("damaged_ms", [4_000_000_000, 2_000_000_000, 300_000, 5])
def test_one_damaged_timestamp_does_not_affect_the_clock(damaged_ms):
    clock = VehicleClock()
    clock.see(100_000, 0.0)
    clock.see(damaged_ms, 0.0)
    for stamp in (100_020, 100_040):
        clock.see(stamp, stamp / 1000 - 100)
        assert clock.time_us == stamp * 1000
    assert clock.reboots == 0


def test_a_late_packet_from_before_the_wrap_is_ignored():
    clock = VehicleClock()
    for stamp in ((1 << 32) - 50, 30, (1 << 32) - 10, 50):
        clock.see(stamp, 0.0)
    assert clock.time_us == ((1 << 32) + 50) * 1000


def test_the_clock_follows_a_vehicle_that_returns_after_minutes():
    clock = VehicleClock()
    for stamp in (100_000, *range(500_000, 500_400, 20)):
        clock.see(stamp, stamp / 1000)
    assert clock.time_us == 500_380_000


def test_a_late_message_keeps_its_own_time():
    clock = VehicleClock()
    assert clock.of(90) == 0  # no time has arrived yet
    for stamp in ((1 << 32) - 50, 30):
        clock.see(stamp, 0.0)
    now_us = ((1 << 32) + 30) * 1000
    assert [clock.of(stamp) for stamp in (30, 10, (1 << 32) - 10)] == [now_us, now_us - 20_000, now_us - 40_000]
    assert clock.of(40) == now_us  # a damaged stamp has no effect


def test_a_stamp_more_than_five_seconds_old_has_no_time():
    clock = VehicleClock()
    clock.see(100_000)
    assert [clock.of(stamp) for stamp in (95_000, 94_999, 700)] == [95_000_000, None, None]


@pytest.mark.parametrize("late_ms", [4_000, 6_000, 90_000])
def test_an_old_message_does_not_change_the_present_pose(late_ms):
    vehicle = ScriptedVehicle()
    link = Link(vehicle.transport())
    link.connect(10.0)
    link.wait(100.0)
    then_ms = vehicle.time_ms - late_ms
    vehicle.say(dialect.MAVLink_local_position_ned_message(then_ms, 50.0, 60.0, -9.0, 0, 0, 0))
    vehicle.say(dialect.MAVLink_attitude_message(then_ms, 0, 0, 2.0, 0, 0, 0))
    link.listen()
    assert link.state.position_ned == (0.0, 0.0, -2.5)
    assert link.state.euler == (0.0, 0.0, 0.0)
    for time_us in (link.time_us, link.time_us - 1_000_000):
        pose = link.track.at(time_us)
        assert pose is not None
        assert pose.position_ned == (0.0, 0.0, -2.5)


def test_a_rebooted_vehicle_is_recognised_by_its_pose_messages():
    vehicle = ScriptedVehicle()
    link = Link(vehicle.transport())
    link.connect(10.0)
    link.wait(10.0)
    vehicle.time_ms, vehicle.position = 1000, [5.0, 0.0, 0.0]
    with pytest.raises(LinkError, match="rebooted"):
        link.wait(5.0)
    link.wait(1.0)
    assert link.state.position_ned == (5.0, 0.0, 0.0)


def test_late_messages_do_not_change_the_state():
    place = dialect.MAVLink_local_position_ned_message(1, 1, 2, 3, 0, 0, 0)
    angles = dialect.MAVLink_attitude_message(1, 0, 0, 1, 0, 0, 0)
    older = dialect.MAVLink_local_position_ned_message(0, 9, 9, 9, 0, 0, 0)
    turned = dialect.MAVLink_attitude_message(0, 0, 0, 2, 0, 0, 0)
    state = update(update(VehicleState(), place, 2000), angles, 2000)
    assert update(update(state, older, 1999), turned, 1999) == state
    assert update(state, older, 2000).position_ned == (9.0, 9.0, 9.0)


def test_messages_with_nan_or_infinity_are_ignored():
    state = update(VehicleState(), dialect.MAVLink_local_position_ned_message(1, 1, 2, 3, 0, 0, 0), 1000)
    nan = float("nan")
    for bad in (
        dialect.MAVLink_local_position_ned_message(2, 1, nan, 3, 0, 0, 0),
        dialect.MAVLink_local_position_ned_message(2, 1, 2, 3, 0, 0, float("inf")),
        dialect.MAVLink_attitude_message(2, 0, 0, nan, 0, 0, 0),
        dialect.MAVLink_home_position_message(0, 0, 0, nan, 0, 0, [1, 0, 0, 0], 0, 0, 0),
    ):
        assert update(state, bad, 2000) == state


@given(st.lists(st.integers(0, (1 << 32) - 1), max_size=30))
def test_clock_never_runs_backwards_without_a_reboot(stamps):
    clock = VehicleClock()
    for n, stamp in enumerate(stamps):
        before, reboots = clock.time_us, clock.reboots
        clock.see(stamp, 0.1 * n)
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


@given(st.binary(max_size=300), st.integers(1, 20))
def test_garbage_between_messages_is_skipped(garbage, count):
    packer, parser = Packer(1, 1), Parser()
    beat = dialect.MAVLink_heartbeat_message(2, 12, 129, 0, 4, 3)
    parser.feed(garbage)
    got = 0
    for _ in range(count + 25):  # garbage may look like a frame start and swallow up to 280 bytes
        got += len([m for m in parser.feed(packer.pack(beat)) if m.get_type() == "HEARTBEAT"])
    assert got >= count
