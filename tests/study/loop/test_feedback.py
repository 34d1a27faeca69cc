"""The delay line. A simulated loop without delay equals the normal flight."""

import math
from typing import Any

import numpy as np
import pytest
from numba import njit

from autopilot.control.flight_core import FlightCore
from autopilot.records import ESTIMATE, KIND_TRAJECTORY
from dronecats.flight.sitl.fused import Fused
from dronecats.study.loop.feedback import CHANNELS, COLUMNS, DELAY_LINE_ROWS, RATE, delayed, simulate_with_delay
from dronecats.study.loop.linear import delay_margin
from dronecats.study.loop.margins import injected_margin, oscillation
from foundation.errors import UsageError
from vehicles.airframe import load
from vehicles.multirotor import Multirotor

ORIGIN = (47.4, 8.5, 488.0)


def test_the_delay_line_returns_the_delayed_sample():
    for newest in (0, 5, 63):
        for delay in (0.0, 1.0, 2.25, 17.5, 62.0):
            line = np.zeros((64, 1))
            for age in range(64):
                line[(newest - age) % 64, 0] = -age  # a ramp: the value `age` samples ago is -age
            assert delayed(line, newest, 0, delay) == pytest.approx(-delay, abs=1e-12), (newest, delay)


def fly_push(compiled):
    """Fly a take-off and a push sideways with the usual sensor errors; return the truth and the state as bytes."""
    vehicle, core = Multirotor(load("x500"), seed=3, origin=ORIGIN), FlightCore(load("x500"))
    args = core.kernel_args(vehicle.sensors, vehicle.actuators)
    advance = compiled(vehicle, core, args)
    for seconds, velocity_ned in ((4.0, None), (3.0, (0.0, 0.0, -2.0)), (2.0, (1.0, -0.5, 0.0))):
        if velocity_ned:
            core.setpoint["kind"], core.setpoint["armed"], core.setpoint["velocity_ned"] = (
                KIND_TRAJECTORY,
                1,
                velocity_ned,
            )
        advance(round(seconds * 1000))
    return vehicle.record.tobytes(), core.state.tobytes()


def test_without_delay_the_loop_equals_the_flight_to_the_byte():
    def fused(vehicle, core, args):
        return Fused(vehicle.kernel_args, args).advance

    def punctual(vehicle, core, args):
        line, estimate = np.zeros((DELAY_LINE_ROWS, CHANNELS)), np.zeros(1, ESTIMATE)[0]
        return lambda steps: simulate_with_delay(
            RATE, 0, 0.0, np.empty((steps, COLUMNS)), line, estimate, *vehicle.kernel_args, *args[:8]
        )

    assert fly_push(fused) == fly_push(punctual)


WN, ZETA = 2.0, 0.3  # L = ωn² / (s (s + 2 ζ ωn)); its delay margin has a closed form
CROSSOVER = WN * math.sqrt(math.sqrt(1.0 + 4.0 * ZETA**4) - 2.0 * ZETA**2)
KNOWN_S = math.atan2(2.0 * ZETA * WN, CROSSOVER) / CROSSOVER


def open_loop(s: Any) -> Any:
    return WN**2 / (s * (s + 2.0 * ZETA * WN))


@njit
def second_order(delay, rows):
    """Return the response to a unit step, with feedback that is delayed by `delay` milliseconds."""
    out, line = np.zeros(rows), np.zeros((1024, 1))
    place = speed = 0.0
    for k in range(rows):
        line[k % 1024, 0] = place
        push = WN**2 * (1.0 - delayed(line, k % 1024, 0, delay)) - 2.0 * ZETA * WN * speed
        place += 1e-3 * speed + 0.5e-6 * push
        speed += 1e-3 * push
        out[k] = place
    return out


def test_the_predicted_and_the_injected_delay_margin_equal_the_closed_form():
    predicted = delay_margin(open_loop)
    assert predicted.delay_s == pytest.approx(KNOWN_S, rel=0.01)
    injected = injected_margin(
        lambda delay_s: oscillation(second_order(1e3 * delay_s, 40_000)[5_000:], 1e-3, CROSSOVER), predicted.delay_s
    )
    assert injected.delay_s == pytest.approx(KNOWN_S, rel=0.01)
    assert injected.frequency == pytest.approx(CROSSOVER, rel=0.01)


def test_a_loop_that_never_oscillates_is_reported():
    with pytest.raises(UsageError, match=r" 0\.82 s"):
        injected_margin(lambda delay_s: None, 0.1)
    never = delay_margin(lambda s: np.asarray(0.5 / (s + 1.0), np.complex128))
    assert never.delay_s == math.inf


def test_an_oscillation_is_distinguished_from_drift_offset_and_overtone():
    for growth in (-0.4, -0.01, 0.0, 0.02):
        time = np.arange(12_000) * 1e-3
        swing = 0.1 * np.exp(growth * time) * np.sin(6.0 * time + 1.0)
        signal = 0.3 + 0.05 * time + swing + 0.002 * np.sin(12.0 * time)
        result = oscillation(signal, 1e-3, 5.0)
        assert result is not None, growth
        assert result.growth == pytest.approx(growth, abs=2e-3), growth
        assert result.frequency == pytest.approx(6.0, rel=1e-3), growth
