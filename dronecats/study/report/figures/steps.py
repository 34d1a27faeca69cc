"""What is told of steps along a factor: the rate that was served, and how far the target moved meanwhile."""

from collections.abc import Sequence
from typing import Any

from dronecats.report.figures import style
from dronecats.study.analysis.steps import QUANTILES, MotionAt, StepQuantiles
from dronecats.study.analysis.studied import ALL
from dronecats.study.report.figures import panels
from dronecats.study.report.findings import FactorFindings, Findings
from dronecats.study.report.words import PERCENT

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
        _spread(metres, at, widths, style.GREY, panels.marker(number), "width of the view at the target", "--")
        moved = [each.moved_m for each in there]
        _spread(metres, at, moved, panels.colour(number), panels.marker(number), f"target moved{suffix}", "-")
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


def _spread(
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
