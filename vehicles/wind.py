"""Wind and random numbers: a steady wind with Dryden gusts (MIL-F-8785C, low altitude), and streams of noise.

A stream of random numbers has one 64-bit word of state in the vehicle's records. The generator is SplitMix64 (Steele,
Lea, Flood 2014). Normal deviates come from the ziggurat of Marsaglia and Tsang (2000) with 128 layers in the form of
Doornik (2005). The numbers depend only on the seed, not on the numpy version.

Filters of the gusts, with tau = length scale L / airspeed V (3.7.2 of the standard):
    along     sigma · sqrt(2·tau) / (1 + tau·s)                            (scaled for unit-intensity white noise)
    across    sigma · sqrt(tau) · (1 + sqrt(3)·tau·s) / (1 + tau·s)²
Both are discretised exactly, so that the standard deviation does not depend on the update period.
"""

import math
from dataclasses import dataclass

import numpy as np

from foundation.compiled import Grid, Record, njit
from foundation.frames import Vec3
from vehicles.records import RandomStream

_TAIL = 3.442619855899  # x at which the tail of the normal density begins, for 128 layers
_AREA = 9.91256303526217e-3  # area of each layer

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX_2 = np.uint64(0x94D049BB133111EB)
_SHIFT_30, _SHIFT_27, _SHIFT_31, _SHIFT_11 = np.uint64(30), np.uint64(27), np.uint64(31), np.uint64(11)
_LAYER_MASK = np.uint64(127)


def _layers() -> Grid:
    """Return the right edges (x) of the ziggurat's 128 layers, and a closing zero."""
    x = np.zeros(129)
    x[0], x[1] = _AREA / math.exp(-0.5 * _TAIL**2), _TAIL
    for i in range(2, 128):
        x[i] = math.sqrt(-2.0 * math.log(_AREA / x[i - 1] + math.exp(-0.5 * x[i - 1] ** 2)))
    return x


_EDGE = _layers()
_INNER = _EDGE[1:] / _EDGE[:-1]  # share of each layer that is certainly under the curve


def streams(seed: int, count: int) -> RandomStream:
    """Return the initial states of `count` independent streams, shape (count,); they depend on `seed` alone."""
    return np.random.SeedSequence(seed).generate_state(count, np.uint64).astype(np.uint64, copy=False)


@njit(cache=True)
def _word(rng: RandomStream) -> np.uint64:
    rng[0] += _GOLDEN
    z: np.uint64 = rng[0]
    z = (z ^ (z >> _SHIFT_30)) * _MIX_1
    z = (z ^ (z >> _SHIFT_27)) * _MIX_2
    return z ^ (z >> _SHIFT_31)


@njit(cache=True)
def uniform(rng: RandomStream) -> float:
    """Return a number uniform in [0, 1) and advance the stream."""
    return float(_word(rng) >> _SHIFT_11) * 1.1102230246251565e-16  # 2⁻⁵³


@njit(cache=True)
def normal(rng: RandomStream) -> float:
    """Return a standard normal number and advance the stream."""
    while True:
        word = _word(rng)
        layer = np.int64(word & _LAYER_MASK)
        side = float(word >> _SHIFT_11) * 2.220446049250313e-16 - 1.0  # uniform in [-1, 1)
        if abs(side) < _INNER[layer]:
            inside: float = side * _EDGE[layer]
            return inside
        if layer == 0:
            while True:
                x = math.log(1.0 - uniform(rng)) / _TAIL
                y = math.log(1.0 - uniform(rng))
                if -2.0 * y >= x * x:
                    return x - _TAIL if side < 0.0 else _TAIL - x
        x = float(side * _EDGE[layer])
        top = math.exp(-0.5 * (_EDGE[layer] ** 2 - x * x))
        bottom = math.exp(-0.5 * (_EDGE[layer + 1] ** 2 - x * x))
        if bottom + uniform(rng) * (top - bottom) < 1.0:
            return x


PERIOD_US = 10_000  # µs between two updates of the gusts
PERIOD_S = 0.01
FOOT = 0.3048  # m
SQRT_3 = math.sqrt(3.0)
# Least airspeed of the turbulence model. The model has no gusts at airspeed 0, but real wind has some.
AIRSPEED_MIN = 1.0  # m/s


@dataclass(frozen=True, slots=True)
class Wind:
    """A steady wind and the strength of its gusts."""

    mean_ned: Vec3 = (0.0, 0.0, 0.0)  # m/s, velocity of the air
    w20: float = 0.0  # m/s, wind at 20 ft that sets the gusts; MIL-F-8785C: 7.7 light, 15.4 moderate, 23 severe


CALM = Wind()


@njit(cache=True)
def scales(height: float, w20: float) -> tuple[float, float, float, float]:
    """Return four scales of the gusts: horizontal and vertical sigma (m/s), horizontal and vertical length (m).

    MIL-F-8785C 3.7.3.4, for `height` (m) above ground, clamped to the standard's 10 to 1000 ft.
    """
    feet = min(max(height / FOOT, 10.0), 1000.0)
    shape = 0.177 + 0.000823 * feet
    vertical = 0.1 * w20
    return vertical / shape**0.4, vertical, feet / shape**1.2 * FOOT, feet * FOOT


@njit(cache=True)
def _across(states: Grid, sigma: float, tau: float, rng: RandomStream) -> float:
    """Advance one second-order filter by PERIOD_S and return the gust (m/s).

    The gust is sigma · (√3·a + (1 - √3)·b), with the states a = w / (1 + tau·s) and b = a / (1 + tau·s) of white noise
    w. The noise of a and b over a period has the covariance that follows from their impulse responses. The states do
    not contain sigma, so that tau and sigma may change in flight.
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
    # axes along the steady wind, as in the standard at low altitude
    mean_speed = math.sqrt(air.mean[0] ** 2 + air.mean[1] ** 2)
    c, s = (air.mean[0] / mean_speed, air.mean[1] / mean_speed) if mean_speed > 0.1 else (1.0, 0.0)
    air.gust[0] = c * along - s * across
    air.gust[1] = s * along + c * across
