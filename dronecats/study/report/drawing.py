"""Draws the figures of a study's report, and writes them as SVG, PDF and PNG in the order of the report's sections.

Curves show results over a factor's levels, and forest plots show differences with their intervals. A cell is a kind of
episode; an entrant is a pilot.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dronecats.judge.statistics.shares import ALPHA
from dronecats.report import figures as style
from dronecats.study.analysis.differences import SUCCESS, PairedDifference
from dronecats.study.analysis.study_results import (
    ALL,
    MEASURES,
    LevelResult,
    StudiedFactor,
    level_steps,
    levels_besides,
    successes,
)
from dronecats.study.analysis.success_fits import HalfSuccessFit, HeatMap, MainEffect
from dronecats.study.report import panels
from dronecats.study.report.findings import (
    PERCENT,
    FactorFindings,
    Findings,
    cell_title,
    equals_p,
    in_cell,
    other_levels,
)


def success_figure(findings: Findings, along: FactorFindings) -> Any:
    """Return a figure of success at each level, the fits, and the levels at which half of the flights succeed."""
    groups = findings.results.groups
    figure, axes = panels.panels(len(groups), 2.15)
    for k, (axis, cell) in enumerate(zip(axes, groups, strict=True)):
        for number, entrant in enumerate(findings.results.entrants):
            levels = [level for level in along.levels if (level.entrant, level.cell) == (entrant, cell)]
            fits = [fit for fit in along.halves if (fit.entrant, fit.cell) == (entrant, cell)]
            if levels and len(fits) == 1:
                _draw_fit(axis, along, fits[0], number)
            if levels:
                _draw_levels(axis, levels, number, len(findings.results.entrants), entrant, joined=not fits)
        _finish_success_axis(axis, along, k, cell_title(cell))
    return panels.finish(figure, axes, findings.command)


def success_by_choice_figure(findings: Findings, along: FactorFindings) -> Any | None:
    """Return a figure of success along a factor, with a curve per combination of the other factors' levels.

    None if there is one combination, or more combinations than colours.
    """
    cell = findings.results.groups[0]
    fits = [fit for fit in along.halves if fit.cell == cell and fit.beside]
    choices = list(dict.fromkeys(fit.beside for fit in fits))
    if not 1 < len(choices) <= len(panels.COLOURS):
        return None
    figure, axes = panels.panels(len(findings.results.entrants), 2.3)
    steps = level_steps(along.factor)
    for k, (axis, entrant) in enumerate(zip(axes, findings.results.entrants, strict=True)):
        for fit in (fit for fit in fits if fit.entrant == entrant):
            number = choices.index(fit.beside)
            _draw_fit(axis, along, fit, number, alone=False)
            flights = [f for f in findings.results.of(entrant, cell) if levels_besides(f, along.number) == fit.beside]
            shares = [successes([f for f in flights if f.levels[along.number] in step.members]) for step in steps]
            levels = [LevelResult(entrant, cell, step, share, (), 0) for step, share in zip(steps, shares, strict=True)]
            _draw_levels(axis, levels, number, len(choices), other_levels(findings.results, fit), joined=False)
        _finish_success_axis(axis, along, k, entrant)
    return panels.finish(figure, axes, findings.command)


def _finish_success_axis(axis: Any, along: FactorFindings, k: int, title: str) -> None:
    axis.axhline(50.0, color=style.LIGHT, linewidth=0.8, zorder=0)
    panels.name_levels(axis, along.factor, level_steps(along.factor))
    axis.set_title(title)
    axis.set_ylim(-4, 104)
    if k % panels.COLUMNS_MAX == 0:
        axis.set_ylabel("success rate (%)")


def measures_figure(findings: Findings, along: FactorFindings) -> Any:
    """Return a figure of the measures along a factor: a row per cell (kind of episode), a column per measure."""
    groups = findings.results.groups
    figure, axes = panels.panels(len(groups) * len(MEASURES), 1.55, len(MEASURES), share_y=False)
    for place, axis in enumerate(axes):
        cell, measure = groups[place // len(MEASURES)], MEASURES[place % len(MEASURES)]
        for number, entrant in enumerate(findings.results.entrants):
            levels = [
                level
                for level in along.levels
                if (level.entrant, level.cell) == (entrant, cell) and level.measures[place % len(MEASURES)].episodes
            ]
            if levels:
                places = panels.places_of([level.step for level in levels])
                means = [level.measures[place % len(MEASURES)] for level in levels]
                spans = [
                    (m.mean if m.low is None else m.low, m.mean, m.mean if m.high is None else m.high) for m in means
                ]
                shifted = panels.shifted(places, number, len(findings.results.entrants))
                panels.draw_spans(axis, shifted, spans, number, label=entrant)
        panels.name_levels(axis, along.factor, level_steps(along.factor))
        axis.set_ylim(bottom=0.0)
        axis.set_ylabel(f"{measure.title} ({measure.unit})")
        axis.set_title(cell_title(cell))
    return panels.finish(figure, axes, findings.command)


def _draw_levels(axis: Any, levels: list[LevelResult], number: int, count: int, label: str, *, joined: bool) -> None:
    levels = [level for level in levels if level.success.trials]
    places = panels.shifted(panels.places_of([level.step for level in levels]), number, count)
    shares = [level.success for level in levels]
    spans = [(PERCENT * share.low, PERCENT * share.share, PERCENT * share.high) for share in shares]
    line = "-" if joined else ""
    panels.draw_spans(axis, places, spans, number, linestyle=line, markersize=3.8, label=label, zorder=3)


def _draw_fit(axis: Any, along: FactorFindings, fit: HalfSuccessFit, number: int, *, alone: bool = True) -> None:
    """Draw a fitted curve and its half-success level; if `alone`, also the curve's band and the level's interval.

    Without a best estimate of the level, its interval is always drawn.
    """
    if fit.curve is not None:
        axis.plot(fit.curve.at, PERCENT * fit.curve.share, color=panels.colour(number), linewidth=1.3)
        if alone:
            axis.fill_between(fit.curve.at, PERCENT * fit.curve.low, PERCENT * fit.curve.high,
                              color=panels.colour(number), alpha=0.15, linewidth=0)  # fmt: skip
    half, levels = fit.half, [float(level) for level in along.factor.levels]
    if half.where not in ("within", "between"):
        return
    least, most = min(levels), max(levels)
    spans = [(half.low, half.high)] if half.low <= half.high else [(least, half.high), (half.low, most)]
    for low, high in spans if alone or half.value is None else ():
        if low <= most and high >= least:
            axis.plot([max(low, least), min(high, most)], [50.0, 50.0], color=panels.colour(number), linewidth=3.0,
                      alpha=0.55, solid_capstyle="butt", zorder=2)  # fmt: skip
    if half.value is not None and math.isfinite(half.value):
        axis.plot([half.value], [50.0], "|", color=panels.colour(number), markersize=9, markeredgewidth=1.6, zorder=4)


def served_figure(findings: Findings, along: FactorFindings) -> Any | None:
    """Return a box plot of the control rate per level and entrant (5, 25, 50, 75 and 95 %); None without data."""
    if not along.served:
        return None
    steps = list(dict.fromkeys(rate.step for rate in along.served))
    entrants = list(dict.fromkeys(rate.entrant for rate in along.served))
    figure, (axis,) = panels.panels(1, max(1.2, 0.34 + 0.2 * len(steps) * len(entrants)))
    for rate in along.served:
        number = entrants.index(rate.entrant)
        y = steps.index(rate.step) + 0.8 * ((number + 0.5) / len(entrants) - 0.5)
        low, begin, middle, end, high = rate.rate_hz.at
        tall = 0.56 / len(entrants)
        axis.plot([low, high], [y, y], color=panels.colour(number), linewidth=1.0)
        axis.barh(y, end - begin, left=begin, height=tall, color=panels.colour(number), alpha=0.45, label=rate.entrant)
        axis.plot([middle, middle], [y - tall / 2, y + tall / 2], color=panels.colour(number), linewidth=2.4, zorder=4)
    axis.set_yticks(range(len(steps)), [panels.without_unit(step, along.factor) for step in steps])
    axis.set_ylim(len(steps) - 0.5, -0.5)
    axis.set_xlim(0.0, 1.04 * max(rate.rate_hz.at[-1] for rate in along.served))
    axis.set_ylabel(along.factor.title)
    axis.set_xlabel("decisions per second of vehicle time: 5, 25, 50, 75 and 95 % of the steps")
    return panels.finish(figure, [axis], findings.command)


def target_motion_figure(findings: Findings, along: FactorFindings) -> Any | None:
    """Return a figure of the distance that a target moves in one decision, the width of the view, and their ratio.

    The data are pooled over all cells. None if no target moves.
    """
    cell = ALL if ALL in findings.results.groups else (findings.results.groups or ("",))[0]
    motions = [at for at in along.motions if at.cell == cell and at.moved_m.at and at.width_m.at]
    if not motions:
        return None
    figure, (metres, share) = panels.panels(2, 2.3, 2, share_y=False)
    entrants = [name for name in findings.results.entrants if any(at.entrant == name for at in motions)]
    for number, entrant in enumerate(entrants):
        rows = [at for at in motions if at.entrant == entrant]
        places = panels.shifted(panels.places_of([at.step for at in rows]), number, len(entrants))
        suffix = f", {entrant}" if len(entrants) > 1 else ""
        widths, moved = [at.width_m.span() for at in rows], [at.moved_m.span() for at in rows]
        panels.draw_spans(metres, places, widths, number, label="width of the view at the target", linestyle="--",
                          color=style.GREY)  # fmt: skip
        panels.draw_spans(metres, places, moved, number, label=f"target moved{suffix}")
        ratios = [(x, at.share.span(PERCENT)) for x, at in zip(places, rows, strict=True) if at.share.at]
        panels.draw_spans(share, [x for x, _ in ratios], [span for _, span in ratios], number)
    for axis in (metres, share):
        panels.name_levels(axis, along.factor, list(dict.fromkeys(at.step for at in motions)))
    _scale_log(metres)
    metres.set_ylabel("m, at the target")
    share.set_ylim(bottom=0.0)
    share.set_ylabel("moved in one decision\n(% of the view's width)")
    return panels.finish(figure, (metres, share), findings.command)


def _scale_log(axis: Any) -> None:
    """Set a logarithmic y axis with plain numbers."""
    from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

    axis.set_yscale("log")
    axis.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.yaxis.set_minor_formatter(NullFormatter())


DifferenceRows = Sequence[tuple[PairedDifference, str]]  # (difference, label); the label names one entrant, or two


def levels_figure(findings: Findings, along: FactorFindings) -> Any | None:
    """Return a figure of success at each level minus success at the reference, a panel per cell; None: no data."""
    reference = along.factor.label(along.factor.reference)
    rows = [(row, row.first) for row in along.between_levels if row.metric == SUCCESS]
    label = f"success minus that at {reference} (points)"
    return _differences(findings, along.factor, rows, findings.results.entrants, label)


def entrants_figure(findings: Findings, along: FactorFindings) -> Any | None:
    """Return a figure of the differences between entrants at each level, a panel per cell; None with one entrant."""
    rows = [(row, f"{row.first} minus {row.second}") for row in along.between_entrants if row.metric == SUCCESS]
    labels = list(dict.fromkeys(label for _, label in rows))
    return _differences(findings, along.factor, rows, labels, "difference (points)")


def points_figure(findings: Findings) -> Any | None:
    """Return a figure of the differences between entrants at every point, a panel per cell; None without points.

    A point is a level of every factor.
    """
    rows = [(row, f"{row.first} minus {row.second}") for row in findings.points if row.metric == SUCCESS]
    labels = list(dict.fromkeys(label for _, label in rows))
    height_in = 0.6 + (0.11 + 0.06 * len(labels)) * len({row.at for row, _ in rows})
    axis_label = "difference (points)" if len(labels) > 1 else f"{labels[0]} (points)" if labels else ""
    return _forest(findings, None, rows, labels, axis_label, height_in)


def effects_figure(findings: Findings) -> Any | None:
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


def heat_maps_figure(findings: Findings, maps: Sequence[HeatMap]) -> Any:
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


FigureFunction = Callable[[Findings, FactorFindings], Any]
ALONG: tuple[tuple[str, str, FigureFunction], ...] = (  # the figures of each factor: name, caption, function
    (
        "success",
        "Success rate at each level with 95 % intervals; the logistic fit with its band. The mark on the 50 % line"
        " is the level at which half of the flights succeed, with its interval.",
        success_figure,
    ),
    (
        "success_beside",
        "Success rate at each level, over all cells, for each choice of the other factors, with the fits."
        " The marks on the 50 % line are the levels at which half of the flights succeed.",
        success_by_choice_figure,
    ),
    (
        "measures",
        "Distance at the decisive measurement, dwell and longest loss at each level: means over episodes with 95 %"
        " intervals.",
        measures_figure,
    ),
    (
        "against_reference",
        "Paired differences of success on the same seeds, with 95 % intervals. Filled: significant in the"
        " randomisation test after Holm's correction.",
        levels_figure,
    ),
    (
        "between_entrants",
        "Paired differences of success between entrants, on the same seeds, with 95 % intervals. Filled:"
        " significant in the randomisation test after Holm's correction.",
        entrants_figure,
    ),
    (
        "target_motion",
        "Metres that a moving target moves during one decision, and the width of the view at its depth: medians,"
        " with the range of 90 % of the steps.",
        target_motion_figure,
    ),
    ("served", "Served control rate at each level, over all steps.", served_figure),
)
POINTS = (
    "at_points",
    "Paired differences of success between entrants, on the same seeds, at every point of the design, with 95 %"
    " intervals. Filled: significant in the randomisation test after Holm's correction over all points.",
)
EFFECTS = (
    "main_effects",
    "Change of the log odds of success from each factor's lowest to its highest level, with the other factors at"
    " their mean, and 95 % intervals. Filled: significant after Holm's correction.",
)
HEAT_MAP = "Success rate over two factors, pooled over the others."


@dataclass(frozen=True, slots=True)
class StudyFigure:
    name: str  # name of its files, without suffix
    caption: str  # one or two sentences
    path: Path  # PNG file; the SVG and PDF files have the same folder and name


def draw(findings: Findings, out: Path) -> list[StudyFigure]:
    """Draw all figures that have data as SVG, PDF and PNG into a folder. Raises InfrastructureError."""
    with style.styled():
        return [
            StudyFigure(name, caption, style.save(figure, out, name))
            for name, caption, figure in _figures(findings)
            if figure is not None
        ]


def _figures(findings: Findings) -> Iterator[tuple[str, str, Any]]:
    """Yield (name, caption, figure or None)."""
    yield *POINTS, points_figure(findings)
    for along in findings.factors:
        for name, caption, draw_figure in ALONG:
            yield along.artifact_name(name), caption, draw_figure(findings, along)
    yield *EFFECTS, effects_figure(findings)
    for (down, across), maps in findings.maps_by_pair():
        yield f"interaction_{down.name}_{across.name}", HEAT_MAP, heat_maps_figure(findings, maps)
