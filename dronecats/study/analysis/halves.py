"""Where half of the flights succeed along a factor: for each entrant, cell and choice of the other factors."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dronecats.judge.statistics.half import HalfSuccess, SuccessCurve, half_success, success_curve
from dronecats.judge.statistics.mixed_logit import Trials
from dronecats.study.analysis.studied import Studied, StudiedFlight, StudiedLevel, by_episode, others

FEW = 12  # choices of the other factors, beyond which none is fitted by itself


@dataclass(frozen=True, slots=True)
class HalfAlong:
    """Where half succeed along a factor."""

    factor: int  # its number
    entrant: str
    cell: str
    beside: tuple[StudiedLevel, ...]  # what the other factors are at; empty: there are none, or they are at their base
    half: HalfSuccess
    curve: SuccessCurve | None


def halves(studied: Studied, factor: int) -> list[HalfAlong]:
    """Return the fits along a factor; none along words, or where the others have too many choices to be parted.

    A design of one factor at a time has one such choice, its base, and that is not told beside the fit.
    """
    if not studied.factors[factor].numeric:
        return []
    flown_at: dict[tuple[StudiedLevel, ...], set[StudiedLevel]] = {}
    for each in studied.scored:
        flown_at.setdefault(others(each, factor), set()).add(each.levels[factor])
    beside = [choice for choice, levels in flown_at.items() if len(levels) > 1]
    if len(beside) > FEW:
        return []
    base = () if len(beside) == 1 else None
    found = []
    for entrant, cell in studied.lines():
        for choice in sorted(beside, key=_in_order):
            flown = [each for each in studied.of(entrant, cell) if others(each, factor) == choice]
            levels, told = trials(flown, factor)
            half = half_success(levels, told) if len(levels) > 1 else None
            if half is not None:
                found.append(
                    HalfAlong(
                        factor, entrant, cell, choice if base is None else base, half, success_curve(levels, told)
                    )
                )
    return found


def trials(flights: Sequence[StudiedFlight], factor: int) -> tuple[list[float], Trials]:
    """Return the levels of a factor that were flown, and the outcomes at them, a line an episode."""
    levels = sorted({float(each.levels[factor]) for each in flights})
    column = {level: k for k, level in enumerate(levels)}
    episodes = by_episode(flights)
    won, flown = (np.zeros((len(episodes), len(levels))) for _ in range(2))
    for line, some in enumerate(episodes.values()):
        for each in some:
            at = column[float(each.levels[factor])]
            flown[line, at] += 1.0
            won[line, at] += each.scored.success
    return levels, Trials(won, flown)


def _in_order(levels: tuple[StudiedLevel, ...]) -> list[tuple[float, str]]:
    """Return by what choices are sorted: numbers by size, words behind them by the alphabet."""
    return [(level, "") if isinstance(level, float) else (float("inf"), level) for level in levels]
