"""Studies an airframe's control loops: step responses, and predicted and injected delay margins of the feedback."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dronecats.study.loop.hover import LOOPS, SAMPLE_S, CascadeLoop, Hover, StepResponse
from dronecats.study.loop.linear import DelayMargin, delay_margin, designed_margin, hover_point, linear_loops
from foundation.errors import UsageError

Array = NDArray[np.float64]

SAMPLES_A_PERIOD = 10  # samples per period of the expected oscillation
SINGULAR_VALUE_CUTOFF = 1e-6  # × the largest singular value; smaller values are rounding and quantisation noise
MODES = 12  # the matrix pencil has at most this many modes
FREQUENCY_RANGE = (0.3, 3.0)  # × the expected frequency: the range in which the loop's own oscillation is searched


@dataclass(frozen=True, slots=True)
class Oscillation:
    """The strongest oscillation of a signal near an expected frequency."""

    growth: float  # 1/s; below 0: the oscillation decays
    frequency: float  # rad/s
    size: float  # amplitude at the beginning of the signal

    @property
    def damping_ratio(self) -> float:
        """-growth divided by the distance of the pole from the origin; 0 at constant amplitude."""
        return -self.growth / math.hypot(self.growth, self.frequency)


def oscillation(signal: Array, step_s: float, expected: float) -> Oscillation | None:
    """Return the strongest oscillation in a signal, within FREQUENCY_RANGE × `expected` (rad/s); None: there is none.

    `step_s` (s) is the sampling period. The strongest oscillation has the most energy over the signal. This excludes
    weak overtones, which exist because rotors spin up faster than they spin down. Method: matrix pencil.
    """
    stride = max(round(2.0 * math.pi / expected / SAMPLES_A_PERIOD / step_s), 1)
    values, period = signal[::stride], stride * step_s
    columns = len(values) // 3
    hankel = np.lib.stride_tricks.sliding_window_view(values, columns + 1)
    _, sizes, right = np.linalg.svd(hankel, full_matrices=False)
    rank = min(int((sizes > SINGULAR_VALUE_CUTOFF * sizes[0]).sum()), MODES)
    modes = right[:rank].T
    factors = np.linalg.eigvals(np.linalg.lstsq(modes[:-1], modes[1:], rcond=None)[0])
    factors = factors[np.abs(factors) > 1e-6]
    poles = np.log(factors) / period
    powers = factors[None, :] ** np.arange(len(values))[:, None]
    sizes = np.abs(np.linalg.lstsq(powers, values.astype(np.complex128), rcond=None)[0])
    energy = (sizes[None, :] * np.abs(powers)) ** 2
    near = np.flatnonzero((poles.imag > FREQUENCY_RANGE[0] * expected) & (poles.imag < FREQUENCY_RANGE[1] * expected))
    if not near.size:
        return None
    k = int(near[np.argmax(energy.sum(axis=0)[near])])
    return Oscillation(float(poles.real[k]), float(poles.imag[k]), float(sizes[k]))


DELAY_TOLERANCE = 1e-3  # × the delay: the bisection ends at this accuracy
LARGEST_DELAY_RATIO = 8.0  # × the expected margin: the largest delay tried


def injected_margin(oscillates: Callable[[float], Oscillation | None], expected_s: float) -> DelayMargin:
    """Return the delay at which the damping ratio of a loop's oscillation is 0, and the frequency there.

    `oscillates` returns the oscillation after a small step, for a delay (s). `expected_s` is the first delay tried.
    Bisection finds two delays within DELAY_TOLERANCE of each other: the oscillation decays with one and grows with the
    other. The damping ratio is interpolated linearly between them. Raises UsageError if no delay up to
    LARGEST_DELAY_RATIO × `expected_s` makes the oscillation grow.
    """
    stable_s, unstable_s = 0.0, expected_s
    fading, growing = oscillates(stable_s), oscillates(unstable_s)
    while growing is None or growing.growth <= 0.0:
        stable_s, fading, unstable_s = unstable_s, growing, 1.3 * unstable_s
        if unstable_s > LARGEST_DELAY_RATIO * expected_s:
            raise UsageError(f"the loop does not oscillate with {unstable_s:.2g} s of delay")
        growing = oscillates(unstable_s)
    while unstable_s - stable_s > DELAY_TOLERANCE * unstable_s:
        middle_s = 0.5 * (stable_s + unstable_s)
        left = oscillates(middle_s)
        if left is not None and left.growth > 0.0:
            unstable_s, growing = middle_s, left
        else:
            stable_s, fading = middle_s, left
    if fading is None:
        return DelayMargin(unstable_s, growing.frequency)
    share = fading.damping_ratio / (fading.damping_ratio - growing.damping_ratio)
    return DelayMargin(stable_s + share * (unstable_s - stable_s), growing.frequency)


PERIODS = 12.0  # duration of a trial, in periods of the expected oscillation
SETTLING = 0.2  # share of a trial that is discarded at its beginning, with the fast transients
STEP_S = {"rate": 2.0, "attitude": 4.0, "velocity": 10.0}  # s, duration of a step response without delay, by group
BAND = 0.1  # × the step: a response within this distance of the step counts as settled
SHOWN = (0.9, 1.0, 1.1)  # × the injected margin: delays whose responses the figure shows


@dataclass(frozen=True, slots=True)
class StepFigures:
    rise_s: float  # s, time from 10 to 90 % of the step
    overshoot_percent: float  # % of the step
    delay_s: float  # s until the response reaches half of the step
    settled_s: float  # s until the response stays within BAND of the step; nan: it does not


@dataclass(frozen=True, slots=True)
class LoopStudy:
    airframe: str
    loop: CascadeLoop
    step: StepFigures
    designed: DelayMargin  # from the airframe's constants, as in `dronecats tune`
    predicted: DelayMargin  # by python-control, for the loop linearised about the hover
    injected: DelayMargin  # the delay at which the simulated loop oscillates
    responses: dict[float, StepResponse]  # delay (s) → response, for the delays 0 and SHOWN times the injected margin

    @property
    def prediction_error(self) -> float:
        """The relative error of the predicted margin; positive if this margin is larger than the injected one."""
        return self.predicted.delay_s / self.injected.delay_s - 1.0


def step_figures(response: StepResponse) -> StepFigures:
    """Return the figures of a response. If it never reaches 90 %, `rise_s` is nan; if never 50 %, `delay_s` too."""
    share = response.value / response.step

    def first(level: float) -> float:
        above = np.flatnonzero(share >= level)
        return float(response.time[above[0]]) if above.size else math.nan

    outside = np.flatnonzero(np.abs(share - 1.0) > BAND)
    last = int(outside[-1]) + 1 if outside.size else 0
    settled = float(response.time[last]) if last < len(share) else math.nan
    return StepFigures(first(0.9) - first(0.1), max(float(share.max()) - 1.0, 0.0) * 100.0, first(0.5), settled)


def step_oscillation(hover: Hover, loop: CascadeLoop, expected: DelayMargin) -> Callable[[float], Oscillation | None]:
    """Return a function that simulates a small step with a delay (s) in the feedback and returns the oscillation."""
    seconds = PERIODS * 2.0 * math.pi / expected.frequency

    def oscillates(delay_s: float) -> Oscillation | None:
        value = hover.step_response(loop, delay_s, seconds).value
        left = oscillation(value[round(SETTLING * len(value)) :], SAMPLE_S, expected.frequency)
        if left is not None and left.size > loop.step:
            # An oscillation larger than the step counts as growing. With a delay above the margin, the limits of tilt
            # and integrators can stop the growth.
            return replace(left, growth=abs(left.growth))
        return left

    return oscillates


def study_loops(hover: Hover, loops: tuple[CascadeLoop, ...] = LOOPS) -> list[LoopStudy]:
    """Return the study of each loop of a hovering airframe. Raises UsageError if no delay makes a loop oscillate."""
    airframe, gains = hover.airframe, hover.gains
    linear = linear_loops(airframe, gains, hover_point(airframe, hover.plant))
    studies = []
    for loop in loops:
        predicted = delay_margin(linear[loop.name])
        period = 2.0 * math.pi / predicted.frequency
        undelayed = hover.step_response(loop, 0.0, STEP_S[loop.group])
        injected = injected_margin(step_oscillation(hover, loop, predicted), predicted.delay_s)
        delays_s = [share * injected.delay_s for share in SHOWN]
        responses = {
            0.0: undelayed,
            **{delay_s: hover.step_response(loop, delay_s, PERIODS * period) for delay_s in delays_s},
        }
        margins = designed_margin(airframe, gains, loop), predicted, injected
        studies.append(LoopStudy(airframe.name, loop, step_figures(undelayed), *margins, responses))
    return studies
