"""Degraded sensors: noise that grows by a factor, and fixes that are older than their time stamp."""

import numpy as np
import pytest

from foundation.errors import UsageError
from foundation.frames import geodetic_to_ned
from tests.vehicles.fleet import HIGH, ORIGIN, vehicle
from vehicles.multirotor import Multirotor
from vehicles.sensors import PERFECT, Suite
from vehicles.wind import Wind


def sigma(craft: Multirotor, field: str, every: int) -> float:
    """Return the standard deviation of 1,500 samples at this period in milliseconds."""
    values = []
    for _ in range(1500):
        craft.advance(every)
        values.append(np.copy(craft.sensors[field]))
    return float(np.mean(np.std(np.array(values), axis=0)))


@pytest.mark.parametrize(("field", "every"), [("accel_frd", 1), ("gyro_frd", 1), ("mag_frd", 10), ("pressure_hpa", 20)])
def test_noise_grows_by_its_factor_after_the_change(field: str, every: int) -> None:
    craft = vehicle(position_ned=HIGH)
    assert sigma(craft, field, every) > 0.0
    before, after = vehicle(), vehicle()
    after.advance(100)
    after.set_sensor_suite(Suite().degraded(noise=4.0))
    assert sigma(after, field, every) == pytest.approx(4.0 * sigma(before, field, every), rel=0.15)


def test_gps_errors_grow_by_their_factor_but_the_reported_accuracy_does_not_change() -> None:
    spread, reported = [], []
    for factor in (1.0, 5.0):
        errors = []
        for seed in range(60):
            craft = vehicle(seed=seed, suite=Suite().degraded(gps_noise=factor))
            craft.advance(500)
            fix = (craft.sensors["gps_lat_deg"], craft.sensors["gps_lon_deg"], craft.sensors["gps_alt_m"])
            errors.append(np.array(geodetic_to_ned(*ORIGIN, *fix)) - craft.truth["position_ned"])
            reported.append(float(craft.sensors["gps_eph_m"]))
        spread.append(np.std(errors))
    assert spread[1] == pytest.approx(5.0 * spread[0], rel=0.01)
    assert set(reported) == {Suite().gps_eph_m}


@pytest.mark.parametrize("factor", [0.5, 1.0, 10.0])
def test_wandering_errors_scale_at_once_by_their_factor(factor: float) -> None:
    """Otherwise, an error with a time constant of half an hour would grow for the rest of the flight."""
    fixes: dict[float, list[np.ndarray]] = {0.5: [], 30.0: []}  # m, by seconds after the change
    drifts: dict[float, list[float]] = {0.5: [], 30.0: []}  # hPa
    for changed in (1.0, factor):
        for after_s in fixes:
            errors, airs = [], []
            for seed in range(12):
                craft = vehicle(seed=seed)
                craft.advance(500)
                craft.set_sensor_suite(Suite().degraded(gps_noise=changed, noise=changed))
                craft.advance(round(after_s * 1000))
                fix = (craft.sensors["gps_lat_deg"], craft.sensors["gps_lon_deg"], craft.sensors["gps_alt_m"])
                errors.append(np.array(geodetic_to_ned(*ORIGIN, *fix)) - craft.truth["position_ned"])
                airs.append(float(craft.memory["baro_drift"]))
            fixes[after_s].append(np.array(errors))
            drifts[after_s].append(float(np.sqrt(np.mean(np.square(airs)))))
    for after_s, (plain, worse) in fixes.items():
        assert rms(worse) == pytest.approx(factor * rms(plain), rel=0.02)
        assert drifts[after_s][1] == pytest.approx(factor * drifts[after_s][0], rel=0.02)


def rms(errors: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(errors))))


def test_a_delayed_fix_has_an_older_position_than_its_time_stamp() -> None:
    craft = vehicle(position_ned=HIGH, suite=PERFECT.degraded(gps_delay_s=0.3))
    craft.state["velocity"] = (5.0, -3.0, 0.0)
    places, seen = {}, set()
    for _ in range(2000):
        craft.advance(1)
        places[int(craft.truth["time_us"])] = craft.truth["position_ned"].copy()
        named = int(craft.sensors["gps_time_us"])
        if named == 0 or named in seen:
            continue
        seen.add(named)
        assert craft.sensors["time_us"] - named == PERFECT.gps_latency_us  # the stamp hides the extra delay
        fix = (craft.sensors["gps_lat_deg"], craft.sensors["gps_lon_deg"], craft.sensors["gps_alt_m"])
        assert geodetic_to_ned(*ORIGIN, *fix) == pytest.approx(places[named - 300_000], abs=1e-3)
    assert len(seen) == 16  # of twenty fixes, four have not arrived yet


def test_a_too_long_gps_delay_is_rejected() -> None:
    Suite().degraded(gps_delay_s=1.4)
    with pytest.raises(UsageError, match="gps_late_us = 1600000"):
        Suite().degraded(gps_delay_s=1.6)


def test_gusts_that_start_in_flight_update_every_10_ms() -> None:
    craft = vehicle(position_ned=(0.0, 0.0, -5000.0))
    craft.advance(2000)
    craft.set_wind(Wind((3.0, 0.0, 0.0), 10.0))
    before = craft.air["filter"].copy()
    craft.advance(1)
    once = craft.air["filter"].copy()
    craft.advance(9)
    assert (once != before).any()
    assert (craft.air["filter"] == once).all()  # one update per 10 ms, and none to catch up
