"""The path of a flight from what its estimator said: an RTS smoother, axis by axis, that knows what it cannot know.

What an estimator reports is filtered already: its error does not change from one report to the next but wanders with
the satellites. So the position that is reported is taken as the true one plus an error that wanders slowly (a
Gauss-Markov process of the accuracy that was reported, over CORRELATION_S), and no number of reports in one flight
averages that away. What the smoother takes out is what is short: noise, and jumps of the estimate that its velocity
knows nothing of.

State per axis: position, velocity (constant but for white noise in the acceleration), error of the estimated position.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
CORRELATION_S = 300.0  # s, a flight's length: longer than what a receiver's error stays the same in the open
POSITION_NOISE_M = 0.05  # m, white, of one report: the estimator's small corrections
ACCELERATION_PSD = 1.0  # (m/s²)²/Hz: a multirotor at the speeds that are flown here
UNREPORTED_M = 1.0  # m, weight of a position whose accuracy nobody reported; its smoothed accuracy is not told
THINNED_US = 90_000  # µs: reports nearer to one another tell the same
_H = np.array([[1.0, 0.0, 1.0], [0.0, 1.0, 0.0]])


@dataclass(frozen=True, slots=True)
class Estimates:
    """What an autopilot's estimator said of itself in the course of a flight, in its local frame."""

    time_us: Array  # (n,) µs, vehicle clock, strictly rising
    position_ned: Array  # (n, 3) m
    velocity_ned: Array  # (n, 3) m/s
    position_std_m: Array  # (n, 3) m, as reported; NaN where it was not
    velocity_std_mps: Array  # (n, 3) m/s

    def between(self, from_us: float, to_us: float) -> "Estimates":
        """Return what was said in a stretch of time."""
        part = slice(*np.searchsorted(self.time_us, (from_us, to_us)))
        return Estimates(
            self.time_us[part],
            self.position_ned[part],
            self.velocity_ned[part],
            self.position_std_m[part],
            self.velocity_std_mps[part],
        )


@dataclass(frozen=True, slots=True)
class SmoothedPath:
    """Where the vehicle was at the instants asked for."""

    time_us: Array  # (k,) µs
    position_ned: Array  # (k, 3) m
    std_m: Array  # (k, 3) m; NaN where no accuracy was ever reported


def smooth(estimates: Estimates, at_us: Array) -> SmoothedPath:
    """Return the smoothed path at those of the instants `at_us` that lie within the estimates."""
    kept = _thinned(estimates.time_us)
    time_us = estimates.time_us[kept]
    asked = np.unique(at_us)
    asked = asked[(asked >= time_us[0]) & (asked <= time_us[-1])]
    steps = np.union1d(time_us, asked)
    rows = np.searchsorted(steps, time_us)
    wanted = np.searchsorted(steps, asked)
    position, std = np.empty((len(asked), 3)), np.empty((len(asked), 3))
    for axis in range(3):
        mean, variance = _smooth_axis(
            steps,
            rows,
            estimates.position_ned[kept, axis],
            estimates.velocity_ned[kept, axis],
            _filled(estimates.position_std_m[:, axis])[kept],
            estimates.velocity_std_mps[kept, axis],
        )
        position[:, axis], std[:, axis] = mean[wanted], np.sqrt(variance[wanted])
        if not np.isfinite(estimates.position_std_m[:, axis]).any():
            std[:, axis] = math.nan
    return SmoothedPath(asked, position, std)


def _thinned(time_us: Array) -> NDArray[np.int64]:
    kept, last = [], -math.inf
    for index, t in enumerate(time_us):
        if t >= last + THINNED_US:
            kept.append(index)
            last = t
    return np.array(kept, np.int64)


def _filled(std: Array) -> Array:
    """Return the accuracies with the gaps filled by the newest known, before the first by the first."""
    known = np.flatnonzero(np.isfinite(std))
    if not len(known):
        return np.full_like(std, UNREPORTED_M)
    return np.asarray(std[known[np.maximum(0, np.searchsorted(known, np.arange(len(std)), "right") - 1)]])


def _smooth_axis(
    steps: Array, rows: NDArray[np.int64], position: Array, velocity: Array, error: Array, velocity_std: Array
) -> tuple[Array, Array]:
    """Return mean and variance of the position at every step; `rows` are the steps that have a report."""
    from filterpy.kalman import KalmanFilter  # scipy.stats comes with it, which takes seconds

    reports = {int(row): index for index, row in enumerate(rows)}
    newest = np.maximum(0, np.searchsorted(rows, np.arange(len(steps)), "right") - 1)
    transitions, noises, measured, weights = [], [], [], []
    for step in range(len(steps)):
        dt = (steps[step] - steps[step - 1]) / 1e6 if step else 0.0
        kept = math.exp(-dt / CORRELATION_S)
        transitions.append(np.array([[1.0, dt, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, kept]]))
        noises.append(_process_noise(dt, error[newest[step]] ** 2 * (1.0 - kept**2)))
        report = reports.get(step)
        measured.append(None if report is None else np.array([position[report], velocity[report]]))
        weights.append(np.diag([POSITION_NOISE_M**2, velocity_std[newest[step]] ** 2]))
    kalman = KalmanFilter(dim_x=3, dim_z=2)
    kalman.x = np.array([position[0], velocity[0], 0.0])
    unsure = error[0] ** 2
    kalman.P = np.array(
        [[unsure + POSITION_NOISE_M**2, 0.0, -unsure], [0.0, velocity_std[0] ** 2, 0.0], [-unsure, 0.0, unsure]]
    )
    means, covariances, _, _ = kalman.batch_filter(
        measured, Fs=transitions, Qs=noises, Hs=[_H] * len(steps), Rs=weights
    )
    means, covariances, _, _ = kalman.rts_smoother(means, covariances, Fs=transitions, Qs=noises)
    return means[:, 0], covariances[:, 0, 0]


def _process_noise(dt: float, wandered: float) -> Array:
    q = ACCELERATION_PSD
    noise = np.array([[q * dt**3 / 3.0, q * dt**2 / 2.0, 0.0], [q * dt**2 / 2.0, q * dt, 0.0], [0.0, 0.0, wandered]])
    return noise + np.eye(3) * 1e-12  # two instants may be the same: the smoother inverts what has been predicted
