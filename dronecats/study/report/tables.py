"""Makes the tables of a study's report: measures along a factor, paired differences, effects, interactions.

A cell in a row or title is a kind of episode; an entrant is a pilot.
"""

from collections.abc import Iterable, Sequence

from dronecats.judge.statistics.differences import KnownMean
from dronecats.report.report_data import share_cell
from dronecats.report.table import (
    CellValue,
    ReportTable,
    TableCell,
    TableColumn,
    TableRow,
    in_blocks,
    numbers,
    row,
    words,
)
from dronecats.study.analysis.differences import NE, SUCCESS, PairedDifference
from dronecats.study.analysis.steps import QUANTILES, StepQuantiles
from dronecats.study.analysis.study_results import MEASURES, LevelResult, LevelStep
from dronecats.study.report.findings import (
    PERCENT,
    FactorFindings,
    Findings,
    cell_title,
    half_interval,
    half_place,
    in_cell,
    other_levels,
    scatter_value,
)

UNIT = "the episode is the unit, because flights of one episode are not independent (95 % intervals)"


def success(findings: Findings, along: FactorFindings) -> ReportTable:
    """Return a table with a row per entrant and cell: success at each level, and the half-success level."""
    lines: dict[tuple[str, str], list[LevelResult]] = {}
    for level in along.levels:
        lines.setdefault((level.entrant, level.cell), []).append(level)
    columns = [words("Cell", "cell")]
    columns += [
        TableColumn(name=f"success_{k}_percent", title=level.step.title, group=along.factor.title, unit="%",
                    better="more")
        for k, level in enumerate(next(iter(lines.values()), []))
    ]  # fmt: skip
    columns += [words("Half succeed at", "half"), words("Interval", "half_interval")]
    rows = []
    for (entrant, cell), levels in lines.items():
        fits = [fit.half for fit in along.halves if (fit.entrant, fit.cell) == (entrant, cell)]
        half = fits[0] if len(fits) == 1 else None  # if the other factors give several fits, the row shows none
        place = (half_place(along.factor, half), half_interval(along.factor, half)) if half else (None, None)
        shares = (share_cell(level.success) for level in levels)
        rows.append((entrant, row(cell_title(cell), *shares, *place, entrant=entrant)))
    caption = f"Success rate, % of the scored flights; {UNIT}. Half succeed at: from the logistic fit."
    return _table(
        findings, along.artifact_name("success"), f"Success along {along.factor.words}", caption, columns, rows
    )


def measures(findings: Findings, along: FactorFindings) -> ReportTable:
    """Return a table with every measure, and a row per entrant, cell and level."""
    columns = [
        words(along.factor.title, "level"),
        numbers("Flights", "flights"),
        numbers("Not scored", "not_scored"),
        TableColumn(name="success_percent", title="SR", unit="%", decimals=1, better="more"),
        *(TableColumn(name=m.name, title=m.title, unit=m.unit, decimals=1, better=m.better) for m in MEASURES),
    ]
    rows = [
        (in_cell(entrant, cell),
         row(level.step.title, level.success.trials, level.not_scored, share_cell(level.success),
             *map(mean, level.measures), entrant=entrant))
        for entrant, cell in findings.results.lines()
        for level in along.levels
        if (level.entrant, level.cell) == (entrant, cell)
    ]  # fmt: skip
    caption = (
        "SR: success rate. NE: distance at the decisive measurement. Dwell: time within the radius with the target"
        f" in view. Longest loss: longest time without it in view. Means over episodes; {UNIT}."
    )
    title = f"All measures along {along.factor.words}"
    return _table(findings, along.artifact_name("measures"), title, caption, columns, rows)


def half_success(findings: Findings, along: FactorFindings) -> ReportTable | None:
    """Return a table with a row per fit: half-success level, slope, scatter of the episodes, and tests of the fit.

    None without fits.
    """
    if not along.halves:
        return None
    unit = f" per {along.factor.unit}" if along.factor.unit else ""
    has_choices = any(fit.beside for fit in along.halves)
    columns = [
        words("Cell", "cell"),
        *([words("Other factors", "beside")] if has_choices else []),
        words("Half succeed at", "half"),
        words("Interval", "half_interval"),
        numbers(f"Slope, log odds{unit}", "slope", decimals=2),
        numbers("Scatter of episodes, log odds", "scatter", decimals=2),
        _p_column("p of no slope", "p_slope"),
        _p_column("p of a straight line", "p_straight"),
        numbers("Episodes", "episodes"),
        numbers("Flights", "flights"),
    ]
    rows = []
    for fit in sorted(along.halves, key=lambda fit: findings.results.entrants.index(fit.entrant)):
        half = fit.half
        choice = [other_levels(findings.results, fit)] if has_choices else []
        place = half_place(along.factor, half), half_interval(along.factor, half)
        fitted = half.slope, scatter_value(half), half.p_slope, half.p_straight, half.groups, half.trials
        rows.append((fit.entrant, row(cell_title(fit.cell), *choice, *place, *fitted, entrant=fit.entrant)))
    caption = (
        "A logistic regression of success on the factor, with a random intercept for each episode, by marginal"
        " likelihood. Half succeed at: the level at which the fitted success rate over all episodes is 50 %. The table"
        " gives it only if it is between the lowest and the highest flown level. Interval: 95 %, by profile"
        " likelihood, with the quantile of F(1, episodes − 1) instead of chi-square; if a model without slope fits as"
        " well, the level may be beyond either end. If the outcome depends almost"
        " only on the episode, the scatter is ≥ 12 and the table has no slope. p of a straight line: test of the"
        " logistic line against a separate success rate for each level. A small p means that the line does not fit"
        " the flights. The half-success level is then only a rough value."
    )
    title = f"Half-success {along.factor.words}"
    return _table(findings, along.artifact_name("half_success"), title, caption, columns, rows)


def mean(estimate: KnownMean, scale: float = 1.0) -> TableCell:
    if not estimate.episodes:
        return TableCell(value=None)
    low, high = (None if end is None else scale * end for end in (estimate.low, estimate.high))
    return TableCell(value=scale * estimate.mean, low=low, high=high, of=estimate.episodes)


def _table(
    findings: Findings,
    name: str,
    title: str,
    caption: str,
    columns: Iterable[TableColumn],
    rows: Iterable[tuple[str, TableRow]],
    notes: tuple[str, ...] = (),
) -> ReportTable:
    """`rows`: (title of the row's block, row)."""
    return ReportTable(name=name, title=title, caption=caption, columns=tuple(columns), blocks=in_blocks(rows),
                       notes=notes, command=findings.command)  # fmt: skip


def _p_column(title: str, name: str, group: str = "") -> TableColumn:
    return TableColumn(name=name, title=title, group=group, decimals=3, floor=0.001)


def served_rates(findings: Findings, along: FactorFindings) -> ReportTable | None:
    """Return a table of quantiles of the served rate and latency, a row per entrant and level; None without data."""
    if not along.served:
        return None
    columns = [words(along.factor.title, "level"), numbers("Steps", "steps")]
    for name, unit, group in (("rate", "hz", "Control rate (Hz)"), ("latency", "s", "Latency (s)")):
        columns += [numbers(f"{100 * q:g} %", f"{name}_{100 * q:g}_{unit}", group=group, decimals=2) for q in QUANTILES]
    rows = [
        (at.entrant, row(at.step.title, at.rate_hz.steps, *_quantiles(at.rate_hz), *_quantiles(at.latency_s),
                         entrant=at.entrant))
        for at in along.served
    ]  # fmt: skip
    caption = (
        "Control rate: decisions per second of vehicle time. Latency: vehicle time from a question to its reply. The"
        " columns are quantiles over the steps of all scored flights."
    )
    return _table(findings, along.artifact_name("served"), "Served control rate", caption, columns, rows)


def target_motion(findings: Findings, along: FactorFindings) -> ReportTable | None:
    """Return a table of target motion during one decision and the width of the view; None without moving targets.

    The table has a row per entrant, cell and level.
    """
    if not along.motions:
        return None
    columns = (
        words(along.factor.title, "level"),
        numbers("Episodes", "episodes"),
        numbers("Steps", "steps"),
        numbers("Decision period", "period_s", unit="s", decimals=2),
        numbers("Target moved", "moved_m", unit="m", decimals=2),
        numbers("Width of the view", "width_m", unit="m", decimals=1),
        numbers("Moved, of the width", "share_percent", unit="%", decimals=1),
    )
    rows = [
        (in_cell(at.entrant, at.cell),
         row(at.step.title, at.episodes, at.moved_m.steps, _spread(at.period_s), _spread(at.moved_m),
             _spread(at.width_m), _spread(at.share, PERCENT)))
        for at in along.motions
    ]  # fmt: skip
    caption = (
        "For flights with a moving target: the time from one picture to the drone's next picture, the metres that the"
        " target moves in this time, and the width of the view at the target's depth (90° across). Medians, with the"
        " range of 90 % of the steps."
    )
    title = "Motion of the target during one decision"
    return _table(findings, along.artifact_name("target_motion"), title, caption, columns, rows)


def _quantiles(quantiles: StepQuantiles) -> Sequence[float | None]:
    return quantiles.at or [None] * len(QUANTILES)


def _spread(quantiles: StepQuantiles, scale: float = 1.0) -> TableCell:
    """Return a table cell with a median and its 5 and 95 % quantiles."""
    if not quantiles.at:
        return TableCell(value=None)
    low, middle, high = quantiles.span(scale)
    return TableCell(value=middle, low=low, high=high)


TITLES = {SUCCESS: ("Success", "points"), **{m.name: (m.title, m.unit) for m in MEASURES}}
TESTS = (
    "Pairs are flights of the same episode, seed and other factors; episodes are the unit. Success: percentage"
    " points, Agresti and Min's interval. p: randomisation test of the mean of the episodes' differences, which for"
    " one flight per episode is McNemar's exact test; the interval contains 0 if this p is above 0.05. With fewer"
    " than six episodes, means have no interval. p, Holm: corrected for all rows of the block and measure, so a"
    " difference whose interval excludes 0 may still not be significant."
)


def between_levels(findings: Findings, along: FactorFindings) -> ReportTable | None:
    """Return a table of each level's measures minus those at the reference: a row per level, columns per measure.

    None without pairs.
    """
    reference = along.factor.label(along.factor.reference)
    differences = ((in_cell(d.first, d.cell), d) for d in along.between_levels)
    title, caption = f"Each level against {reference}", f"The level minus {reference}, for the same entrant. {TESTS}"
    return _difference_table(findings, along, differences, "against_reference", title, caption)


def between_entrants(findings: Findings, along: FactorFindings) -> ReportTable | None:
    """Return a table of the difference of each pair of entrants at each level; None with a single entrant."""
    differences = ((in_cell(f"{d.first} minus {d.second}", d.cell), d) for d in along.between_entrants)
    title = f"Entrants against each other, at each level of {along.factor.words}"
    caption = f"The first minus the second, at the same level. {TESTS}"
    return _difference_table(findings, along, differences, "between_entrants", title, caption)


def point_differences(findings: Findings) -> ReportTable | None:
    """Return a table of the difference of each pair of entrants, a row per point of the design; None without points."""
    differences = ((in_cell(f"{d.first} and {d.second}", d.cell), d) for d in findings.points)
    caption = (
        "Success of the first and of the second, and the first minus the second, at every point of the design; a row"
        f" names the factors that are not at their usual level. {TESTS}"
    )
    title = "Entrants against each other, at every point"
    return _difference_table(findings, None, differences, "at_points", title, caption)


def _difference_table(
    findings: Findings,
    along: FactorFindings | None,
    differences: Iterable[tuple[str, PairedDifference]],
    name: str,
    title: str,
    caption: str,
) -> ReportTable | None:
    """Return a table with a row per level and a group of columns per measure; None without differences.

    `along` None: a row per point, with the shares of successes of both sides. `differences`: (title of the row's block,
    difference).
    """
    by_row: dict[tuple[str, LevelStep], dict[str, PairedDifference]] = {}
    for block, difference in differences:
        by_row.setdefault((block, difference.at), {})[difference.metric] = difference
    if not by_row:
        return None
    metrics = tuple(TITLES) if along else (SUCCESS, NE)
    columns = [words(along.factor.title, "level") if along else words("Where", "point"), numbers("Pairs", "pairs")]
    if not along:
        columns += [
            numbers(side.capitalize(), f"{side}_percent", group="Success", unit="%") for side in ("first", "second")
        ]
    columns += [column for metric in metrics for column in _difference_columns(metric)]
    rows = []
    for (block, step), by_metric in by_row.items():
        shares = () if along else map(share_cell, by_metric[SUCCESS].shares)
        cells = [cell for metric in metrics for cell in _difference_cells(by_metric.get(metric), metric)]
        pairs = max(difference.pairs for difference in by_metric.values())
        rows.append((block, row(step.title, pairs, *shares, *cells)))
    return _table(findings, along.artifact_name(name) if along else name, title, caption, columns, rows)


def _difference_columns(metric: str) -> list[TableColumn]:
    title, unit = TITLES[metric]
    group = f"{title} ({unit})"
    return [
        numbers("Difference", f"{metric}_difference", group=group, decimals=1),
        _p_column("p", f"{metric}_p", group),
        _p_column("p, Holm", f"{metric}_p_holm", group),
    ]


def _difference_cells(row: PairedDifference | None, metric: str) -> Sequence[CellValue | TableCell]:
    if row is None:
        return None, None, None
    return mean(row.difference, PERCENT if metric == SUCCESS else 1.0), row.difference.p, row.p_holm


def effects(findings: Findings) -> ReportTable | None:
    """Return a table of the main effects, a row per factor; None without effects."""
    if not findings.effects:
        return None
    columns = (
        words("Factor", "factor"),
        words("From", "begin"),
        words("To", "end"),
        numbers("From", "success_begin_percent", group="SR, fitted", unit="%"),
        numbers("To", "success_end_percent", group="SR, fitted", unit="%"),
        numbers("Change of log odds", "log_odds", decimals=1),
        _p_column("p", "p"),
        _p_column("p, Holm", "p_holm"),
        numbers("Episodes", "episodes"),
    )
    rows = []
    for effect in findings.effects:
        factor = findings.results.factors[effect.factor]
        fitted = PERCENT * effect.share_begin, PERCENT * effect.share_end
        change = TableCell(value=effect.log_odds, low=effect.low, high=effect.high)
        ends = factor.label(effect.begin), factor.label(effect.end)
        cells = row(factor.words, *ends, *fitted, change, effect.p, effect.p_holm, effect.episodes)
        rows.append((in_cell(effect.entrant, effect.cell), cells))
    caption = (
        "One logistic regression on all factors with a random intercept for each episode. Each line is a factor"
        " from its lowest to its highest level while the others stay at their mean: the fitted success rates, the"
        " change of the log odds with its 95 % profile-likelihood interval, and the p of the likelihood ratio."
    )
    note = "In a fraction, effects are confounded with interactions according to its resolution."
    notes = (note,) if "fraction" in findings.results.design else ()
    return _table(findings, "main_effects", "Main effects", caption, columns, rows, notes)


def interactions(findings: Findings) -> Sequence[ReportTable]:
    """Return a table for each pair of factors: success at each combination of levels, and the p of no interaction."""
    tables = []
    for (row_factor, column_factor), maps in findings.maps_by_pair():
        columns = [words(row_factor.title, "level")]
        columns += [
            TableColumn(name=f"success_{k}_percent", title=step.title, group=column_factor.title, unit="%",
                        better="more")
            for k, step in enumerate(maps[0].column_steps)
        ]  # fmt: skip
        columns.append(_p_column("p of no interaction", "p_added"))
        rows = [
            (in_cell(heat_map.entrant, heat_map.cell),
             row(step.title, *map(share_cell, shares), heat_map.p if k == 0 else None, entrant=heat_map.entrant))
            for heat_map in maps
            for k, (step, shares) in enumerate(zip(heat_map.row_steps, heat_map.shares, strict=True))
        ]  # fmt: skip
        caption = (
            "Success rate, % of the scored flights, with 95 % intervals. p of no interaction: likelihood ratio test"
            " of two models of the log odds, with and without the product of the two factors."
        )
        name = f"interaction_{row_factor.name}_{column_factor.name}"
        title = f"{row_factor.words.capitalize()} with {column_factor.words}"
        tables.append(_table(findings, name, title, caption, columns, rows))
    return tables
