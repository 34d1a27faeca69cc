"""Rows that are made of what was heard: one message changed at a time."""

import pytest

from foundation.mavlink import dialect
from foundation.px4 import MODES
from hil.preflight import battery, health, position, wire
from hil.preflight.heard import ASKED_HZ, Heard, RoundTrip
from hil.preflight.row import Change, Row, proposal, summary, table

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


def heard(*messages, **fields):
    return Heard(newest={message.get_msgId(): message for message in messages}, **fields)


def passed(rows, name):
    return next(row.passed for row in rows if row.name == name)


@pytest.mark.parametrize("bit", [0x1, 0x2, 0x4, 0x8, 0x20])
def test_every_sensor_counts(bit):
    assert passed(health.rows(heard(status())), "sensors") is True
    assert passed(health.rows(heard(status(healthy=GOOD & ~bit))), "sensors") is False
    # PX4 never says that an accelerometer is present
    assert passed(health.rows(heard(status(present=GOOD & ~bit))), "sensors") is (bit == 0x2)


def test_the_prearm_check_counts():
    assert passed(health.rows(heard(status())), "pre-arm check") is True
    row = health.rows(heard(status(healthy=0x2F), texts=("Preflight Fail: compass",)))[3]
    assert (row.passed, "Preflight Fail: compass" in row.why) == (False, True)


def test_a_vehicle_left_in_offboard_is_told_apart_from_one_that_is_not_fit():
    def fix(mode):
        beat = dialect.MAVLink_heartbeat_message(2, 12, 1, MODES[mode].custom_mode, 3, 3)
        return health.rows(heard(beat, status(healthy=0x2F)))[3].fix

    assert "switch it to Hold" in fix("OFFBOARD")
    assert "switch it to Hold" not in fix("HOLD")


@pytest.mark.parametrize("bit", [1, 2, 4, 16, 32])
def test_every_estimate_counts(bit):
    assert passed(health.rows(heard(estimator())), "estimator") is True
    assert passed(health.rows(heard(estimator(0x37 & ~bit))), "estimator") is False


@pytest.mark.parametrize(
    ("message", "ratios", "expected"),
    [(estimator(0x37 | 1024), {}, False), (estimator(0x37 | 2048), {}, False), (estimator(0x37 | 128), {}, True),
     (estimator(accuracy=5.1), {}, False), (estimator(accuracy=float("nan")), {}, False),
     (estimator(), {"vel_ratio": 1.1}, False), (estimator(), {"mag_ratio": 0.9}, True)],
)  # fmt: skip
def test_what_makes_an_estimate_doubtful(message, ratios, expected):
    assert passed(health.rows(heard(message, worst_ratio=ratios)), "estimator") is expected


@pytest.mark.parametrize(
    ("changed", "expected"),
    [({}, True), ({"fix": 0}, False), ({"fix": 2}, False), ({"fix": 6}, True), ({"satellites": 5}, False),
     ({"satellites": 255}, True), ({"hdop": 260}, False), ({"hdop": 65535}, True), ({"h_acc": 3100}, False),
     ({"v_acc": 5100}, False), ({"h_acc": 0, "v_acc": 0}, True)],
)  # fmt: skip
def test_gps_quality(changed, expected):
    assert passed(position.rows(heard(gps(**changed))), "GPS") is expected


@pytest.mark.parametrize(
    ("messages", "expected"),
    [((), False), ((home(),), None), ((home(), here()), True), ((home(), here(lat=800)), True),
     ((home(), here(lat=1000)), False), ((home(lon=1_799_999_900), here(lon=-1_799_999_900)), True)],
)  # fmt: skip
def test_home_is_where_the_vehicle_stands(messages, expected):
    assert passed(position.rows(heard(*messages)), "home") is expected


@pytest.mark.parametrize(
    ("message", "cells", "expected"),
    [(status(), 4, True), (status(), 3, False), (status(), 6, False), (status(), None, None),
     (status(millivolts=65535), 4, False), (status(millivolts=0), 4, False), (status(remaining=39), 4, False),
     (status(remaining=40), 4, True), (status(remaining=-1), 4, None), (status(millivolts=13900), 4, False)],
)  # fmt: skip
def test_the_battery(message, cells, expected):
    assert battery.row(heard(message), {"BAT1_N_CELLS": cells, "BAT_LOW_THR": 0.15}).passed is expected


@pytest.mark.parametrize(("share", "expected"), [(1.0, True), (0.7, None), (0.3, False), (0.0, False)])
def test_telemetry_rates(share, expected):
    counts = {message_id: round(share * rate * 10.0) for message_id, rate in ASKED_HZ.items()}
    assert passed(wire.rows(heard(seconds=10.0, counts=counts)), "telemetry rates") is expected


def trips(length_s, drift, count=10):
    """Return round trips a second apart of a clock that runs `drift` seconds a second faster than ours."""
    return tuple(
        RoundTrip(
            asked_ns=i * 10**9,
            answered_ns=i * 10**9 + round(length_s * 1e9),
            vehicle_ns=7 * 10**9 + round((i + length_s / 2) * 1e9 * (1.0 + drift)),
        )
        for i in range(count)
    )


@pytest.mark.parametrize(
    ("length_s", "asked", "expected"), [(0.01, 10, True), (0.01, 16, False), (0.6, 10, False), (0.01, 15, True)]
)
def test_round_trips(length_s, asked, expected):
    told = heard(round_trips=trips(length_s, 0.0), sync_asked=asked)
    assert passed(wire.rows(told), "round trip") is expected


@pytest.mark.parametrize(("drift", "expected"), [(0.0, True), (1e-4, True), (1.0, None), (-0.1, None)])
def test_a_clock_that_is_not_a_quartz_is_noticed(drift, expected):
    told = heard(round_trips=trips(0.005, drift), sync_asked=10)
    assert passed(wire.rows(told), "clocks") is expected
    assert all(trip.offset_ns > 0 for trip in told.round_trips)


def test_nothing_heard_is_never_a_pass():
    rows = [*health.rows(Heard()), *position.rows(Heard()), battery.row(Heard(), {}), *wire.rows(Heard())]
    assert not any(row.passed for row in rows)


def test_the_table_says_everything_within_its_width():
    rows = [Row("one", True, "fine", "not said"), Row("second", False, "bad " * 60, "mend it"), Row("3", None, "maybe")]
    text = table(rows)
    assert max(len(line) for line in text.splitlines()) <= 118
    assert text.splitlines()[0] == "pass  one     fine"
    assert "→ mend it" in text
    assert "not said" not in text
    assert summary(rows) == "1 passed, 1 failed, 1 for you to judge"
    assert "COM_X       0 → 5" in proposal([Change("COM_X", 0, 5, "because")])
