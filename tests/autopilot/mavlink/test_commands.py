"""Acknowledgements, arming and requests, as measured on a real PX4."""

import itertools
import math

import pytest
from pymavlink import mavutil

from foundation.mavlink import MODES, dialect
from tests.autopilot.commander_bench import ORIGIN, Bench, Client

ACCEPTED, REJECTED, DENIED, UNSUPPORTED, FAILED = 0, 1, 2, 3, 4
ARM = dialect.MAV_CMD_COMPONENT_ARM_DISARM


@pytest.mark.parametrize(
    ("command", "parameters", "result"),
    [
        (dialect.MAV_CMD_DO_CHANGE_SPEED, (1, 3), ACCEPTED),
        (dialect.MAV_CMD_DO_SET_HOME, (1,), ACCEPTED),
        (dialect.MAV_CMD_GET_HOME_POSITION, (), ACCEPTED),
        (dialect.MAV_CMD_RUN_PREARM_CHECKS, (), ACCEPTED),
        (dialect.MAV_CMD_PREFLIGHT_CALIBRATION, (0, 0, 0, 0, 0, 0, 0), ACCEPTED),
        (dialect.MAV_CMD_NAV_TAKEOFF, (), ACCEPTED),
        (dialect.MAV_CMD_NAV_LAND, (), ACCEPTED),
        (dialect.MAV_CMD_NAV_RETURN_TO_LAUNCH, (), ACCEPTED),
        (dialect.MAV_CMD_DO_ORBIT, (10, 2), ACCEPTED),
        (dialect.MAV_CMD_DO_REPOSITION, (-1, 1), ACCEPTED),
        (dialect.MAV_CMD_DO_REPOSITION, (-1, 0), UNSUPPORTED),
        (dialect.MAV_CMD_MISSION_START, (), DENIED),
        (dialect.MAV_CMD_DO_FLIGHTTERMINATION, (0,), DENIED),
        (dialect.MAV_CMD_DO_FLIGHTTERMINATION, (1,), DENIED),
        (dialect.MAV_CMD_NAV_LOITER_UNLIM, (), UNSUPPORTED),
        (dialect.MAV_CMD_DO_PAUSE_CONTINUE, (0,), UNSUPPORTED),
        (dialect.MAV_CMD_NAV_GUIDED_ENABLE, (1,), UNSUPPORTED),
        (dialect.MAV_CMD_DO_MOTOR_TEST, (1,), UNSUPPORTED),
        (dialect.MAV_CMD_IMAGE_START_CAPTURE, (), UNSUPPORTED),
        (dialect.MAV_CMD_USER_1, (), UNSUPPORTED),
        (60000, (), UNSUPPORTED),
        (dialect.MAV_CMD_REQUEST_MESSAGE, (dialect.MAVLINK_MSG_ID_ATTITUDE,), ACCEPTED),
        (dialect.MAV_CMD_REQUEST_MESSAGE, (54321,), DENIED),
        (dialect.MAV_CMD_SET_MESSAGE_INTERVAL, (dialect.MAVLINK_MSG_ID_ATTITUDE, 20000), ACCEPTED),
        (dialect.MAV_CMD_SET_MESSAGE_INTERVAL, (54321, 20000), FAILED),
        (dialect.MAV_CMD_GET_MESSAGE_INTERVAL, (dialect.MAVLINK_MSG_ID_ATTITUDE,), ACCEPTED),
    ],
)
def test_command_results_while_disarmed(bench: Bench, command: int, parameters: tuple[float, ...], result: int) -> None:
    for _ in range(2):  # a client that missed the acknowledgement repeats the command
        assert bench.client.command(command, *parameters) == result
    assert not bench.commander.armed


@pytest.mark.parametrize("command", [dialect.MAV_CMD_NAV_TAKEOFF, dialect.MAV_CMD_NAV_LAND, dialect.MAV_CMD_DO_ORBIT])
def test_command_int_has_the_same_effect_as_command_long(bench: Bench, command: int) -> None:
    assert bench.client.command_int(command, (math.nan,) * 4, z=math.nan) == ACCEPTED
    assert bench.commander.mode in ("TAKEOFF", "LAND", "ORBIT")


def test_arming_and_disarming_are_idempotent(bench: Bench) -> None:
    client = bench.client
    assert [client.arm(), client.arm()] == [ACCEPTED, ACCEPTED]
    assert bench.commander.armed
    assert [client.disarm(), client.disarm()] == [ACCEPTED, ACCEPTED]
    assert client.disarm(force=True) == ACCEPTED
    assert not bench.commander.armed


def test_commands_to_other_targets_fail_and_broadcasts_get_no_acknowledgement(bench: Bench) -> None:
    client = bench.client
    assert client.command(ARM, 1, target=(7, 1)) == FAILED
    assert client.command(ARM, 1, target=(1, 190)) == FAILED
    assert client.command(ARM, 1, target=(0, 0)) is None
    assert client.command(ARM, 2) is None
    assert client.command(ARM, math.nan) is None
    assert not bench.commander.armed
    assert client.command(ARM, 1, target=(1, 0)) == ACCEPTED  # pymavlink addresses component 0


def test_a_vehicle_that_is_not_ready_rejects_arming_with_a_reason() -> None:
    bench = Bench(profile="minimal", converged=False)
    assert bench.client.arm() == REJECTED
    assert any(text.startswith("Arming denied: ") for text in bench.client.texts())
    assert bench.client.command(dialect.MAV_CMD_RUN_PREARM_CHECKS) == ACCEPTED
    assert any(text.startswith("Preflight Fail: ") for text in bench.client.texts())
    bench.run(1.0)
    assert bench.client.of("HEARTBEAT")[-1].system_status == 0
    bench.core.converge()
    bench.run(2.0)
    assert bench.client.of("HEARTBEAT")[-1].system_status == 3
    assert bench.client.arm() == ACCEPTED


def test_an_empty_battery_cannot_arm(bench: Bench) -> None:
    bench.sensors["battery_remaining"] = 0.05
    assert bench.client.arm() == REJECTED
    assert any("battery" in text for text in bench.client.texts())


def test_land_mode_selected_on_the_ground_prevents_arming(bench: Bench) -> None:
    bench.client.command(dialect.MAV_CMD_NAV_LAND)
    assert bench.client.arm() == DENIED
    assert bench.client.mode(4, 3) == ACCEPTED
    assert bench.client.arm() == ACCEPTED


def test_every_mode_can_be_selected_while_disarmed(bench: Bench) -> None:
    for mode in [m for m in MODES.values() if m.name not in ("READY", "TERMINATION", "ORBIT")]:
        assert bench.client.mode(mode.main, mode.sub) == ACCEPTED, mode.name
        bench.run(1.1)
        assert bench.client.of("HEARTBEAT")[-1].custom_mode == mode.custom_mode, mode.name


@pytest.mark.parametrize(
    ("parameters", "result", "mode"),
    [
        ((1, 42, 0), ACCEPTED, "HOLD"),
        ((1, 10, 0), ACCEPTED, "HOLD"),
        ((1, 1, 5), ACCEPTED, "MANUAL"),
        ((1, 2, 3), ACCEPTED, "ALTCTL"),
        ((1, 3, 1), ACCEPTED, "POSCTL"),  # an orbit begins with DO_ORBIT only
        ((1, 3, 7), ACCEPTED, "POSCTL"),
        ((1, 5, 1), ACCEPTED, "ACRO"),
        ((1, 6, 4), ACCEPTED, "OFFBOARD"),
        ((1, 7, 2), ACCEPTED, "STABILIZED"),
        ((1, 4, 0), ACCEPTED, "MISSION"),
        *(((1, 4, sub), REJECTED, "HOLD") for sub in (1, 7, 10, 19, 40)),
        *(((1, 4, 10 + n), ACCEPTED, f"EXTERNAL{n}") for n in (1, 8)),
        ((0, 0, 0), ACCEPTED, "HOLD"),
        ((0, 4, 6), ACCEPTED, "HOLD"),
        ((4, 0, 0), ACCEPTED, "MISSION"),
        ((220, 0, 0), ACCEPTED, "MISSION"),  # MAVProxy's `mode 220` sends this
        ((64, 6, 0), ACCEPTED, "MANUAL"),
        ((192, 0, 0), ACCEPTED, "MANUAL"),
        ((80, 4, 19), ACCEPTED, "STABILIZED"),
        ((208, 0, 0), ACCEPTED, "STABILIZED"),
        ((72, 0, 0), ACCEPTED, "POSCTL"),
        ((88, 0, 0), ACCEPTED, "POSCTL"),
    ],
)  # fmt: skip
def test_do_set_mode_and_set_mode_select_the_same_mode(
    bench: Bench, parameters: tuple[int, int, int], result: int, mode: str
) -> None:
    """The expected results were measured on a PX4 1.15.4 on the ground."""
    base, main, sub = parameters
    assert bench.client.mode(4, 3) == ACCEPTED
    assert bench.client.command(dialect.MAV_CMD_DO_SET_MODE, base, main, sub) == result
    assert bench.commander.mode == mode
    assert ("Unsupported auto mode" in bench.client.texts()) == (result == REJECTED)

    assert bench.client.mode(4, 3) == ACCEPTED
    bench.client.forget()
    bench.client.send(dialect.MAVLink_set_mode_message(1, base, main << 16 | sub << 24))
    acknowledged = [(m.command, m.result, m.target_system) for m in bench.client.of("COMMAND_ACK")]
    assert acknowledged == [(dialect.MAV_CMD_DO_SET_MODE, result, bench.client.system)]
    assert bench.commander.mode == mode


def test_an_unregistered_external_mode_is_shown_and_cannot_fly(bench: Bench) -> None:
    """Same as PX4 while no computer has registered the mode: `checkNonRegisteredModes` and `checkModeFallback`."""
    client = bench.client
    assert client.mode(4, 11) == ACCEPTED
    assert client.of("HEARTBEAT")[-1].custom_mode == MODES["EXTERNAL1"].custom_mode
    assert client.arm() == REJECTED
    assert "Arming denied: mode is not registered" in client.texts()
    client.command(dialect.MAV_CMD_REQUEST_MESSAGE, dialect.MAVLINK_MSG_ID_AVAILABLE_MODES, 0)
    listed = {m.custom_mode for m in client.of("AVAILABLE_MODES")}
    assert MODES["HOLD"].custom_mode in listed
    assert MODES["EXTERNAL1"].custom_mode not in listed
    assert client.command(ARM, 1, 21196) == ACCEPTED
    bench.run(0.5)
    assert bench.commander.mode == "RETURN"


def test_an_unregistered_external_mode_is_rejected_in_flight(bench: Bench) -> None:
    bench.fly()
    mode = bench.commander.mode
    assert bench.client.mode(4, 11) == REJECTED
    assert bench.commander.mode == mode


def test_the_heartbeat_shows_a_change_at_once(bench: Bench) -> None:
    bench.client.arm()
    beat = bench.client.of("HEARTBEAT")[-1]
    assert beat.base_mode & 128
    assert (beat.autopilot, beat.type, beat.system_status) == (12, 2, 4)
    bench.client.forget()
    bench.client.send(dialect.MAVLink_set_mode_message(1, 1, MODES["TAKEOFF"].custom_mode))
    assert bench.client.of("HEARTBEAT")[-1].custom_mode == MODES["TAKEOFF"].custom_mode


@pytest.mark.parametrize("name", [name for name in mavutil.px4_map if name not in ("RATTITUDE", "RTGS")])
def test_pymavlink_mode_names_select_the_mode_of_that_name(bench: Bench, name: str) -> None:
    """Sends the command of pymavlink's `set_mode(NAME)`, and checks the name that pymavlink then shows."""
    assert bench.client.command(dialect.MAV_CMD_DO_SET_MODE, *mavutil.px4_map[name], 0, 0, 0, 0) == ACCEPTED
    bench.run(1.1)  # until the next heartbeat
    assert mavutil.mode_string_v10(bench.client.of("HEARTBEAT")[-1]) == name


def test_disarming_in_the_air_needs_force(bench: Bench) -> None:
    bench.fly()
    assert bench.client.disarm() == DENIED
    assert bench.commander.armed
    assert bench.client.command(dialect.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1) == DENIED
    assert bench.client.disarm(force=True) == ACCEPTED
    bench.tick()
    assert bench.core.setpoint["armed"] == 0


def test_termination_stops_the_rotors_for_good(bench: Bench) -> None:
    bench.fly()
    assert bench.client.command(dialect.MAV_CMD_DO_FLIGHTTERMINATION, 1) == ACCEPTED
    bench.run(0.1)
    assert bench.core.setpoint["kind"] == 0
    assert bench.client.of("HEARTBEAT")[-1].system_status == 8
    assert bench.client.mode(4, 3) == REJECTED


def test_the_vehicle_disarms_when_no_take_off_follows(bench: Bench) -> None:
    assert bench.client.arm() == ACCEPTED
    bench.run(9.5)
    assert bench.commander.armed
    bench.run(1.0)
    assert not bench.commander.armed


def test_do_reposition_reaches_the_position(bench: Bench) -> None:
    bench.fly()
    lat, lon = ORIGIN[0] + 20.0 / 111194.9, ORIGIN[1]
    result = bench.client.command_int(
        dialect.MAV_CMD_DO_REPOSITION, (-1, 1, 0, math.pi / 2), round(lat * 1e7), round(lon * 1e7), ORIGIN[2] + 12.0
    )
    assert result == ACCEPTED
    bench.run(30)
    assert bench.core.estimate["position_ned"] == pytest.approx([20.0, 0.0, -12.0], abs=0.3)
    assert bench.autopilot.state.yaw == pytest.approx(math.pi / 2, abs=0.01)
    assert bench.commander.mode == "HOLD"


def test_orbit_keeps_its_radius(bench: Bench) -> None:
    bench.fly()
    result = bench.client.command_int(
        dialect.MAV_CMD_DO_ORBIT, (10, 2), round(ORIGIN[0] * 1e7), round(ORIGIN[1] * 1e7), ORIGIN[2] + 8.0, frame=3
    )
    assert result == ACCEPTED
    bench.run(25)
    for _ in range(20):
        bench.run(1)
        n, e, z = bench.core.estimate["position_ned"]
        assert math.hypot(n, e) == pytest.approx(10.0, abs=1.5)
        assert z == pytest.approx(-8.0, abs=0.2)
    assert math.hypot(*bench.velocity) == pytest.approx(2.0, abs=0.5)


def test_home_can_be_moved(bench: Bench) -> None:
    place = (round((ORIGIN[0] + 0.001) * 1e7), round(ORIGIN[1] * 1e7), 500.0)
    assert bench.client.command_int(dialect.MAV_CMD_DO_SET_HOME, (0,), *place) == ACCEPTED
    home = bench.client.of("HOME_POSITION")[-1]
    assert (home.latitude, home.longitude, home.altitude) == (place[0], place[1], 500_000)
    home = bench.commander.flight.home
    bench.run(2.0)
    assert bench.client.arm() == ACCEPTED
    assert bench.commander.flight.home == home  # neither the ground nor the arming moves a given home
    assert bench.client.command_int(dialect.MAV_CMD_DO_SET_HOME, (0,), *place[:2], math.nan) == DENIED
    assert bench.client.command(dialect.MAV_CMD_DO_SET_HOME, 1) == ACCEPTED
    assert bench.commander.flight.home.position_ned == pytest.approx((0.0, 0.0, 0.0), abs=0.1)


def test_version_and_modes_are_sent_on_request(bench: Bench) -> None:
    client = bench.client
    client.command(dialect.MAV_CMD_REQUEST_MESSAGE, dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
    capabilities = client.of("AUTOPILOT_VERSION")[-1].capabilities
    for needed in (0x4, 0x8, 0x10, 0x20, 0x40, 0x80, 0x100, 0x800, 0x2000, 0x4000, 0x8000):
        assert capabilities & needed
    client.command(dialect.MAV_CMD_REQUEST_MESSAGE, dialect.MAVLINK_MSG_ID_AVAILABLE_MODES, 0)
    modes = client.of("AVAILABLE_MODES")
    assert [m.mode_index for m in modes] == list(range(1, modes[0].number_modes + 1))
    assert {m.custom_mode for m in modes} >= {MODES["HOLD"].custom_mode, MODES["OFFBOARD"].custom_mode}


def test_missions_logs_and_files_answer_at_once_when_empty(bench: Bench) -> None:
    client = bench.client
    for kind in (0, 1, 2):
        client.send(dialect.MAVLink_mission_request_list_message(1, 1, kind))
        answer = client.of("MISSION_COUNT")[-1]
        assert (answer.count, answer.mission_type, answer.target_system) == (0, kind, client.system)
    client.send(dialect.MAVLink_mission_clear_all_message(1, 1, 0))
    assert client.of("MISSION_ACK")[-1].type == dialect.MAV_MISSION_ACCEPTED
    client.send(dialect.MAVLink_log_request_list_message(1, 1, 0, 0xFFFF))
    assert client.of("LOG_ENTRY")[-1].num_logs == 0
    request = bytes([5, 0, 0, 4, 3, 0, 0, 0, 0, 0, 0, 0]) + b"a/b"
    client.send(dialect.MAVLink_file_transfer_protocol_message(0, 1, 1, list(request.ljust(251, b"\0"))))
    payload = bytes(client.of("FILE_TRANSFER_PROTOCOL")[-1].payload)
    assert (payload[0], payload[3], payload[5], payload[12]) == (6, 129, 4, 10)


def test_two_ports_have_their_own_streams_and_sequence_numbers(bench: Bench) -> None:
    second = Client(bench.autopilot.open_port("minimal"), 255, 0)
    interval = dialect.MAV_CMD_SET_MESSAGE_INTERVAL
    assert second.command(interval, dialect.MAVLINK_MSG_ID_ATTITUDE, 100_000) == ACCEPTED
    bench.client.forget()
    second.forget()
    bench.run(2.0)
    assert not bench.client.of("ATTITUDE")
    assert 19 <= len(second.of("ATTITUDE")) <= 21
    for client in (bench.client, second):
        numbers = [m.get_seq() for m in client.inbox]
        assert all((b - a) % 256 == 1 for a, b in itertools.pairwise(numbers))
    assert second.arm() == ACCEPTED
    assert not bench.client.of("COMMAND_ACK")  # only the sender gets the acknowledgement
    assert bench.client.of("HEARTBEAT")[-1].base_mode & 128
