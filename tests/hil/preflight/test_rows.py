"""Rows of the preflight check, computed from messages. The tests change one message at a time."""

import re

from dronecats.cli.preflight import proposal, table
from dronecats.report.writers import as_terminal
from foundation.mavlink import MODES, dialect
from foundation.sensors import CALENDAR_START_US
from hil.preflight import ground_side, vehicle
from hil.preflight.check import PX4_DEFAULTS, Check
from hil.preflight.observation import STREAM_HZ, Change, Observation, RoundTrip, Row, summary

GOOD = 0x1 | 0x2 | 0x4 | 0x8 | 0x20 | 0x10000000


def status(present=GOOD, healthy=GOOD, millivolts=16000, remaining=90):
    return dialect.MAVLink_sys_status_message(present, present, healthy, 0, millivolts, -1, remaining, 0, 0, 0, 0, 0, 0)


def estimator(flags=0x37, accuracy=0.5):
    return dialect.MAVLink_estimator_status_message(0, flags, 0.1, 0.1, 0.1, 0.1, 0, 0, accuracy, 0.5)


def gps(fix=3, hdop=80, satellites=12, h_acc=900, v_acc=1200):
    return dialect.MAVLink_gps_raw_int_message(0, fix, 0, 0, 0, hdop, 100, 0, 0, satellites, 0, h_acc, v_acc)


def here(lat=0, lon=0):
    return dialect.MAVLink_global_position_int_message(0, lat, lon, 0, 0, 0, 0, 0, 0)


def home(lat=0, lon=0):
    return dialect.MAVLink_home_position_message(lat, lon, 0, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0)


def observed(*messages, **fields):
    return Observation(newest={message.get_msgId(): message for message in messages}, **fields)


def passed(rows, name):
    return next(row.passed for row in rows if row.name == name)


def test_each_unhealthy_sensor_fails_the_sensors_row():
    for bit in [0x1, 0x2, 0x4, 0x8, 0x20]:
        assert passed(vehicle.rows(observed(status()), {}), "sensors") is True, bit
        assert passed(vehicle.rows(observed(status(healthy=GOOD & ~bit)), {}), "sensors") is False, bit
        # PX4 never reports the accelerometer as present
        assert passed(vehicle.rows(observed(status(present=GOOD & ~bit)), {}), "sensors") is (bit == 0x2), bit


def test_a_failed_prearm_check_fails_its_row_and_shows_the_status_text():
    assert passed(vehicle.rows(observed(status()), {}), "pre-arm check") is True
    row = vehicle.rows(observed(status(healthy=0x2F), texts=("Preflight Fail: compass",)), {})[3]
    assert (row.passed, "Preflight Fail: compass" in row.why) == (False, True)


def test_the_fix_for_a_vehicle_left_in_offboard_mentions_hold():
    def fix(mode):
        beat = dialect.MAVLink_heartbeat_message(2, 12, 1, MODES[mode].custom_mode, 3, 3)
        return vehicle.rows(observed(beat, status(healthy=0x2F)), {})[3].fix

    assert "Hold" in fix("OFFBOARD")
    assert "Hold" not in fix("HOLD")


def test_each_missing_estimate_fails_the_estimator_row():
    for bit in [1, 2, 4, 16, 32]:
        assert passed(vehicle.rows(observed(estimator()), {}), "estimator") is True, bit
        assert passed(vehicle.rows(observed(estimator(0x37 & ~bit)), {}), "estimator") is False, bit


def test_faulty_or_inaccurate_estimates_fail():
    for message, ratios, expected in [
        (estimator(0x37 | 1024), {}, False), (estimator(0x37 | 2048), {}, False), (estimator(0x37 | 128), {}, True),
        (estimator(accuracy=5.1), {}, False), (estimator(accuracy=float("nan")), {}, False),
        (estimator(), {"vel_ratio": 1.1}, False), (estimator(), {"mag_ratio": 0.9}, True),
    ]:  # fmt: skip
        assert passed(vehicle.rows(observed(message, worst_ratio=ratios), {}), "estimator") is expected, (
            message,
            ratios,
        )


def test_poor_gps_quality_fails():
    for changed, expected in [
        ({}, True), ({"fix": 0}, False), ({"fix": 2}, False), ({"fix": 6}, True), ({"satellites": 5}, False),
        ({"satellites": 255}, True), ({"hdop": 260}, False), ({"hdop": 65535}, True), ({"h_acc": 3100}, False),
        ({"v_acc": 5100}, False), ({"h_acc": 0, "v_acc": 0}, True),
    ]:  # fmt: skip
        assert passed(vehicle.rows(observed(gps(**changed)), {}), "GPS") is expected, changed


def test_home_must_be_near_the_vehicle():
    for messages, expected in [
        ((), False), ((home(),), None), ((home(), here()), True), ((home(), here(lat=800)), True),
        ((home(), here(lat=1000)), False), ((home(lon=1_799_999_900), here(lon=-1_799_999_900)), True),
    ]:  # fmt: skip
        assert passed(vehicle.rows(observed(*messages), {}), "home") is expected, messages


def test_low_or_implausible_battery_values_fail():
    for message, cells, expected in [
        (status(), 4, True), (status(), 3, False), (status(), 6, False), (status(), None, None),
        (status(millivolts=65535), 4, False), (status(millivolts=0), 4, False), (status(remaining=39), 4, False),
        (status(remaining=40), 4, True), (status(remaining=-1), 4, None), (status(millivolts=13900), 4, False),
    ]:  # fmt: skip
        rows = vehicle.rows(observed(message), {"BAT1_N_CELLS": cells, "BAT_LOW_THR": 0.15})
        assert passed(rows, "battery") is expected, (message, cells)


def test_low_telemetry_rates_fail():
    for share, expected in [(1.0, True), (0.7, None), (0.3, False), (0.0, False)]:
        counts = {message_id: round(share * rate * 10.0) for message_id, rate in STREAM_HZ.items()}
        assert passed(ground_side.wire_rows(observed(seconds=10.0, counts=counts)), "telemetry rates") is expected, (
            share
        )


def trips(length_s, drift, count=10):
    """Return one round trip per second. The vehicle's clock runs faster than ours by `drift` (s/s)."""
    return tuple(
        RoundTrip(
            sent_ns=i * 10**9,
            answered_ns=i * 10**9 + round(length_s * 1e9),
            vehicle_ns=7 * 10**9 + round((i + length_s / 2) * 1e9 * (1.0 + drift)),
        )
        for i in range(count)
    )


def test_slow_or_lost_round_trips_fail():
    for length_s, sync_requests, expected in [(0.01, 10, True), (0.01, 16, False), (0.6, 10, False), (0.01, 15, True)]:
        observation = observed(round_trips=trips(length_s, 0.0), sync_requests=sync_requests)
        assert passed(ground_side.wire_rows(observation), "round trip") is expected, (length_s, sync_requests)


def test_a_clock_with_a_large_drift_does_not_pass():
    for drift, expected in [(0.0, True), (1e-4, True), (1.0, None), (-0.1, None)]:
        observation = observed(round_trips=trips(0.005, drift), sync_requests=10)
        assert passed(ground_side.wire_rows(observation), "clocks") is expected, drift
        assert all(trip.offset_ns > 0 for trip in observation.round_trips), drift


def test_a_wrong_calendar_time_does_not_pass_unless_it_is_simulated():
    now = 1_795_000_000_000_000
    for calendar, expected in [
        (0, True),
        (now, True),
        (now - 10_000_000, None),
        (CALENDAR_START_US + 60_000_000, True),
    ]:
        message = dialect.MAVLink_system_time_message(calendar, 60_000)
        observation = observed(message, round_trips=trips(0.005, 0.0), sync_requests=10, unix_s=now * 1e-6)
        assert passed(ground_side.wire_rows(observation), "clocks") is expected, calendar


def test_silence_is_never_a_pass():
    rows = [*vehicle.rows(Observation(), {}), *ground_side.wire_rows(Observation())]
    assert not any(row.passed for row in rows)


def test_the_table_shows_fixes_only_for_rows_that_did_not_pass():
    rows = [Row("one", True, "fine", "not said"), Row("two", False, "bad", "mend it"), Row("three", False, "bad")]
    text = as_terminal(table(rows))
    assert "mend it" in text
    assert "not said" not in text
    assert re.findall(r"\d+", summary(rows)) == ["1", "2", "0"]
    assert re.search(r"COM_X\W+0\W+5", as_terminal(proposal([Change("COM_X", 0, 5, "because")])))


def test_failed_defaults_are_called_normal_for_a_simulator_but_not_for_a_real_vehicle():
    def failed(calendar_us, **values):
        calendar = dialect.MAVLink_system_time_message(calendar_us, 0)
        result = Check(
            observed(calendar), {**dict.fromkeys(PX4_DEFAULTS, 0.0), **values}, 0, Row("rehearsal", True, ""), ()
        )
        return {row.name.split()[0]: row.why for row in result.rows if row.passed is False and "=" in row.name}

    for calendar_us, is_expected in ((CALENDAR_START_US + 1, True), (CALENDAR_START_US - 1, False)):
        rows = failed(calendar_us)
        assert {name: "normal" in why for name, why in rows.items()} == dict.fromkeys(PX4_DEFAULTS, is_expected)
    assert "normal" not in failed(CALENDAR_START_US + 1, COM_OBL_RC_ACT=7.0)["COM_OBL_RC_ACT"]
