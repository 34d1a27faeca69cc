"""The air: a steady wind, and on top of it Dryden gusts as MIL-F-8785C gives them for low altitude.

Spectra, with tau = L / V (3.7.2 of the standard):
    along     sigma · sqrt(2·tau) / (1 + tau·s)                            (scaled for unit-intensity white noise)
    across    sigma · sqrt(tau) · (1 + sqrt(3)·tau·s) / (1 + tau·s)²
Both are discretised exactly, so that the standard deviation does not depend on the update period.
"""

import math
from dataclasses import dataclass

from foundation.compiled import Grid, Record, njit
from foundation.frames import Vec3
from vehicles.noise import normal
from vehicles.records import RandomStream

PERIOD_US = 10_000
PERIOD_S = 0.01
FOOT = 0.3048
SQRT_3 = math.sqrt(3.0)
# Frozen turbulence needs the air to pass by; a vehicle that drifts with the wind still meets some eddies.
AIRSPEED_MIN = 1.0  # m/s


@dataclass(frozen=True, slots=True)
class Wind:
    """A wind to fly in."""

    mean_ned: Vec3 = (0.0, 0.0, 0.0)  # m/s, the direction the air moves to
    w20: float = 0.0  # m/s, wind at 20 ft that sets the gusts; MIL-F-8785C: 7.7 light, 15.4 moderate, 23 severe


CALM = Wind()


@njit(cache=True)
def scales(height: float, w20: float) -> tuple[float, float, float, float]:
    """Return (sigma along and across, sigma vertical in m/s, length along and across, length vertical in m).

    MIL-F-8785C 3.7.3.4, for `height` (m) above ground held within the standard's 10 to 1000 ft.
    """
    feet = min(max(height / FOOT, 10.0), 1000.0)
    shape = 0.177 + 0.000823 * feet
    vertical = 0.1 * w20
    return vertical / shape**0.4, vertical, feet / shape**1.2 * FOOT, feet * FOOT


@njit(cache=True)
def _across(states: Grid, sigma: float, tau: float, rng: RandomStream) -> float:
    """Advance one second-order filter by PERIOD_S and return the gust (m/s).

    H = √3·a + (1 - √3)·b with a = w / (1 + tau·s), b = a / (1 + tau·s); the covariance of the two is the integral of
    their impulse responses over the period. States are kept for tau = 1 intensity, so that tau may change in flight.
    """
    h = PERIOD_S / tau
    p, p2 = math.exp(-h), math.exp(-2.0 * h)
    var_a = 0.5 * (1.0 - p2)
    cov = 0.25 - p2 * (0.5 * h + 0.25)
    var_b = max(0.25 - p2 * (0.5 * h * h + 0.5 * h + 0.25), 0.0)
    noise_a, noise_b = normal(rng), normal(rng)
    a, b = states[0], states[1]
    root = math.sqrt(var_a)
    states[0] = p * a + root * noise_a
    states[1] = p * b + h * p * a + cov / root * noise_a + math.sqrt(max(var_b - cov * cov / var_a, 0.0)) * noise_b
    blown: float = sigma * (SQRT_3 * states[0] + (1.0 - SQRT_3) * states[1])
    return blown


@njit(cache=True)
def gust(air: Record, velocity: Grid, height: float) -> None:
    """Advance the gusts of `air` by one period; `velocity` (m/s, NED) and `height` (m) are the vehicle's."""
    sigma_h, sigma_v, length_h, length_v = scales(height, air.w20)
    north, east, down = velocity[0] - air.mean[0], velocity[1] - air.mean[1], velocity[2] - air.mean[2]
    speed = max(math.sqrt(north * north + east * east + down * down), AIRSPEED_MIN)
    tau_h, tau_v = length_h / speed, length_v / speed
    p = math.exp(-PERIOD_S / tau_h)
    air.filter[0, 0] = p * air.filter[0, 0] + math.sqrt(1.0 - p * p) * normal(air.rng)
    along = sigma_h * air.filter[0, 0]
    across = _across(air.filter[1], sigma_h, tau_h, air.rng)
    air.gust[2] = _across(air.filter[2], sigma_v, tau_v, air.rng)
    # axes: along the steady wind, as the standard has it at low altitude
    calm = math.sqrt(air.mean[0] ** 2 + air.mean[1] ** 2)
    c, s = (air.mean[0] / calm, air.mean[1] / calm) if calm > 0.1 else (1.0, 0.0)
    air.gust[0] = c * along - s * across
    air.gust[1] = s * along + c * across
