"""Figures of differences, a line each with its interval, and of success over two factors."""

import math
from collections.abc import Sequence
from typing import Any

from dronecats.judge.statistics.paired import ALPHA
from dronecats.report.figures import style
from dronecats.study.analysis.effects import HeatMap, MainEffect
from dronecats.study.analysis.paired_flights import SUCCESS, PairedDifference
from dronecats.study.analysis.studied import StudiedFactor
from dronecats.study.report.figures import panels
from dronecats.study.report.findings import FactorFindings, Findings
from dronecats.study.report.words import PERCENT, cell_title, probability


def between_levels(found: Findings, along: FactorFindings) -> Any | None:
    """Return each level's success less the reference's, a panel a cell; None without a pair."""
    reference = along.factor.told(along.factor.reference)
    lines = {entrant: entrant for entrant in found.studied.entrants}
    told = [(each, lines[each.first]) for each in along.between_levels if each.metric == SUCCESS]
    return _differences(found, along, told, list(lines), f"success less that at {reference} (points)")


def between_entrants(found: Findings, along: FactorFindings) -> Any | None:
    """Return one entrant's success less another's at each level, a panel a cell; None where there are no two."""
    told = [(e, f"{e.first} less {e.second}") for e in along.between_entrants if e.metric == SUCCESS]
    return _differences(found, along, told, list(dict.fromkeys(name for _, name in told)), "difference (points)")


def at_points(found: Findings) -> Any | None:
    """Return one entrant's success less another's at every point, a panel a cell; None without any."""
    if not found.points:
        return None
    lines = list(dict.fromkeys(f"{each.first} less {each.second}" for each in found.points))
    names = list(dict.fromkeys(each.title for each in found.points))
    cells = [cell for cell in found.studied.groups if any(each.cell == cell for each in found.points)]
    made, axes = panels.panels(len(cells), 0.6 + (0.11 + 0.06 * len(lines)) * len(names))
    for axis, cell in zip(axes, cells, strict=True):
        axis.axvline(0.0, color=style.GREY, linewidth=0.7, zorder=0)
        for each in (each for each in found.points if each.cell == cell):
            line = f"{each.first} less {each.second}"
            number = lines.index(line)
            _line(axis, each.success, names.index(each.title) + _aside(number, len(lines)), number, line)
        axis.set_yticks(range(len(names)), names)
        axis.set_ylim(len(names) - 0.5, -0.5)
        axis.set_title(cell_title(cell))
        axis.set_xlabel("difference (points)" if len(lines) > 1 else f"{lines[0]} (points)")
    return panels.finished(made, axes, found.command)


def effects(found: Findings) -> Any | None:
    """Return how each factor changes the log odds, a panel a cell; None of a study of one factor."""
    told = [each for each in found.effects if each.log_odds is not None]
    if not told:
        return None
    factors = found.studied.factors
    names = list(dict.fromkeys(_name(factors[each.factor], each) for each in told))
    cells = [cell for cell in found.studied.groups if any(each.cell == cell for each in told)]
    made, axes = panels.panels(len(cells), 0.5 + 0.38 * len(names), min(2, len(cells)))
    for axis, cell in zip(axes, cells, strict=True):
        axis.axvline(0.0, color=style.GREY, linewidth=0.7, zorder=0)
        for number, entrant in enumerate(found.studied.entrants):
            for each in (each for each in told if (each.entrant, each.cell) == (entrant, cell)):
                y = names.index(_name(factors[each.factor], each)) + _aside(number, len(found.studied.entrants))
                change = each.log_odds or 0.0
                ends = [change if end is None else end for end in (each.low, each.high)]
                axis.plot(ends, [y, y], color=panels.colour(number), linewidth=1.1)
                _dot(axis, change, y, number, each.p_holm <= ALPHA, entrant)
        axis.set_yticks(range(len(names)), names)
        axis.set_ylim(len(names) - 0.5, -0.5)
        axis.set_title(cell_title(cell))
        axis.set_xlabel("change of the log odds of success")
    return panels.finished(made, axes, found.command)


def _name(factor: StudiedFactor, told: MainEffect) -> str:
    return f"{factor.name.replace('_', ' ')}\n{factor.told(told.begin)} → {factor.told(told.end)}"


def _differences(
    found: Findings,
    along: FactorFindings,
    told: Sequence[tuple[PairedDifference, str]],
    lines: Sequence[str],
    label: str,
) -> Any | None:
    if not told:
        return None
    steps = list(dict.fromkeys(each.at for each, _ in told))
    cells = [cell for cell in found.studied.groups if any(each.cell == cell for each, _ in told)]
    height = 0.55 + (0.16 + 0.12 * len(lines)) * len(steps)
    made, axes = panels.panels(len(cells), max(1.3, height))
    for k, (axis, cell) in enumerate(zip(axes, cells, strict=True)):
        axis.axvline(0.0, color=style.GREY, linewidth=0.7, zorder=0)
        for each, line in (pair for pair in told if pair[0].cell == cell):
            number = lines.index(line)
            y = steps.index(each.at) + _aside(number, len(lines))
            _line(axis, each, y, number, line)
        axis.set_yticks(range(len(steps)), [panels.plain(step, along.factor) for step in steps])
        axis.set_ylim(len(steps) - 0.5, -0.5)
        axis.set_title(cell_title(cell))
        axis.set_xlabel(label)
        if k % panels.ACROSS == 0:
            axis.set_ylabel(along.factor.title)
    return panels.finished(made, axes, found.command)


def _line(axis: Any, each: PairedDifference, y: float, number: int, label: str) -> None:
    """Draw a difference of success with its interval at a height."""
    low, high = each.difference.low, each.difference.high
    if low is not None and high is not None:
        axis.plot([PERCENT * low, PERCENT * high], [y, y], color=panels.colour(number), linewidth=1.1)
    _dot(axis, PERCENT * each.difference.mean, y, number, each.p_holm <= ALPHA, label)


def _aside(number: int, count: int) -> float:
    return 0.22 * (number - (count - 1) / 2) * min(1.0, 3.0 / count)


def _dot(axis: Any, x: float, y: float, number: int, told_apart: bool, label: str) -> None:
    """Draw a mark: filled where the test tells the two apart."""
    inner = panels.colour(number) if told_apart else "white"
    axis.plot([x], [y], panels.marker(number), color=panels.colour(number), markerfacecolor=inner, markersize=4.2,
              markeredgewidth=1.0, linestyle="", zorder=3)  # fmt: skip
    axis.plot([], [], panels.marker(number), color=panels.colour(number), markersize=4.2, linestyle="", label=label)


HEAT_COLOURS = "cividis"  # even in lightness, and the same to eyes that see no red
DARK = 55.0  # %, below which a field is dark


def heat(found: Findings, maps: Sequence[HeatMap]) -> Any:
    """Return the maps of one pair of factors, a panel an entrant and cell."""
    down, across = (found.studied.factors[number] for number in (maps[0].rows, maps[0].columns))
    rows, columns = len(maps[0].row_steps), len(maps[0].column_steps)
    several = len(found.studied.entrants) > 1
    made, axes = panels.panels(len(maps), 0.75 + 0.3 * rows, 2 if columns > 5 else panels.ACROSS)
    for axis, each in zip(axes, maps, strict=True):
        shares = [[PERCENT * known.share for known in line] for line in each.shares]
        image = axis.imshow(shares, cmap=HEAT_COLOURS, vmin=0.0, vmax=100.0, aspect="auto")
        for y, line in enumerate(shares):
            for x, share in enumerate(line):
                if not math.isnan(share):
                    axis.text(x, y, f"{share:.0f}", ha="center", va="center", fontsize=7,
                              color="white" if share < DARK else "black")  # fmt: skip
        axis.set_xticks(range(columns), [panels.plain(step, across) for step in each.column_steps])
        axis.set_yticks(range(rows), [panels.plain(step, down) for step in each.row_steps])
        axis.tick_params(length=0)
        for spine in axis.spines.values():
            spine.set_visible(False)
        who = f"{each.entrant}, {cell_title(each.cell).lower()}" if several else cell_title(each.cell)
        axis.set_title(who + ("" if each.p is None else f"\ninteraction p {_equals(each.p)}"))
        axis.set_xlabel(across.title)
        axis.set_ylabel(down.title)
    bar = made.colorbar(image, ax=axes, shrink=0.9, pad=0.02)
    bar.set_label("success rate (%)")
    bar.outline.set_linewidth(0.0)
    bar.ax.tick_params(color=style.GREY)
    return panels.finished(made, axes, found.command)


def _equals(p: float) -> str:
    told = probability(p)
    return told if told.startswith("<") else f"= {told}"
