"""Draws results over a factor's levels: success, other measures, served rate (decisions per second), target motion."""

import math
from typing import Any

from dronecats.report import figures as style
from dronecats.study.analysis.study_results import ALL, MEASURES, LevelResult, level_steps, levels_besides, successes
from dronecats.study.analysis.success_fits import HalfSuccessFit
from dronecats.study.report import panels
from dronecats.study.report.findings import PERCENT, FactorFindings, Findings, cell_title, other_levels


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

    If the level has no best estimate, its interval is drawn.
    """
    if fit.curve is not None:
        axis.plot(fit.curve.at, PERCENT * fit.curve.share, color=panels.colour(number), linewidth=1.3)
        if alone:
            axis.fill_between(fit.curve.at, PERCENT * fit.curve.low, PERCENT * fit.curve.high,
                              color=panels.colour(number), alpha=0.15, linewidth=0)  # fmt: skip
    half, levels = fit.half, [float(level) for level in along.factor.levels]
    if half.where not in ("within", "between"):
        return
    low, high = max(half.low, min(levels)), min(half.high, max(levels))
    if alone or half.value is None:
        axis.plot([low, high], [50.0, 50.0], color=panels.colour(number), linewidth=3.0, alpha=0.55,
                  solid_capstyle="butt", zorder=2)  # fmt: skip
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
