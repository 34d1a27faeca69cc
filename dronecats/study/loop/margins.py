"""One airframe's loops: what each does with a small step, how late its feedback may come, predicted and injected."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dronecats.study.loop.cascade_loops import LOOPS, CascadeLoop
from dronecats.study.loop.hover import SAMPLE_S, Hover, StepAnswer
from dronecats.study.loop.linear import DelayMargin, delay_margin, designed, hover_point, linearised
from foundation.errors import UsageError

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


WITHIN = 1e-3  # of the delay: how far apart the last two trials are
LATEST = 8.0  # × the expected margin: later is not tried


def injected_margin(oscillates: Callable[[float], Oscillation | None], expected_s: float) -> DelayMargin:
    """Return the delay at which the damping ratio is 0, between the last trial that fades and the first that grows.

    `oscillates` tells what a small step leaves behind with a delay (s). Between the two, which bisection has brought
    within WITHIN, the damping ratio is taken to run straight. Raises UsageError where the loop fades however late.
    """
    fades, grows = 0.0, expected_s
    calm, wild = oscillates(fades), oscillates(grows)
    while wild is None or wild.growth <= 0.0:
        fades, calm, grows = grows, wild, 1.3 * grows
        if grows > LATEST * expected_s:
            raise UsageError(f"the loop does not oscillate with {grows:.2g} s of delay")
        wild = oscillates(grows)
    while grows - fades > WITHIN * grows:
        middle = 0.5 * (fades + grows)
        found = oscillates(middle)
        if found is not None and found.growth > 0.0:
            grows, wild = middle, found
        else:
            fades, calm = middle, found
    if calm is None:
        return DelayMargin(grows, wild.frequency)
    share = calm.damping_ratio / (calm.damping_ratio - wild.damping_ratio)
    return DelayMargin(fades + share * (grows - fades), wild.frequency)


PERIODS = 12.0  # of the expected oscillation, which a trial lasts
SETTLING = 0.2  # of a trial: what fades faster than the oscillation is over by then
STEP_S = {"rate": 2.0, "attitude": 4.0, "velocity": 10.0}  # without delay: the step has been made by then
BAND = 0.1  # of a step, within which it counts as settled
SHOWN = (0.9, 1.0, 1.1)  # × the injected margin: trials that are kept for the picture


@dataclass(frozen=True, slots=True)
class StepFigures:
    """What the truth does with a step of the loop's setpoint."""

    rise_s: float  # s, from 10 to 90 %
    overshoot_percent: float  # of the step, above it
    delay_s: float  # s until half of the step is there
    settled_s: float  # s until it stays within BAND of the step; nan: not before the answer ends


@dataclass(frozen=True, slots=True)
class LoopStudy:
    """One loop of one airframe."""

    airframe: str
    loop: CascadeLoop
    step: StepFigures
    designed: DelayMargin  # on the airframe's constants, as `dronecats tune` has it
    predicted: DelayMargin  # python-control's, of the loop linearised about the hover
    injected: DelayMargin  # at which the flown loop oscillates
    answers: dict[float, StepAnswer]  # by delay (s): 0 and SHOWN times the injected margin

    @property
    def off(self) -> float:
        """By what share the prediction is above what was flown."""
        return self.predicted.delay_s / self.injected.delay_s - 1.0


def step_figures(answer: StepAnswer) -> StepFigures:
    """Return the figures of a step's answer; nan for what it never reaches."""
    share = answer.value / answer.step

    def first(level: float) -> float:
        above = np.flatnonzero(share >= level)
        return float(answer.time[above[0]]) if above.size else math.nan

    out = np.flatnonzero(np.abs(share - 1.0) > BAND)
    last = int(out[-1]) + 1 if out.size else 0
    settled = float(answer.time[last]) if last < len(share) else math.nan
    return StepFigures(first(0.9) - first(0.1), max(float(share.max()) - 1.0, 0.0) * 100.0, first(0.5), settled)


def left_behind(hover: Hover, loop: CascadeLoop, expected: DelayMargin) -> Callable[[float], Oscillation | None]:
    """Return what tells the oscillation that a small step leaves behind with a delay (s) in the loop's feedback."""
    seconds = PERIODS * 2.0 * math.pi / expected.frequency

    def oscillates(delay_s: float) -> Oscillation | None:
        value = hover.answer(loop, delay_s, seconds).value
        left = oscillation(value[round(SETTLING * len(value)) :], SAMPLE_S, expected.frequency)
        if left is not None and left.size > loop.step:
            # beyond the margin, yet limits (of tilt, of the integrals) bound the oscillation: it no longer grows
            return replace(left, growth=abs(left.growth))
        return left

    return oscillates


def study(hover: Hover, loops: tuple[CascadeLoop, ...] = LOOPS) -> list[LoopStudy]:
    """Return every loop of a hovering airframe. Raises UsageError for a loop that bears any delay."""
    airframe, gains = hover.airframe, hover.gains
    linear = linearised(airframe, gains, hover_point(airframe, hover.plant))
    found = []
    for loop in loops:
        predicted = delay_margin(linear[loop.name])
        period = 2.0 * math.pi / predicted.frequency
        calm = hover.answer(loop, 0.0, STEP_S[loop.group])
        injected = injected_margin(left_behind(hover, loop, predicted), predicted.delay_s)
        answers = {0.0: calm}
        for share in SHOWN:
            answers[share * injected.delay_s] = hover.answer(loop, share * injected.delay_s, PERIODS * period)
        found.append(
            LoopStudy(
                airframe.name, loop, step_figures(calm), designed(airframe, gains, loop), predicted, injected, answers
            )
        )
    return found
