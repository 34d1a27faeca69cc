"""Tables of differences: pairs on the same seeds, the effect of each factor, and factors that act together."""

from collections.abc import Iterable, Sequence

from dronecats.report.table import CellValue, ReportTable, TableCell, TableColumn, TableRow, in_blocks, row
from dronecats.study.analysis.levels import MEASURES
from dronecats.study.analysis.paired_flights import SUCCESS, PairedDifference
from dronecats.study.analysis.points import NE
from dronecats.study.report.findings import FactorFindings, Findings
from dronecats.study.report.level_tables import mean, percent
from dronecats.study.report.words import PERCENT, cell_title

TITLES = {SUCCESS: ("Success", "points"), **{m.metric: (m.title, m.unit) for m in MEASURES}}
AT_POINTS = (SUCCESS, NE)
TESTS = (
    "Pairs are flights of the same episode, seed and other factors; episodes are the unit. Success: points of 100,"
    " Agresti and Min's interval. p: randomisation test of the mean of the episodes' differences, which of one flight"
    " an episode is McNemar's exact test; the interval holds 0 where this p is above 0.05. Of fewer than six episodes,"
    " means have no interval. p, Holm: corrected for all lines of the block and measure, so that a difference whose"
    " interval is without 0 may still not be told apart."
)


def between_levels(found: Findings, along: FactorFindings) -> ReportTable | None:
    """Return each level against the reference, a line a level, a group of columns a measure; None without a pair."""
    reference = along.factor.told(along.factor.reference)
    pairs = ((f"{each.first}, {cell_title(each.cell).lower()}", each) for each in along.between_levels)
    title, caption = f"Each level against {reference}", f"The level less {reference}, of the same entrant. {TESTS}"
    return _table(found, along, pairs, name="against_reference", title=title, caption=caption)


def between_entrants(found: Findings, along: FactorFindings) -> ReportTable | None:
    """Return each two entrants at each level; None where there are no two."""
    pairs = ((f"{e.first} less {e.second}, {cell_title(e.cell).lower()}", e) for e in along.between_entrants)
    title = f"Who flies, at each level of {along.factor.name.replace('_', ' ')}"
    caption = f"The first less the second, at the same level. {TESTS}"
    return _table(found, along, pairs, name="between_entrants", title=title, caption=caption)


def at_points(found: Findings) -> ReportTable | None:
    """Return each two entrants at every point of the design, a line a point; None where there is nothing to tell."""
    if not found.points:
        return None
    rows = [
        (f"{each.first} and {each.second}, {cell_title(each.cell).lower()}",
         row(each.title, each.success.pairs, *map(percent, each.shares), *_told(each.success, PERCENT),
             *_told(each.ne, 1.0)))
        for each in found.points
    ]  # fmt: skip
    columns = [TableColumn(name="point", title="Where", align="left"), TableColumn(name="pairs", title="Pairs")]
    columns += [
        TableColumn(name=f"{side}_percent", title=side.capitalize(), group="Success", unit="%")
        for side in ("first", "second")
    ]
    for metric in AT_POINTS:
        columns += _columns(metric)
    caption = (
        "Success of the first and of the second, and the first less the second, at every point of the design; the line"
        f" names what is not at its usual level there. {TESTS}"
    )
    return ReportTable(
        name="at_points",
        title="Who flies, at every point",
        caption=caption,
        columns=tuple(columns),
        blocks=in_blocks(rows),
        command=found.command,
    )


def _table(
    found: Findings,
    along: FactorFindings,
    pairs: Iterable[tuple[str, PairedDifference]],
    *,
    name: str,
    title: str,
    caption: str,
) -> ReportTable | None:
    """Return a table of differences by their blocks, a line a level, a group of columns a measure."""
    lines: dict[tuple[str, str], dict[str, PairedDifference]] = {}
    for block, each in pairs:
        lines.setdefault((block, each.at.title), {})[each.metric] = each
    if not lines:
        return None
    columns = [
        TableColumn(name="level", title=along.factor.title, align="left"),
        TableColumn(name="pairs", title="Pairs"),
    ]
    for metric in TITLES:
        columns += _columns(metric)
    return ReportTable(
        name=along.named(name),
        title=title,
        caption=caption,
        columns=tuple(columns),
        blocks=in_blocks((block, _row(at, by_metric)) for (block, at), by_metric in lines.items()),
        command=found.command,
    )


def _row(at: str, by_metric: dict[str, PairedDifference]) -> TableRow:
    cells = [cell for metric in TITLES for cell in _told(by_metric.get(metric), PERCENT if metric == SUCCESS else 1.0)]
    return row(at, max(each.pairs for each in by_metric.values()), *cells)


def _columns(metric: str) -> list[TableColumn]:
    shown, unit = TITLES[metric]
    group = f"{shown} ({unit})"
    return [
        TableColumn(name=f"{metric}_difference", title="Difference", group=group, decimals=1),
        TableColumn(name=f"{metric}_p", title="p", group=group, decimals=3, floor=0.001),
        TableColumn(name=f"{metric}_p_holm", title="p, Holm", group=group, decimals=3, floor=0.001),
    ]


def _told(each: PairedDifference | None, scale: float) -> Sequence[CellValue | TableCell]:
    return (None, None, None) if each is None else (mean(each.difference, scale), each.difference.p, each.p_holm)


def tables(found: Findings, along: FactorFindings) -> Sequence[ReportTable]:
    """Return these tables of one factor, those that there is something to tell in."""
    return [table for table in (between_levels(found, along), between_entrants(found, along)) if table is not None]


def effects(found: Findings) -> ReportTable | None:
    """Return what each factor does by itself, a line each."""
    if not found.effects:
        return None
    factors = found.studied.factors
    columns = (
        TableColumn(name="factor", title="Factor", align="left"),
        TableColumn(name="begin", title="From", align="left"),
        TableColumn(name="end", title="To", align="left"),
        TableColumn(name="success_begin_percent", title="From", group="SR, fitted", unit="%"),
        TableColumn(name="success_end_percent", title="To", group="SR, fitted", unit="%"),
        TableColumn(name="log_odds", title="Change of log odds", decimals=1),
        TableColumn(name="p", title="p", decimals=3, floor=0.001),
        TableColumn(name="p_holm", title="p, Holm", decimals=3, floor=0.001),
        TableColumn(name="episodes", title="Episodes"),
    )
    rows = []
    for each in found.effects:
        factor = factors[each.factor]
        fitted = PERCENT * each.share_begin, PERCENT * each.share_end
        change = TableCell(value=each.log_odds, low=each.low, high=each.high)
        ends = factor.told(each.begin), factor.told(each.end)
        made = row(factor.name.replace("_", " "), *ends, *fitted, change, each.p, each.p_holm, each.episodes)
        rows.append((f"{each.entrant}, {cell_title(each.cell).lower()}", made))
    return ReportTable(
        name="main_effects",
        title="Main effects",
        caption=(
            "One logistic regression on all factors with a random intercept an episode. Each line is a factor from its"
            " lowest to its highest level while the others stay at their middle: the fitted success rates, the change"
            " of the log odds with its 95 % profile-likelihood interval, and the p of the likelihood ratio."
        ),
        columns=columns,
        blocks=in_blocks(rows),
        notes=("Of a fraction, effects are mixed with interactions as its resolution says.",)
        if "fraction" in found.studied.design
        else (),
        command=found.command,
    )


def interactions(found: Findings) -> Sequence[ReportTable]:
    """Return a table for each two factors: the shares at all of their levels, and whether they only add up."""
    made = []
    for pair in dict.fromkeys((each.rows, each.columns) for each in found.maps):
        down, across = (found.studied.factors[number] for number in pair)
        maps = [each for each in found.maps if (each.rows, each.columns) == pair]
        columns = (
            TableColumn(name="level", title=down.title, align="left"),
            *(TableColumn(name=f"success_{k}_percent", title=step.title, group=across.title, unit="%", better="more")
              for k, step in enumerate(maps[0].column_steps)),
            TableColumn(name="p_added", title="p of no interaction", decimals=3, floor=0.001),
        )  # fmt: skip
        rows = [
            (f"{each.entrant}, {cell_title(each.cell).lower()}",
             row(step.title, *map(percent, shares), each.p if k == 0 else None, entrant=each.entrant))
            for each in maps
            for k, (step, shares) in enumerate(zip(each.row_steps, each.shares, strict=True))
        ]  # fmt: skip
        made.append(
            ReportTable(
                name=f"interaction_{down.name}_{across.name}",
                title=f"{down.name.replace('_', ' ').capitalize()} with {across.name.replace('_', ' ')}",
                caption=(
                    "Success rate, % of the flights that count, with 95 % intervals. p of no interaction: likelihood"
                    " ratio of the two factors' product, in log odds."
                ),
                columns=columns,
                blocks=in_blocks(rows),
                command=found.command,
            )
        )
    return made
