"""Calibration, failure injection, vibration, sticks as RC channels, and heartbeats forwarded between links."""

import math
from typing import Any

import pytest

from autopilot.commander.health import EXTERNAL_MODES
from foundation.mavlink import MODES, Packer, dialect
from tests.autopilot.commander_bench import TICK_US, Bench, Client

ACCEPTED, REJECTED, DENIED, UNSUPPORTED = 0, 1, 2, 3
CALIBRATE, INJECT = dialect.MAV_CMD_PREFLIGHT_CALIBRATION, dialect.MAV_CMD_INJECT_FAILURE
ASKED = {"gyro": (1, 0, 0, 0, 0, 0, 0), "mag": (0, 1, 0, 0, 0, 0, 0), "accel": (0, 0, 0, 0, 1, 0, 0),
         "level": (0, 0, 0, 0, 2, 0, 0)}  # fmt: skip


@pytest.fixture
def bench() -> Bench:
    bench = Bench(profile="minimal")
    bench.sensors["mag_frd"] = (0.2, 0.0, 0.4)
    return bench


def calibrated(bench: Bench, sensor: str) -> list[str]:
    """Request a calibration and return its messages until it ends."""
    bench.client.forget()
    assert bench.client.command(CALIBRATE, *ASKED[sensor]) == ACCEPTED
    bench.until(lambda: not bench.autopilot.calibration.running, 5)
    return bench.client.texts()


@pytest.mark.parametrize("sensor", sorted(ASKED))
def test_calibration_of_a_vehicle_at_rest_succeeds(bench: Bench, sensor: str) -> None:
    texts = calibrated(bench, sensor)
    assert texts[0] == f"[cal] calibration started: 2 {sensor}"
    progress = [int(t.split("<")[1].rstrip(">")) for t in texts if "progress" in t]
    assert progress == sorted(set(progress))
    assert progress[0] == 0
    assert progress[-1] == 100
    assert texts[-1] == f"[cal] calibration done: {sensor}"


@pytest.mark.parametrize(
    ("sensor", "field", "value", "reason"),
    [("gyro", "gyro_frd", (0.3, 0, 0), "moves"), ("mag", "mag_frd", (0, 0, 0), "field"),
     ("accel", "accel_frd", (0, 0, -5.0), "gravity"), ("accel", "gyro_frd", (math.nan, 0, 0), "moves")],
)  # fmt: skip
def test_calibration_of_a_bad_sensor_fails_with_a_reason(
    bench: Bench, sensor: str, field: str, value: tuple[float, ...], reason: str
) -> None:
    bench.sensors[field] = value
    texts = calibrated(bench, sensor)
    assert texts[-1].startswith("[cal] calibration failed: ")
    assert reason in texts[-1]


def test_calibrations_do_not_overlap_and_are_rejected_while_armed(bench: Bench) -> None:
    client = bench.client
    assert client.command(CALIBRATE, *ASKED["gyro"]) == ACCEPTED
    bench.run(0.5)
    assert client.command(CALIBRATE, *ASKED["gyro"]) == ACCEPTED  # a repeat by a client that missed the acknowledgement
    assert client.command(CALIBRATE, *ASKED["mag"]) == REJECTED
    assert client.arm() == REJECTED
    client.command(dialect.MAV_CMD_REQUEST_MESSAGE, dialect.MAVLINK_MSG_ID_HEARTBEAT)
    assert client.of("HEARTBEAT")[-1].system_status == dialect.MAV_STATE_CALIBRATING
    assert client.command(CALIBRATE, *([0] * 7)) == ACCEPTED
    assert "[cal] calibration cancelled" in client.texts()
    assert client.arm() == ACCEPTED
    assert client.command(CALIBRATE, *ASKED["gyro"]) == REJECTED
    assert client.command(CALIBRATE, 0, 0, 0, 1, 0, 0, 0) in (REJECTED, UNSUPPORTED)


def test_failure_injection_reaches_the_vehicle() -> None:
    injected: list[tuple[int, int, int]] = []

    def inject(unit: int, kind: int, instance: int) -> bool:
        injected.append((unit, kind, instance))
        return bool(unit == dialect.FAILURE_UNIT_SENSOR_GPS)

    bench = Bench(profile="minimal", inject=inject)
    gps, off = dialect.FAILURE_UNIT_SENSOR_GPS, dialect.FAILURE_TYPE_OFF
    assert bench.client.command(INJECT, gps, off, 0) == DENIED  # SYS_FAILURE_EN
    assert injected == []
    bench.autopilot.parameters.set("SYS_FAILURE_EN", 1)
    assert bench.client.command(INJECT, gps, off, 0) == ACCEPTED
    assert bench.client.command(INJECT, dialect.FAILURE_UNIT_SENSOR_VIO, off, 2) == UNSUPPORTED
    assert bench.client.command(INJECT, math.nan, off) == UNSUPPORTED
    assert injected == [(gps, off, 0), (dialect.FAILURE_UNIT_SENSOR_VIO, off, 2)]


def test_failure_injection_is_unsupported_without_a_simulator(bench: Bench) -> None:
    bench.autopilot.parameters.set("SYS_FAILURE_EN", 1)
    assert bench.client.command(INJECT, dialect.FAILURE_UNIT_SENSOR_GPS, dialect.FAILURE_TYPE_OFF) == UNSUPPORTED


def request(bench: Bench, kind: str) -> Any:
    bench.client.command(dialect.MAV_CMD_REQUEST_MESSAGE, getattr(dialect, f"MAVLINK_MSG_ID_{kind}"))
    messages = bench.client.of(kind)
    return messages[-1] if messages else None


def test_vibration_message_reports_the_estimate(bench: Bench) -> None:
    estimate = bench.core.estimate
    estimate["vibration_gyro"], estimate["vibration_accel"], estimate["clipped"] = 0.5, 6.0, (1, 2, 3)
    bench.tick()
    reported = request(bench, "VIBRATION")
    assert (reported.vibration_y, reported.vibration_z) == (0.5, 6.0)
    assert (reported.clipping_0, reported.clipping_1, reported.clipping_2) == (1, 2, 3)


def test_sticks_are_reported_as_rc_channels(bench: Bench) -> None:
    assert request(bench, "RC_CHANNELS") is None
    bench.client.send(dialect.MAVLink_manual_control_message(1, 1000, -500, 250, 0, 0))
    bench.tick()
    channels = request(bench, "RC_CHANNELS")
    assert [channels.chan1_raw, channels.chan2_raw, channels.chan3_raw, channels.chan4_raw] == [1250, 2000, 1250, 1500]
    assert channels.rssi == 100
    bench.run(1.0)
    assert request(bench, "RC_CHANNELS").rssi == 0


def test_heartbeats_are_forwarded_to_other_links_and_not_back() -> None:
    bench = Bench(profile="onboard")
    station = Client(bench.autopilot.open_port("gcs"), 255, 190)
    log = Client(bench.autopilot.open_port("minimal"), 42, 1)
    for client in (bench.client, station, log):
        client.forget()
    station.send(dialect.MAVLink_heartbeat_message(dialect.MAV_TYPE_GCS, 8, 0, 0, 4, 3))
    theirs = [m for m in bench.client.of("HEARTBEAT") if m.get_srcSystem() == 255]
    assert [(m.get_srcComponent(), m.type) for m in theirs] == [(190, dialect.MAV_TYPE_GCS)]
    assert not [m for m in station.of("HEARTBEAT") if m.get_srcSystem() == 255]
    assert not [m for m in log.of("HEARTBEAT") if m.get_srcSystem() == 255]
    own = Packer(1, 1).pack(dialect.MAVLink_heartbeat_message(2, 12, 0, 0, 0, 3))
    bench.client.forget()
    station.port.receive(own)  # an echo of the vehicle itself is not forwarded
    assert not bench.client.of("HEARTBEAT")


def test_every_selectable_mode_is_listed(bench: Bench) -> None:
    bench.client.command(dialect.MAV_CMD_REQUEST_MESSAGE, dialect.MAVLINK_MSG_ID_AVAILABLE_MODES, 0)
    modes = bench.client.of("AVAILABLE_MODES")
    assert {m.custom_mode for m in modes} == {
        mode.custom_mode for name, mode in MODES.items() if name not in {"READY", "TERMINATION", *EXTERNAL_MODES}
    }
    assert [m.mode_index for m in modes] == list(range(1, len(modes) + 1))


def test_a_fast_stream_sends_one_message_per_tick() -> None:
    bench = Bench(profile="onboard")
    bench.client.forget()
    bench.run(2.0)
    assert len(bench.client.of("ATTITUDE")) == pytest.approx(2e6 / TICK_US, abs=1)
    bench.client.command(
        dialect.MAV_CMD_SET_MESSAGE_INTERVAL, dialect.MAVLINK_MSG_ID_HIGHRES_IMU, 5000
    )  # faster than the ticks
    bench.client.forget()
    bench.run(2.0)
    assert len(bench.client.of("HIGHRES_IMU")) == pytest.approx(2e6 / TICK_US, abs=1)
