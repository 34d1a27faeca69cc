"""The default streams, their rates and their contents."""

import math
from collections import Counter

import numpy as np
import pytest

from autopilot.mavlink.node import TABLE
from autopilot.records import HEADING_TEST, HEIGHT_TEST, POSITION_TEST, VELOCITY_TEST
from foundation.errors import UsageError
from foundation.mavlink import dialect
from foundation.sensors import ACTUATORS, CALENDAR_START_US
from tests.autopilot.commander_bench import ORIGIN, Bench, Client


def counted(bench: Bench, client: Client, seconds: float) -> Counter[str]:
    client.forget()
    bench.run(seconds)
    return Counter(m.get_type() for m in client.drain())


@pytest.mark.parametrize("profile", ["onboard", "gcs", "minimal"])
def test_stream_rates_match_the_profile(profile: str) -> None:
    bench = Bench(profile=profile)
    bench.fly()
    counts = counted(bench, bench.client, 20.0)
    # this bench has no data for these streams
    silent = {"SERVO_OUTPUT_RAW", "DISTANCE_SENSOR", "ORBIT_EXECUTION_STATUS", "RC_CHANNELS"}
    silent |= {"GIMBAL_DEVICE_ATTITUDE_STATUS", "GIMBAL_MANAGER_STATUS"}
    for stream in TABLE:
        if stream.name in silent:
            continue
        expected = min(stream.rate(profile), 50.0) * 20.0  # one message per tick at most
        assert counts[stream.name] == pytest.approx(expected, abs=max(1.0, 0.01 * expected)), stream.name


def test_an_unknown_profile_is_rejected() -> None:
    with pytest.raises(UsageError, match="onboard"):
        Bench().autopilot.open_port("fast")


def test_intervals_can_be_set_read_and_reset() -> None:
    bench = Bench(profile="minimal")
    client, message = bench.client, dialect.MAVLINK_MSG_ID_CURRENT_MODE
    client.command(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, message, 20_000)
    assert counted(bench, client, 2.0)["CURRENT_MODE"] == pytest.approx(100, abs=1)
    client.command(dialect.MAV_CMD_GET_MESSAGE_INTERVAL, message)
    assert client.of("MESSAGE_INTERVAL")[-1].interval_us == 20_000
    client.command(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, message, -1)
    assert counted(bench, client, 2.0)["CURRENT_MODE"] == 0
    client.command(dialect.MAV_CMD_GET_MESSAGE_INTERVAL, message)
    assert client.of("MESSAGE_INTERVAL")[-1].interval_us == -1
    client.command(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, dialect.MAVLINK_MSG_ID_HEARTBEAT, -1)
    assert counted(bench, client, 3.0)["HEARTBEAT"] == 3


def test_request_data_stream_raises_rates_but_never_lowers_them() -> None:
    bench = Bench(profile="minimal")
    client = bench.client
    client.send(dialect.MAVLink_request_data_stream_message(1, 0, dialect.MAV_DATA_STREAM_ALL, 4, 1))
    assert counted(bench, client, 5.0)["ATTITUDE"] == pytest.approx(20, abs=1)
    client.send(dialect.MAVLink_request_data_stream_message(1, 0, dialect.MAV_DATA_STREAM_EXTRA1, 1, 1))
    assert counted(bench, client, 5.0)["ATTITUDE"] == pytest.approx(20, abs=1)


def test_health_follows_the_estimate() -> None:
    bench = Bench(converged=False)
    client = bench.client
    assert not client.of("SYS_STATUS")[-1].onboard_control_sensors_health & (0x20 | 0x10000000)
    assert not client.of("HOME_POSITION")
    bench.core.converge()
    bench.run(3.0)
    status = client.of("SYS_STATUS")[-1]
    for bit in (0x1, 0x2, 0x4, 0x20, 0x10000000, 0x100000):
        assert status.onboard_control_sensors_present & bit
        assert status.onboard_control_sensors_enabled & bit
        assert status.onboard_control_sensors_health & bit
    home = client.of("HOME_POSITION")[-1]
    assert (home.latitude, home.longitude) == (round(ORIGIN[0] * 1e7), round(ORIGIN[1] * 1e7))


def test_a_dead_sensor_is_reported_unhealthy() -> None:
    bench = Bench()
    bench.run(1.0)
    stamp = bench._stamp
    dead = int(bench.sensors["mag_time_us"])

    def without_mag() -> None:
        stamp()
        bench.sensors["mag_time_us"] = dead

    bench._stamp = without_mag  # type: ignore[method-assign]
    bench.run(1.5)
    health = bench.client.of("SYS_STATUS")[-1].onboard_control_sensors_health
    assert not health & 0x4
    assert health & 0x1
    assert not health & 0x10000000  # not armable


def test_messages_carry_the_values_of_the_estimate() -> None:
    bench = Bench()
    bench.fly(6.0)
    for _ in range(40):
        bench.client.velocity(2.0, 0.0, 0.0)
        if bench.commander.mode != "OFFBOARD":
            bench.client.mode(6)
        bench.run(0.1)
    client, e = bench.client, bench.core.estimate
    local, glob = client.of("LOCAL_POSITION_NED")[-1], client.of("GLOBAL_POSITION_INT")[-1]
    assert local.x == pytest.approx(e["position_ned"][0], abs=0.1)
    assert local.vx == pytest.approx(2.0, abs=0.05)
    assert glob.vx == pytest.approx(200, abs=5)
    assert glob.lat == pytest.approx(ORIGIN[0] * 1e7 + math.degrees(local.x / 6371000.0) * 1e7, abs=20)
    assert glob.relative_alt == pytest.approx(-local.z * 1000, abs=50)
    assert client.of("ATTITUDE")[-1].time_boot_ms == bench.time_us // 1000
    assert client.of("EXTENDED_SYS_STATE")[-1].landed_state == dialect.MAV_LANDED_STATE_IN_AIR
    target = client.of("POSITION_TARGET_LOCAL_NED")[-1]
    assert target.type_mask & 0x3F == 0x7  # position free, velocity controlled
    assert target.vx == pytest.approx(2.0)
    battery = client.of("BATTERY_STATUS")[-1]
    assert battery.voltages[:5] == [4000, 4000, 4000, 4000, 65535]
    assert battery.battery_remaining == 90


def test_unix_time_starts_at_the_first_fix_and_follows_the_vehicle_clock() -> None:
    bench = Bench(converged=False)
    bench.sensors["gps_fix_type"] = 0
    bench.client.forget()
    bench.run(2.0)
    assert {m.time_unix_usec for m in bench.client.of("SYSTEM_TIME")} == {0}
    bench.sensors["gps_fix_type"] = 3
    bench.client.forget()
    bench.run(2.0)
    bench.core.converge()
    bench.sensors["gps_fix_type"] = 0  # the clock continues without a fix
    bench.run(2.0)
    messages = bench.client.of("SYSTEM_TIME")
    assert len(messages) == 4
    assert {m.time_unix_usec // 1000 - m.time_boot_ms for m in messages} == {CALENDAR_START_US // 1000}


def test_imu_and_actuator_outputs_are_sent_on_request() -> None:
    actuators = np.zeros(1, ACTUATORS)[0]
    bench = Bench(actuators=actuators)
    actuators["armed"], actuators["command"][:4] = 1, (0.0, 0.25, 0.5, 1.0)
    bench.sensors["gyro_frd"][1], bench.sensors["mag_frd"][0] = 0.5, 0.21
    for name in ("SCALED_IMU", "ACTUATOR_OUTPUT_STATUS"):
        number = getattr(dialect, f"MAVLINK_MSG_ID_{name}")
        assert bench.client.command(dialect.MAV_CMD_REQUEST_MESSAGE, number) == dialect.MAV_RESULT_ACCEPTED
        (message,) = bench.client.of(name)
        if name == "SCALED_IMU":
            assert (message.zacc, message.ygyro, message.xmag) == (-1000, 500, 210)
        else:
            assert (message.active, list(message.actuator)[:5]) == (4, [1000.0, 1250.0, 1500.0, 2000.0, 0.0])


def test_invalid_estimates_never_stop_the_streams() -> None:
    bench = Bench()
    for value in (math.nan, math.inf, 1e300):
        bench.core.estimate["position_ned"][:] = value
        bench.core.estimate["velocity_ned"][:] = value
        bench.client.forget()
        for _ in range(60):
            bench._stamp()
            bench.core.estimate["time_us"] = bench.time_us
            bench.autopilot.update()
        assert bench.client.of("HEARTBEAT")


def test_long_texts_are_chunked() -> None:
    bench = Bench(profile="minimal")
    text = "".join(chr(65 + i % 26) for i in range(120))
    bench.client.forget()
    bench.autopilot.node.send_text(6, text)
    chunks = bench.client.of("STATUSTEXT")
    assert [c.chunk_seq for c in chunks] == [0, 1, 2]
    assert len({c.id for c in chunks}) == 1
    assert chunks[0].id != 0
    assert "".join(c.text for c in chunks) == text
    bench.autopilot.node.send_text(6, "short")
    assert bench.client.of("STATUSTEXT")[-1].id == 0


def test_ping_and_timesync_are_answered() -> None:
    bench = Bench(profile="minimal")
    client = bench.client
    client.send(dialect.MAVLink_ping_message(123, 9, 0, 0))
    answer = client.of("PING")[-1]
    assert (answer.time_usec, answer.seq) == (123, 9)
    assert (answer.target_system, answer.target_component) == (client.system, client.component)
    client.send(dialect.MAVLink_timesync_message(0, 777))
    answer = client.of("TIMESYNC")[-1]
    assert (answer.ts1, answer.tc1) == (777, bench.time_us * 1000)
    client.forget()
    client.send(dialect.MAVLink_ping_message(123, 9, 1, 1))  # the answer to another client
    client.send(dialect.MAVLink_timesync_message(5, 777))
    assert not client.drain()


def test_the_queue_of_an_unread_port_is_bounded() -> None:
    bench = Bench()
    for _ in range(4000):
        bench.tick()
    assert bench.client.port.lost > 0
    assert len(bench.client.port._out) <= 20_000


def test_estimator_status_has_the_square_roots_of_the_test_ratios() -> None:
    """PX4 sends the ratio of innovation to gate; the estimator stores its square. The largest axis counts."""
    bench = Bench()
    ratios = bench.core.estimate["test_ratio"]
    ratios[VELOCITY_TEST : VELOCITY_TEST + 3] = 0.04, 0.25, 0.01
    ratios[POSITION_TEST : POSITION_TEST + 2] = 2.25, 1.0
    ratios[HEIGHT_TEST], ratios[HEADING_TEST] = 0.09, 4.0
    bench.run(2.1)
    status = bench.client.of("ESTIMATOR_STATUS")[-1]
    ratios = (status.vel_ratio, status.pos_horiz_ratio, status.pos_vert_ratio, status.mag_ratio)
    assert ratios == pytest.approx((0.5, 1.5, 0.3, 2.0))
