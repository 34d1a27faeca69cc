"""Wind, gusts, the battery, and their random numbers."""

import numpy as np
import pytest
from numba import njit

from tests.vehicles.fleet import HIGH, vehicle
from vehicles import rotor
from vehicles import wind as noise
from vehicles.records import AIR
from vehicles.wind import Wind, gust, scales


@njit
def _normals(rng, count):
    out = np.empty(count)
    for i in range(count):
        out[i] = noise.normal(rng)
    return out


@njit
def _gusts(air, velocity, height, count):
    out = np.empty((count, 3))
    for i in range(count):
        gust(air, velocity, height)
        out[i] = air.gust
    return out


def test_random_numbers_have_the_moments_and_tails_of_a_normal_distribution() -> None:
    x = _normals(noise.streams(5, 1), 2_000_000)
    assert np.mean(x) == pytest.approx(0.0, abs=0.003)
    assert np.var(x) == pytest.approx(1.0, abs=0.005)
    assert np.mean(x**3) == pytest.approx(0.0, abs=0.015)
    assert np.mean(x**4) == pytest.approx(3.0, abs=0.03)
    assert np.mean(np.abs(x) > 3.5) == pytest.approx(4.65e-4, rel=0.15)
    assert np.corrcoef(x[:-1], x[1:])[0, 1] == pytest.approx(0.0, abs=0.003)


def test_dryden_gusts_have_the_deviation_and_correlation_of_the_standard() -> None:
    air = np.zeros(1, AIR)[0]
    air["w20"], air["mean"], air["rng"] = 15.0, (15.0, 0.0, 0.0), noise.streams(9, 1)
    samples = _gusts(air, np.zeros(3), 20.0, 1_000_000)
    sigma_h, sigma_v, length_h, length_v = scales(20.0, 15.0)
    assert sigma_v == pytest.approx(1.5)
    assert length_v == pytest.approx(20.0)
    assert length_h > length_v
    assert np.std(samples, axis=0) == pytest.approx((sigma_h, sigma_h, sigma_v), rel=0.07)
    # along the wind the correlation falls to 1/e after tau = L / V
    lag = round(length_h / 15.0 / 0.01)
    u = samples[:, 0] - samples[:, 0].mean()
    assert np.mean(u[:-lag] * u[lag:]) / np.var(u) == pytest.approx(np.exp(-1.0), abs=0.1)


def test_gusts_are_off_by_default_and_on_if_configured() -> None:
    calm, rough = vehicle(position_ned=HIGH), vehicle(position_ned=HIGH, wind=Wind(w20=10.0))
    calm.advance(2000)
    rough.advance(2000)
    assert np.all(calm.air["gust"] == 0.0)
    assert np.linalg.norm(rough.air["gust"]) > 0.01


def test_a_falling_vehicle_drifts_with_a_steady_wind() -> None:
    craft = vehicle(position_ned=(0.0, 0.0, -5000.0), wind=Wind(mean_ned=(0.0, 6.0, 0.0)))
    craft.advance(30_000)
    before = craft.truth["velocity_ned"][1]
    craft.advance(60_000)
    assert 0.8 * 6.0 < before < craft.truth["velocity_ned"][1] < 6.0  # it approaches the wind speed from below


def test_the_battery_charge_falls_by_the_integral_of_the_current() -> None:
    craft = vehicle(position_ned=HIGH)
    craft.actuators["armed"] = 1
    craft.actuators["command"][:4] = 0.75
    before, taken = float(craft.state["charge_ah"]), 0.0
    for _ in range(200):
        craft.advance(10)
        taken += float(craft.state["current"]) * 0.01 / 3600.0
    assert before - craft.state["charge_ah"] == pytest.approx(taken, rel=1e-6)
    assert 10.0 < craft.state["current"] < 40.0  # a 2 kg quadrotor draws about 20 A at 15 V
    assert craft.sensors["battery_voltage"] < 4 * 4.2 - 0.2  # sag
    assert 0.9 < craft.sensors["battery_remaining"] < 1.0


def test_voltage_falls_with_charge_and_sags_with_current() -> None:
    charge = np.linspace(0.0, 1.0, 101)
    volts = np.array([rotor.open_circuit(c) for c in charge])
    assert np.all(np.diff(volts) > 0.0)
    assert volts[-1] == 4.2
    assert rotor.open_circuit(rotor.COLLAPSE) == 0.0
    craft = vehicle()
    craft.advance(100)
    state = craft.state
    rest = 4 * rotor.open_circuit(state["charge_ah"] / 5.0)
    assert rest - state["voltage"] == pytest.approx(state["current"] * 0.02, rel=1e-3)


def test_rotors_turn_slower_on_a_low_battery_and_stop_on_an_empty_one() -> None:
    def speed(charge: float) -> float:
        craft = vehicle(position_ned=HIGH)
        craft.state["charge_ah"] = charge * 5.0
        craft.actuators["armed"] = 1
        craft.actuators["command"][:4] = 0.7
        craft.advance(1000)
        return float(craft.state["rotor_speed"][0])

    assert speed(1.0) > speed(0.5) > speed(0.1) > 400.0
    assert speed(rotor.COLLAPSE) < 1.0
