"""One airframe's loops: what each does with a small step, how late its feedback may come, predicted and injected."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from dronecats.study.loop.cascade_loops import LOOPS, CascadeLoop
from dronecats.study.loop.hover import SAMPLE_S, Hover, StepAnswer
from dronecats.study.loop.injection import injected_margin
from dronecats.study.loop.linear import DelayMargin, delay_margin, designed, hover_point, linearised
from dronecats.study.loop.oscillation import Oscillation, oscillation

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
