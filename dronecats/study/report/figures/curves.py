"""Figures along a factor: success and the other measures, the served rate, and the motion of targets."""

import math
from collections.abc import Sequence
from typing import Any

from dronecats.report.figures import style
from dronecats.study.analysis.halves import HalfAlong
from dronecats.study.analysis.levels import MEASURES, AtLevel, level_steps, successes
from dronecats.study.analysis.steps import QUANTILES, MotionAt, StepQuantiles
from dronecats.study.analysis.studied import ALL, others
from dronecats.study.report import words
from dronecats.study.report.figures import panels
from dronecats.study.report.findings import FactorFindings, Findings
from dronecats.study.report.words import PERCENT, cell_title


def success(found: Findings, along: FactorFindings) -> Any:
    """Return the share of successes at each level with intervals, the fitted curves, and where half succeed."""
    groups = found.studied.groups
    made, axes = panels.panels(len(groups), 2.15)
    for k, (axis, cell) in enumerate(zip(axes, groups, strict=True)):
        axis.axhline(50.0, color=style.LIGHT, linewidth=0.8, zorder=0)
        for number, entrant in enumerate(found.studied.entrants):
            there = [each for each in along.levels if (each.entrant, each.cell) == (entrant, cell)]
            fits = [each for each in along.halves if (each.entrant, each.cell) == (entrant, cell)]
            if not there:
                continue
            if len(fits) == 1:
                _fitted(axis, along, fits[0], number)
            _points(axis, there, number, len(found.studied.entrants), entrant, joined=not fits)
        panels.ticked(axis, along.factor, level_steps(along.factor))
        axis.set_title(cell_title(cell))
        axis.set_ylim(-4, 104)
        if k % panels.ACROSS == 0:
            axis.set_ylabel("success rate (%)")
    return panels.finished(made, axes, found.command)


def beside(found: Findings, along: FactorFindings) -> Any | None:
    """Return the curves along a factor for each choice of the others, a panel an entrant; None without, or of many."""
    cell = found.studied.groups[0]
    fits = [each for each in along.halves if each.cell == cell and each.beside]
    choices = list(dict.fromkeys(each.beside for each in fits))
    if not 1 < len(choices) <= len(panels.COLOURS):
        return None
    made, axes = panels.panels(len(found.studied.entrants), 2.3)
    steps = level_steps(along.factor)
    for k, (axis, entrant) in enumerate(zip(axes, found.studied.entrants, strict=True)):
        axis.axhline(50.0, color=style.LIGHT, linewidth=0.8, zorder=0)
        for each in (each for each in fits if each.entrant == entrant):
            number = choices.index(each.beside)
            _fitted(axis, along, each, number, alone=False)
            flown = [f for f in found.studied.of(entrant, cell) if others(f, along.number) == each.beside]
            won = [successes([f for f in flown if f.levels[along.number] in step.members]) for step in steps]
            there = [AtLevel(entrant, cell, step, share, (), 0) for step, share in zip(steps, won, strict=True)]
            _points(axis, there, number, len(choices), words.beside(found.studied, each), joined=False)
        panels.ticked(axis, along.factor, steps)
        axis.set_title(entrant)
        axis.set_ylim(-4, 104)
        if k % panels.ACROSS == 0:
            axis.set_ylabel("success rate (%)")
    return panels.finished(made, axes, found.command)


def measures(found: Findings, along: FactorFindings) -> Any:
    """Return NE, dwell and the longest loss along a factor: a row a cell, a column a measure."""
    groups = found.studied.groups
    made, axes = panels.panels(len(groups) * len(MEASURES), 1.55, len(MEASURES), share_y=False)
    for place, axis in enumerate(axes):
        cell, measure = groups[place // len(MEASURES)], MEASURES[place % len(MEASURES)]
        for number, entrant in enumerate(found.studied.entrants):
            there = [each for each in along.levels if (each.entrant, each.cell) == (entrant, cell)]
            told = [(each.step, each.measures[place % len(MEASURES)]) for each in there]
            known = [(step, mean) for step, mean in told if mean.episodes]
            if not known:
                continue
            at = panels.shifted(panels.along([step for step, _ in known]), number, len(found.studied.entrants))
            middle = [mean.mean for _, mean in known]
            low = [mean.mean if mean.low is None else mean.low for _, mean in known]
            high = [mean.mean if mean.high is None else mean.high for _, mean in known]
            reach = [[m - lo for m, lo in zip(middle, low, strict=True)],
                     [hi - m for m, hi in zip(middle, high, strict=True)]]  # fmt: skip
            axis.errorbar(at, middle, yerr=reach, color=panels.colour(number), marker=panels.marker(number),
                          markersize=3.5, linewidth=1.0, elinewidth=0.8, label=entrant)  # fmt: skip
        panels.ticked(axis, along.factor, level_steps(along.factor))
        axis.set_ylim(bottom=0.0)
        axis.set_ylabel(f"{measure.title} ({measure.unit})")
        axis.set_title(cell_title(cell))
    return panels.finished(made, axes, found.command)


def _points(axis: Any, there: list[AtLevel], number: int, count: int, entrant: str, *, joined: bool) -> None:
    known = [each for each in there if each.success.trials]
    at = panels.shifted(panels.along([each.step for each in known]), number, count) if known else []
    shares = [PERCENT * each.success.share for each in known]
    reach = [[PERCENT * (each.success.share - each.success.low) for each in known],
             [PERCENT * (each.success.high - each.success.share) for each in known]]  # fmt: skip
    axis.errorbar(at, shares, yerr=reach, fmt=panels.marker(number), linestyle="-" if joined else "", markersize=3.8,
                  linewidth=1.0, elinewidth=0.8, color=panels.colour(number), label=entrant, zorder=3)  # fmt: skip


def _fitted(axis: Any, along: FactorFindings, told: HalfAlong, number: int, *, alone: bool = True) -> None:
    """Draw the curve and, on the line of a half, the place; where it is alone, with its band and the interval."""
    if told.curve is not None:
        axis.plot(told.curve.at, PERCENT * told.curve.share, color=panels.colour(number), linewidth=1.3)
        if alone:
            axis.fill_between(told.curve.at, PERCENT * told.curve.low, PERCENT * told.curve.high,
                              color=panels.colour(number), alpha=0.15, linewidth=0)  # fmt: skip
    half, levels = told.half, [float(level) for level in along.factor.levels]
    if half.where not in ("within", "between"):
        return
    low, high = max(half.low, min(levels)), min(half.high, max(levels))
    if alone or half.value is None:
        axis.plot([low, high], [50.0, 50.0], color=panels.colour(number), linewidth=3.0, alpha=0.55,
                  solid_capstyle="butt", zorder=2)  # fmt: skip
    if half.value is not None and math.isfinite(half.value):
        axis.plot([half.value], [50.0], "|", color=panels.colour(number), markersize=9, markeredgewidth=1.6, zorder=4)


LEAST, MIDDLE, MOST = QUANTILES.index(0.05), QUANTILES.index(0.5), QUANTILES.index(0.95)


def served(found: Findings, along: FactorFindings) -> Any | None:
    """Return a box a level and entrant: 5 to 95 %, 25 to 75 % and the median of the control rate."""
    if not along.served:
        return None
    steps = list(dict.fromkeys(each.step for each in along.served))
    entrants = list(dict.fromkeys(each.entrant for each in along.served))
    made, (axis,) = panels.panels(1, max(1.2, 0.34 + 0.2 * len(steps) * len(entrants)))
    for each in along.served:
        number = entrants.index(each.entrant)
        y = steps.index(each.step) + 0.8 * ((number + 0.5) / len(entrants) - 0.5)
        low, begin, middle, end, high = each.rate_hz.at
        tall = 0.56 / len(entrants)
        axis.plot([low, high], [y, y], color=panels.colour(number), linewidth=1.0)
        axis.barh(y, end - begin, left=begin, height=tall, color=panels.colour(number), alpha=0.45, label=each.entrant)
        axis.plot([middle, middle], [y - tall / 2, y + tall / 2], color=panels.colour(number), linewidth=2.4, zorder=4)
    axis.set_yticks(range(len(steps)), [panels.plain(step, along.factor) for step in steps])
    axis.set_ylim(len(steps) - 0.5, -0.5)
    axis.set_xlim(0.0, 1.04 * max(each.rate_hz.at[MOST] for each in along.served))
    axis.set_ylabel(along.factor.title)
    axis.set_xlabel("decisions per second of vehicle time: 5, 25, 50, 75 and 95 % of the steps")
    return panels.finished(made, [axis], found.command)


def motion(found: Findings, along: FactorFindings) -> Any | None:
    """Return the metres that a target moves in one decision beside the width of the view, and their ratio.

    Over all cells; None where no target moves.
    """
    cell = ALL if ALL in found.studied.groups else (found.studied.groups or ("",))[0]
    told = [each for each in along.motions if each.cell == cell and each.moved_m.at and each.width_m.at]
    if not told:
        return None
    made, (metres, share) = panels.panels(2, 2.3, 2, share_y=False)
    entrants = [name for name in found.studied.entrants if any(each.entrant == name for each in told)]
    for number, entrant in enumerate(entrants):
        there = [each for each in told if each.entrant == entrant]
        at = panels.shifted(panels.along([each.step for each in there]), number, len(entrants))
        suffix = f", {entrant}" if len(entrants) > 1 else ""
        widths = [each.width_m for each in there]
        _spread_of_steps(metres, at, widths, style.GREY, panels.marker(number), "width of the view at the target", "--")
        moved = [each.moved_m for each in there]
        _spread_of_steps(metres, at, moved, panels.colour(number), panels.marker(number), f"target moved{suffix}", "-")
        _ratio(share, at, there, number)
    for axis in (metres, share):
        panels.ticked(axis, along.factor, list(dict.fromkeys(each.step for each in told)))
    _decades(metres)
    metres.set_ylabel("m, at the target")
    share.set_ylim(bottom=0.0)
    share.set_ylabel("moved in one decision\n(% of the view's width)")
    return panels.finished(made, (metres, share), found.command)


def _decades(axis: Any) -> None:
    """Scale an axis by ratios, its numbers plain."""
    from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

    axis.set_yscale("log")
    axis.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.yaxis.set_minor_formatter(NullFormatter())


def _spread_of_steps(
    axis: Any, at: Sequence[float], told: Sequence[StepQuantiles], colour: str, marker: str, label: str, line: str
) -> None:
    """Draw medians with what 90 % of the steps lie between."""
    middle = [each.at[MIDDLE] for each in told]
    reach = [[each.at[MIDDLE] - each.at[LEAST] for each in told], [each.at[MOST] - each.at[MIDDLE] for each in told]]
    axis.errorbar(at, middle, yerr=reach, color=colour, marker=marker, linestyle=line, markersize=3.5, linewidth=1.0,
                  elinewidth=0.8, label=label)  # fmt: skip


def _ratio(axis: Any, at: Sequence[float], there: Sequence[MotionAt], number: int) -> None:
    known = [(x, each.share.at) for x, each in zip(at, there, strict=True) if each.share.at]
    middle = [PERCENT * told[MIDDLE] for _, told in known]
    reach = [[PERCENT * (told[MIDDLE] - told[LEAST]) for _, told in known],
             [PERCENT * (told[MOST] - told[MIDDLE]) for _, told in known]]  # fmt: skip
    axis.errorbar([x for x, _ in known], middle, yerr=reach, color=panels.colour(number), markersize=3.5,
                  marker=panels.marker(number), linewidth=1.0, elinewidth=0.8)  # fmt: skip
