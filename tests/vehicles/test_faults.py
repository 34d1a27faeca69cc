"""Faults: each kind has its effect for its duration."""

from typing import Any

import numpy as np
import pytest

from foundation.frames import geodetic_to_ned
from tests.support.refusal import refusal
from tests.vehicles.fleet import HIGH, ORIGIN, vehicle
from vehicles.faults import Fault
from vehicles.sensors import PERFECT

TIMES = {"accel": "imu", "gyro": "imu", "mag": "mag", "baro": "baro", "gps": "gps", "range": "range"}
VALUES = {
    "accel": "accel_frd",
    "gyro": "gyro_frd",
    "mag": "mag_frd",
    "baro": "pressure_hpa",
    "gps": "gps_velocity_ned",
    "range": "range_m",
}
WHILE: dict[str, Any] = {"from_us": 500_000, "until_us": 1_500_000}


@pytest.mark.parametrize("part", TIMES)
def test_a_failed_sensor_is_silent_until_it_recovers(part: str) -> None:
    craft = vehicle(faults=[Fault(part, "fail", **WHILE)])
    craft.advance(1450)
    assert 0 < craft.sensors[f"{TIMES[part]}_time_us"] < 500_000
    craft.advance(550)
    assert craft.sensors[f"{TIMES[part]}_time_us"] > 1_800_000


@pytest.mark.parametrize("part", TIMES)
def test_a_frozen_sensor_repeats_its_value_with_new_times(part: str) -> None:
    craft = vehicle(faults=[Fault(part, "freeze", **WHILE)])
    craft.advance(700)
    before = np.copy(craft.sensors[VALUES[part]])
    craft.advance(700)
    assert np.all(before == craft.sensors[VALUES[part]])
    assert craft.sensors[f"{TIMES[part]}_time_us"] > 1_200_000
    craft.advance(600)
    assert np.all(before != craft.sensors[VALUES[part]])


@pytest.mark.parametrize("part", ["accel", "gyro", "mag", "baro", "range"])
def test_a_biased_sensor_is_off_by_the_value(part: str) -> None:
    sound = vehicle(suite=PERFECT)
    biased = vehicle(suite=PERFECT, faults=[Fault(part, "bias", value=(0.5, -0.25, 0.125), **WHILE)])
    for steps, factor in ((400, 0.0), (600, 1.0), (1000, 0.0)):
        sound.advance(steps)
        biased.advance(steps)
        difference = np.ravel(biased.sensors[VALUES[part]] - sound.sensors[VALUES[part]])
        expected = factor * np.array((0.5, -0.25, 0.125))[: difference.size]
        assert difference == pytest.approx(expected, abs=1e-9)
    assert biased.truth.tobytes() == sound.truth.tobytes()


def test_a_gps_bias_moves_the_fix_by_metres() -> None:
    craft = vehicle(suite=PERFECT, faults=[Fault("gps", "bias", value=(30.0, -20.0, 5.0))])
    craft.advance(500)
    fix = (craft.sensors["gps_lat_deg"], craft.sensors["gps_lon_deg"], craft.sensors["gps_alt_m"])
    offset = np.array(geodetic_to_ned(*ORIGIN, *fix)) - craft.truth["position_ned"]
    assert offset == pytest.approx((30.0, -20.0, 5.0), abs=1e-3)


def test_a_delayed_fix_is_late_and_fixes_stay_in_order() -> None:
    craft = vehicle(faults=[Fault("gps", "delay", value=(0.4, 0.0, 0.0), **WHILE)])
    ages: list[int] = []
    valid: list[int] = []
    for _ in range(3000):
        craft.advance(1)
        if craft.sensors["gps_time_us"] and (not valid or valid[-1] != craft.sensors["gps_time_us"]):
            valid.append(int(craft.sensors["gps_time_us"]))
            ages.append(int(craft.sensors["time_us"]) - valid[-1])
    assert valid == sorted(valid)
    assert min(ages) == 100_000
    assert max(ages) == 500_000


def test_a_failed_rotor_stops_and_a_weak_one_turns_slower() -> None:
    craft = vehicle(position_ned=HIGH, faults=[Fault("rotor2", "fail"), Fault("rotor3", "weaken", value=(0.5, 0, 0))])
    craft.actuators["armed"] = 1
    craft.actuators["command"][:4] = 0.6
    craft.advance(300)
    sound, dead, weak = craft.state["rotor_speed"][:3]
    assert dead == 0.0
    assert weak == pytest.approx(0.5 * sound, rel=1e-3)


def test_a_rotor_recovers_when_its_fault_ends() -> None:
    craft = vehicle(faults=[Fault("rotor1", "fail", 0, 200_000)])
    craft.actuators["armed"] = 1
    craft.advance(100)
    assert craft.state["rotor_speed"][0] == 0.0
    craft.advance(500)
    assert craft.state["rotor_speed"][0] == pytest.approx(150.0, rel=1e-3)


def test_an_invalid_fault_is_rejected() -> None:
    for fault, word in [
        (Fault("sonar", "fail"), "fail of sonar"),
        (Fault("rotor5", "fail"), "fail of rotor5"),
        (Fault("mag", "delay"), "delay of mag"),
        (Fault("mag", "explode"), "explode of mag"),
        (Fault("rotor1", "freeze"), "freeze of rotor1"),
        (Fault("mag", "fail", 10, 10), "fail of mag"),
        (Fault("gps", "delay", value=(9.0, 0.0, 0.0)), "delay of gps"),
        (Fault("rotor1", "weaken", value=(2.0, 0.0, 0.0)), "weaken of rotor1"),
    ]:
        assert word in refusal(vehicle, faults=[fault])
