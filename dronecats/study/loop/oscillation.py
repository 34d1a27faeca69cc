"""How fast a small oscillation grows or fades: the poles of a signal by the matrix pencil.

After Hua and Sarkar 1990, "Matrix pencil method for estimating parameters of exponentially damped/undamped sinusoids in
noise" (IEEE Trans. ASSP 38). Unlike an envelope it needs no peaks, and an offset or a slow drift is a pole of its own.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

A_PERIOD = 10  # samples of the expected oscillation's period that are looked at
KEPT = 1e-6  # of the largest singular value: what is smaller is rounding and quantisation
MODES = 12  # at most
NEAR = (0.3, 3.0)  # × the expected frequency: where the loop's own oscillation is looked for


@dataclass(frozen=True, slots=True)
class Oscillation:
    """The strongest oscillation of a signal near an expected frequency."""

    growth: float  # 1/s; below 0 it fades
    frequency: float  # rad/s
    size: float  # of its amplitude at the signal's beginning

    @property
    def damping_ratio(self) -> float:
        """-growth over the distance of the pole from the origin: 0 where it neither grows nor fades."""
        return -self.growth / math.hypot(self.growth, self.frequency)


def oscillation(signal: Array, step_s: float, expected: float) -> Oscillation | None:
    """Return the strongest oscillation between NEAR times `expected` (rad/s) of a signal sampled every `step_s` (s).

    The strongest has most energy over the signal's length: rotors that speed up faster than they slow down leave weak
    overtones beside it. None where there is none.
    """
    every = max(round(2.0 * math.pi / expected / A_PERIOD / step_s), 1)
    values, period = signal[::every], every * step_s
    columns = len(values) // 3
    hankel = np.lib.stride_tricks.sliding_window_view(values, columns + 1)
    _, sizes, right = np.linalg.svd(hankel, full_matrices=False)
    rank = min(int((sizes > KEPT * sizes[0]).sum()), MODES)
    modes = right[:rank].T
    factors = np.linalg.eigvals(np.linalg.lstsq(modes[:-1], modes[1:], rcond=None)[0])
    factors = factors[np.abs(factors) > 1e-6]
    poles = np.log(factors) / period
    powers = factors[None, :] ** np.arange(len(values))[:, None]
    sizes = np.abs(np.linalg.lstsq(powers, values.astype(np.complex128), rcond=None)[0])
    energy = (sizes[None, :] * np.abs(powers)) ** 2
    near = np.flatnonzero((poles.imag > NEAR[0] * expected) & (poles.imag < NEAR[1] * expected))
    if not near.size:
        return None
    k = int(near[np.argmax(energy.sum(axis=0)[near])])
    return Oscillation(float(poles.real[k]), float(poles.imag[k]), float(sizes[k]))
