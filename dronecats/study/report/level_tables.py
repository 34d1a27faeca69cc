"""Tables along one factor: success, half-success, all measures, the served rate, and the motion of targets."""

from collections.abc import Sequence

from dronecats.judge.statistics.differences import KnownMean
from dronecats.judge.statistics.shares import KnownShare
from dronecats.report.table import ReportTable, TableCell, TableColumn, in_blocks, row
from dronecats.study.analysis.levels import MEASURES, AtLevel
from dronecats.study.analysis.steps import QUANTILES, StepQuantiles
from dronecats.study.report.findings import FactorFindings, Findings
from dronecats.study.report.words import PERCENT, beside, cell_title, interval, place, scatter

EPISODES_ARE = "episodes are the unit, several flights of one being no more evidence than they are (95 % intervals)"


def success(found: Findings, along: FactorFindings) -> ReportTable:
    """Return a line an entrant and cell: the share of successes at each level, and where half succeed."""
    steps = [each.step for each in along.levels if (each.entrant, each.cell) == _entrant_and_cell(along.levels[0])]
    group = along.factor.title
    columns = (
        TableColumn(name="cell", title="Cell", align="left"),
        *(
            TableColumn(name=f"success_{k}_percent", title=step.title, group=group, unit="%", better="more")
            for k, step in enumerate(steps)
        ),
        TableColumn(name="half", title="Half succeed at", align="left"),
        TableColumn(name="half_interval", title="Interval", align="left"),
    )
    rows = []
    for entrant, cell in dict.fromkeys(map(_entrant_and_cell, along.levels)):
        there = [each for each in along.levels if _entrant_and_cell(each) == (entrant, cell)]
        fits = [each for each in along.halves if (each.entrant, each.cell) == (entrant, cell)]
        half = fits[0].half if len(fits) == 1 else None  # beside other factors there are several
        at = (place(along.factor, half), interval(along.factor, half)) if half else (None, None)
        shares = (percent(each.success) for each in there)
        rows.append((entrant, row(cell_title(cell), *shares, *at, entrant=entrant)))
    return ReportTable(
        name=along.named("success"),
        title=f"Success along {along.factor.name.replace('_', ' ')}",
        caption=f"Success rate, % of the flights that count; {EPISODES_ARE}. Half succeed at: the fit's.",
        columns=columns,
        blocks=in_blocks(rows),
        command=found.command,
    )


def measures(found: Findings, along: FactorFindings) -> ReportTable:
    """Return a line an entrant, cell and level, with every measure."""
    columns = (
        TableColumn(name="level", title=along.factor.title, align="left"),
        TableColumn(name="flights", title="Flights"),
        TableColumn(name="not_scored", title="Not scored"),
        TableColumn(name="success_percent", title="SR", unit="%", decimals=1, better="more"),
        *(TableColumn(name=each.metric, title=each.title, unit=each.unit, decimals=1, better=each.better)
          for each in MEASURES),
    )  # fmt: skip
    rows = [
        (f"{entrant}, {cell_title(cell).lower()}",
         row(each.step.title, each.success.trials, each.not_scored, percent(each.success), *map(mean, each.measures),
             entrant=entrant))
        for entrant, cell in found.studied.lines()
        for each in along.levels
        if _entrant_and_cell(each) == (entrant, cell)
    ]  # fmt: skip
    return ReportTable(
        name=along.named("measures"),
        title=f"All measures along {along.factor.name.replace('_', ' ')}",
        caption=(
            "SR: success rate. NE: distance at the decisive measurement. Dwell: time within the radius with the target"
            f" in view. Longest loss: longest time without it in view. Means over episodes; {EPISODES_ARE}."
        ),
        columns=columns,
        blocks=in_blocks(rows),
        command=found.command,
    )


def halves(found: Findings, along: FactorFindings) -> ReportTable | None:
    """Return a line a fit: where half succeed, the slope, the episodes' scatter, and whether a line fits at all."""
    if not along.halves:
        return None
    unit = f" per {along.factor.unit}" if along.factor.unit else ""
    parted = any(each.beside for each in along.halves)
    columns = (
        TableColumn(name="cell", title="Cell", align="left"),
        *([TableColumn(name="beside", title="Other factors", align="left")] if parted else []),
        TableColumn(name="half", title="Half succeed at", align="left"),
        TableColumn(name="half_interval", title="Interval", align="left"),
        TableColumn(name="slope", title=f"Slope, log odds{unit}", decimals=2),
        TableColumn(name="scatter", title="Scatter of episodes, log odds", decimals=2),
        TableColumn(name="p_slope", title="p of no slope", decimals=3, floor=0.001),
        TableColumn(name="p_straight", title="p of a straight line", decimals=3, floor=0.001),
        TableColumn(name="episodes", title="Episodes"),
        TableColumn(name="flights", title="Flights"),
    )
    rows = []
    for each in sorted(along.halves, key=lambda each: found.studied.entrants.index(each.entrant)):
        fit = each.half
        choice = [beside(found.studied, each)] if parted else []
        at = place(along.factor, fit), interval(along.factor, fit)
        numbers = fit.slope, scatter(fit), fit.p_slope, fit.p_straight, fit.groups, fit.trials
        rows.append((each.entrant, row(cell_title(each.cell), *choice, *at, *numbers, entrant=each.entrant)))
    return ReportTable(
        name=along.named("half_success"),
        title=f"Half-success {along.factor.name.replace('_', ' ')}",
        caption=(
            "A logistic regression of success on the factor with a random intercept an episode, by marginal likelihood."
            " Half succeed at: where the fitted share over all episodes is 50 %, with its 95 % profile-likelihood"
            " interval (limit: F with 1 and episodes less one degrees of freedom); no place is told outside of the"
            " levels that were flown. Where episodes decide almost all by themselves, scatter and slope grow together"
            " and only the place is told. p of a straight line: against a share of its own for each level; where it is"
            " small, the logistic line is not the flights' shape, and the place a rough one."
        ),
        columns=columns,
        blocks=in_blocks(rows),
        command=found.command,
    )


def percent(told: KnownShare) -> TableCell:
    """Return a share in % with its interval."""
    if not told.trials:
        return TableCell(value=None)
    return TableCell(value=PERCENT * told.share, low=PERCENT * told.low, high=PERCENT * told.high,
                     count=told.successes, of=told.trials)  # fmt: skip


def mean(told: KnownMean, scale: float = 1.0) -> TableCell:
    """Return a mean with its interval."""
    if not told.episodes:
        return TableCell(value=None)
    low, high = (None if end is None else scale * end for end in (told.low, told.high))
    return TableCell(value=scale * told.mean, low=low, high=high, of=told.episodes)


def _entrant_and_cell(told: AtLevel) -> tuple[str, str]:
    return told.entrant, told.cell


def tables(found: Findings, along: FactorFindings) -> Sequence[ReportTable]:
    """Return these tables of one factor, those that there is something to tell in."""
    made = (success(found, along), halves(found, along), measures(found, along))
    return [table for table in made if table is not None]


MIDDLE, LEAST, MOST = (QUANTILES.index(share) for share in (0.5, 0.05, 0.95))


def served(found: Findings, along: FactorFindings) -> ReportTable | None:
    """Return the quantiles of the rate that was served, a line a level."""
    columns = (
        TableColumn(name="level", title=along.factor.title, align="left"),
        TableColumn(name="steps", title="Steps"),
        *(TableColumn(name=f"rate_{q * 100:g}_hz", title=f"{q * 100:g} %", group="Control rate (Hz)", decimals=2)
          for q in QUANTILES),
        *(TableColumn(name=f"latency_{q * 100:g}_s", title=f"{q * 100:g} %", group="Latency (s)", decimals=2)
          for q in QUANTILES),
    )  # fmt: skip
    if not along.served:
        return None
    rows = [
        (each.entrant, row(each.step.title, each.rate_hz.steps, *_quantiles(each.rate_hz), *_quantiles(each.latency_s),
                           entrant=each.entrant))
        for each in along.served
    ]  # fmt: skip
    return ReportTable(
        name=along.named("served"),
        title="Control rate that was served",
        caption=(
            "Decisions per second of vehicle time, and the vehicle time that replies took: quantiles over the steps of"
            " all flights that count."
        ),
        columns=columns,
        blocks=in_blocks(rows),
        command=found.command,
    )


def motion(found: Findings, along: FactorFindings) -> ReportTable | None:
    """Return how far targets moved during one decision beside the width of the view, a line a level."""
    columns = (
        TableColumn(name="level", title=along.factor.title, align="left"),
        TableColumn(name="episodes", title="Episodes"),
        TableColumn(name="steps", title="Steps"),
        TableColumn(name="period_s", title="Decision period", unit="s", decimals=2),
        TableColumn(name="moved_m", title="Target moved", unit="m", decimals=2),
        TableColumn(name="width_m", title="Width of the view", unit="m", decimals=1),
        TableColumn(name="share_percent", title="Moved, of the width", unit="%", decimals=1),
    )
    if not along.motions:
        return None
    rows = [
        (f"{each.entrant}, {cell_title(each.cell).lower()}",
         row(each.step.title, each.episodes, each.moved_m.steps, _spread(each.period_s), _spread(each.moved_m),
             _spread(each.width_m), _spread(each.share, PERCENT)))
        for each in along.motions
    ]  # fmt: skip
    return ReportTable(
        name=along.named("target_motion"),
        title="What the target moves during one decision",
        caption=(
            "Of flights whose target moves: the time from one picture to the drone's next, the metres between the"
            " target's places at both, and the width of the picture at the target's depth (90° across). Medians, with"
            " what 90 % of the steps lie between."
        ),
        columns=columns,
        blocks=in_blocks(rows),
        command=found.command,
    )


def _quantiles(told: StepQuantiles) -> Sequence[float | None]:
    return told.at or [None] * len(QUANTILES)


def _spread(told: StepQuantiles, scale: float = 1.0) -> TableCell:
    """Return a median with what 90 % of the steps lie between."""
    if not told.at:
        return TableCell(value=None)
    return TableCell(value=scale * told.at[MIDDLE], low=scale * told.at[LEAST], high=scale * told.at[MOST])
