"""Random numbers for the kernels: one 64-bit word of state per stream, kept in the vehicle's records.

Generator: SplitMix64 (Steele, Lea, Flood 2014). Normal deviates: the ziggurat of Marsaglia and Tsang (2000) with 128
layers in the form of Doornik (2005). Bytes depend on the seed alone, not on the numpy version.
"""

import math

import numpy as np

from foundation.compiled import Grid, njit
from vehicles.records import RandomStream

_TAIL = 3.442619855899  # where the tail begins, 128 layers
_AREA = 9.91256303526217e-3  # of each layer

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX_2 = np.uint64(0x94D049BB133111EB)
_SHIFT_30, _SHIFT_27, _SHIFT_31, _SHIFT_11 = np.uint64(30), np.uint64(27), np.uint64(31), np.uint64(11)
_LAYER_MASK = np.uint64(127)


def _layers() -> Grid:
    """Return the right edges of the 128 layers and a closing zero."""
    x = np.zeros(129)
    x[0], x[1] = _AREA / math.exp(-0.5 * _TAIL**2), _TAIL
    for i in range(2, 128):
        x[i] = math.sqrt(-2.0 * math.log(_AREA / x[i - 1] + math.exp(-0.5 * x[i - 1] ** 2)))
    return x


_EDGE = _layers()
_INNER = _EDGE[1:] / _EDGE[:-1]  # share of each layer that lies under the curve for certain


def streams(seed: int, count: int) -> RandomStream:
    """Return `count` independent stream states, shape (count,), that depend on `seed` alone."""
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
