"""Figures of differences with their intervals (forest plots), and heat maps of success over two factors.

A cell is a kind of episode; an entrant is a pilot.
"""

import math
from collections.abc import Sequence
from typing import Any

from dronecats.judge.statistics.shares import ALPHA
from dronecats.report import figures as style
from dronecats.study.analysis.differences import SUCCESS, PairedDifference
from dronecats.study.analysis.study_results import StudiedFactor
from dronecats.study.analysis.success_fits import HeatMap, MainEffect
from dronecats.study.report import panels
from dronecats.study.report.findings import PERCENT, FactorFindings, Findings, cell_title, equals_p, in_cell

DifferenceRows = Sequence[tuple[PairedDifference, str]]  # (difference, label); the label names one entrant, or two


def between_levels(findings: Findings, along: FactorFindings) -> Any | None:
    """Return a figure of success at each level minus success at the reference, a panel per cell; None: no data."""
    reference = along.factor.label(along.factor.reference)
    rows = [(row, row.first) for row in along.between_levels if row.metric == SUCCESS]
    label = f"success minus that at {reference} (points)"
    return _differences(findings, along.factor, rows, findings.results.entrants, label)


def between_entrants(findings: Findings, along: FactorFindings) -> Any | None:
    """Return a figure of the differences between entrants at each level, a panel per cell; None with one entrant."""
    rows = [(row, f"{row.first} minus {row.second}") for row in along.between_entrants if row.metric == SUCCESS]
    labels = list(dict.fromkeys(label for _, label in rows))
    return _differences(findings, along.factor, rows, labels, "difference (points)")


def point_differences(findings: Findings) -> Any | None:
    """Return a figure of the differences between entrants at every point, a panel per cell; None without points.

    A point is a level of every factor.
    """
    rows = [(row, f"{row.first} minus {row.second}") for row in findings.points if row.metric == SUCCESS]
    labels = list(dict.fromkeys(label for _, label in rows))
    height_in = 0.6 + (0.11 + 0.06 * len(labels)) * len({row.at for row, _ in rows})
    axis_label = "difference (points)" if len(labels) > 1 else f"{labels[0]} (points)" if labels else ""
    return _forest(findings, None, rows, labels, axis_label, height_in)


def main_effects(findings: Findings) -> Any | None:
    """Return a figure of the change of the log odds by each factor, a panel per cell; None without main effects."""
    effects = [effect for effect in findings.effects if effect.log_odds is not None]
    if not effects:
        return None
    factors = findings.results.factors
    names = list(dict.fromkeys(_effect_label(factors[effect.factor], effect) for effect in effects))
    cells = [cell for cell in findings.results.groups if any(effect.cell == cell for effect in effects)]
    figure, axes = panels.panels(len(cells), 0.5 + 0.38 * len(names), min(2, len(cells)))
    for axis, cell in zip(axes, cells, strict=True):
        for number, entrant in enumerate(findings.results.entrants):
            for effect in (effect for effect in effects if (effect.entrant, effect.cell) == (entrant, cell)):
                row = names.index(_effect_label(factors[effect.factor], effect))
                y = row + _offset(number, len(findings.results.entrants))
                change = effect.log_odds or 0.0
                ends = [change if end is None else end for end in (effect.low, effect.high)]
                axis.plot(ends, [y, y], color=panels.colour(number), linewidth=1.1)
                _draw_mark(axis, change, y, number, effect.p_holm <= ALPHA, entrant)
        _name_rows(axis, names, cell_title(cell), "change of the log odds of success")
    return panels.finish(figure, axes, findings.command)


def _effect_label(factor: StudiedFactor, effect: MainEffect) -> str:
    return f"{factor.words}\n{factor.label(effect.begin)} → {factor.label(effect.end)}"


def _differences(
    findings: Findings, factor: StudiedFactor, rows: DifferenceRows, labels: Sequence[str], axis_label: str
) -> Any | None:
    steps = {row.at for row, _ in rows}
    height_in = max(1.3, 0.55 + (0.16 + 0.12 * len(labels)) * len(steps))
    return _forest(findings, factor, rows, labels, axis_label, height_in)


def _forest(
    findings: Findings,
    factor: StudiedFactor | None,
    rows: DifferenceRows,
    labels: Sequence[str],
    axis_label: str,
    height_in: float,
) -> Any | None:
    """Return a figure of differences of success with intervals, a panel per cell, a row per level or point."""
    if not rows:
        return None
    steps = list(dict.fromkeys(row.at for row, _ in rows))
    names = [panels.without_unit(step, factor) if factor else step.title for step in steps]
    cells = [cell for cell in findings.results.groups if any(row.cell == cell for row, _ in rows)]
    figure, axes = panels.panels(len(cells), height_in)
    for k, (axis, cell) in enumerate(zip(axes, cells, strict=True)):
        for row, label in rows:
            if row.cell == cell:
                number = labels.index(label)
                _draw_difference(axis, row, steps.index(row.at) + _offset(number, len(labels)), number, label)
        _name_rows(axis, names, cell_title(cell), axis_label)
        if factor and k % panels.COLUMNS_MAX == 0:
            axis.set_ylabel(factor.title)
    return panels.finish(figure, axes, findings.command)


def _name_rows(axis: Any, names: Sequence[str], title: str, label: str) -> None:
    """Set a panel's row labels (from top to bottom), title and axis label, and draw the line of no difference."""
    axis.axvline(0.0, color=style.GREY, linewidth=0.7, zorder=0)
    axis.set_yticks(range(len(names)), names)
    axis.set_ylim(len(names) - 0.5, -0.5)
    axis.set_title(title)
    axis.set_xlabel(label)


def _draw_difference(axis: Any, row: PairedDifference, y: float, number: int, label: str) -> None:
    low, high = row.difference.low, row.difference.high
    if low is not None and high is not None:
        axis.plot([PERCENT * low, PERCENT * high], [y, y], color=panels.colour(number), linewidth=1.1)
    _draw_mark(axis, PERCENT * row.difference.mean, y, number, row.p_holm <= ALPHA, label)


def _offset(number: int, count: int) -> float:
    return 0.22 * (number - (count - 1) / 2) * min(1.0, 3.0 / count)


def _draw_mark(axis: Any, x: float, y: float, number: int, is_significant: bool, label: str) -> None:
    fill = panels.colour(number) if is_significant else "white"
    axis.plot([x], [y], panels.marker(number), color=panels.colour(number), markerfacecolor=fill, markersize=4.2,
              markeredgewidth=1.0, linestyle="", zorder=3)  # fmt: skip
    axis.plot([], [], panels.marker(number), color=panels.colour(number), markersize=4.2, linestyle="", label=label)


HEAT_COLOURS = "cividis"  # perceptually uniform, readable with colour blindness
DARK = 55.0  # %; a field with a lower success rate is dark and has white text


def heat_maps(findings: Findings, maps: Sequence[HeatMap]) -> Any:
    """Return the heat maps of one pair of factors, a panel per entrant and cell."""
    down, across = findings.results.factors[maps[0].rows], findings.results.factors[maps[0].columns]
    rows, columns = len(maps[0].row_steps), len(maps[0].column_steps)
    has_several = len(findings.results.entrants) > 1
    figure, axes = panels.panels(len(maps), 0.75 + 0.3 * rows, 2 if columns > 5 else panels.COLUMNS_MAX)
    for axis, heat_map in zip(axes, maps, strict=True):
        shares = [[PERCENT * estimate.share for estimate in line] for line in heat_map.shares]
        image = axis.imshow(shares, cmap=HEAT_COLOURS, vmin=0.0, vmax=100.0, aspect="auto")
        for y, line in enumerate(shares):
            for x, share in enumerate(line):
                if not math.isnan(share):
                    axis.text(x, y, f"{share:.0f}", ha="center", va="center", fontsize=7,
                              color="white" if share < DARK else "black")  # fmt: skip
        axis.set_xticks(range(columns), [panels.without_unit(step, across) for step in heat_map.column_steps])
        axis.set_yticks(range(rows), [panels.without_unit(step, down) for step in heat_map.row_steps])
        axis.tick_params(length=0)
        for spine in axis.spines.values():
            spine.set_visible(False)
        subject = in_cell(heat_map.entrant, heat_map.cell) if has_several else cell_title(heat_map.cell)
        axis.set_title(subject + ("" if heat_map.p is None else f"\ninteraction p {equals_p(heat_map.p)}"))
        axis.set_xlabel(across.title)
        axis.set_ylabel(down.title)
    bar = figure.colorbar(image, ax=axes, shrink=0.9, pad=0.02)
    bar.set_label("success rate (%)")
    bar.outline.set_linewidth(0.0)
    bar.ax.tick_params(color=style.GREY)
    return panels.finish(figure, axes, findings.command)
