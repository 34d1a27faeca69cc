"""A ground station connects on its own port as QGroundControl does, and gets a reply to every request.

The order of the requests is that of QGroundControl's source (`src/Vehicle/InitialConnectStateMachine.cc`).
QGroundControl itself was not run.
"""

import pytest

from foundation.mavlink import dialect
from tests.autopilot.commander_bench import Bench

ACCEPTED, DENIED = dialect.MAV_RESULT_ACCEPTED, dialect.MAV_RESULT_DENIED
COMPONENT_INFORMATION, COMPONENT_METADATA = 395, 397


@pytest.fixture
def bench() -> Bench:
    return Bench(profile="gcs")


def requested(bench: Bench, message_id: int, parameter: float = 0.0) -> int | None:
    """Request a message; return the result of its acknowledgement."""
    return bench.client.command(dialect.MAV_CMD_REQUEST_MESSAGE, message_id, parameter)


def test_heartbeat_identifies_a_px4_quadrotor_with_custom_modes(bench: Bench) -> None:
    bench.run(1.0)
    beat = bench.client.of("HEARTBEAT")[-1]
    assert (beat.get_srcSystem(), beat.get_srcComponent()) == (1, 1)
    assert (beat.autopilot, beat.type) == (dialect.MAV_AUTOPILOT_PX4, dialect.MAV_TYPE_QUADROTOR)
    assert beat.base_mode & dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED


def test_every_request_of_the_initial_connection_gets_a_reply(bench: Bench) -> None:
    client = bench.client
    assert requested(bench, dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION) == ACCEPTED
    assert client.of("AUTOPILOT_VERSION")[-1].flight_sw_version
    modes = 1
    index = 0
    while index < modes:  # one at a time
        index += 1
        assert requested(bench, dialect.MAVLINK_MSG_ID_AVAILABLE_MODES, index) == ACCEPTED
        [mode] = client.of("AVAILABLE_MODES")
        assert mode.mode_index == index
        modes = mode.number_modes
    assert modes > 5
    for description in (COMPONENT_METADATA, COMPONENT_INFORMATION):  # there is none, so the request is denied
        assert requested(bench, description) == DENIED
    client.forget()
    client.send(dialect.MAVLink_param_request_list_message(1, 1))
    bench.run(10.0)
    values = client.of("PARAM_VALUE")
    assert {value.param_index for value in values} == set(range(values[0].param_count))
    for kind in (dialect.MAV_MISSION_TYPE_MISSION, dialect.MAV_MISSION_TYPE_FENCE, dialect.MAV_MISSION_TYPE_RALLY):
        client.forget()
        client.send(dialect.MAVLink_mission_request_list_message(1, 1, kind))
        [answer] = client.of("MISSION_COUNT")
        assert (answer.count, answer.mission_type) == (0, kind)


def test_the_gcs_profile_streams_the_messages_of_the_flight_display(bench: Bench) -> None:
    bench.client.forget()
    bench.run(5.0)
    for kind in ("ATTITUDE", "GLOBAL_POSITION_INT", "VFR_HUD", "GPS_RAW_INT", "SYS_STATUS", "BATTERY_STATUS",
                 "HOME_POSITION", "EXTENDED_SYS_STATE", "CURRENT_MODE", "MISSION_CURRENT"):  # fmt: skip
        assert bench.client.of(kind), kind
