"""Tables of what is told of steps, of several factors together, and of how the study was flown."""

from collections.abc import Sequence

from dronecats.report.report_table import ReportTable, TableBlock, TableCell, TableColumn, TableRow
from dronecats.study.analysis.steps import QUANTILES, StepQuantiles
from dronecats.study.report.findings import FactorFindings, Findings
from dronecats.study.report.outcome_tables import percent
from dronecats.study.report.words import PERCENT, cell_title

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
    blocks = [
        TableBlock(title=entrant, rows=tuple(
            TableRow(entrant=entrant, cells=(
                TableCell(value=each.step.title), TableCell(value=each.rate_hz.steps),
                *_quantiles(each.rate_hz), *_quantiles(each.latency_s),
            ))
            for each in along.served if each.entrant == entrant
        ))
        for entrant in dict.fromkeys(each.entrant for each in along.served)
    ]  # fmt: skip
    if not blocks:
        return None
    return ReportTable(
        name=along.named("served"),
        title="Control rate that was served",
        caption=(
            "Decisions per second of vehicle time, and the vehicle time that replies took: quantiles over the steps of"
            " all flights that count."
        ),
        columns=columns,
        blocks=tuple(blocks),
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
    blocks: dict[str, list[TableRow]] = {}
    for each in along.motions:
        cells = (
            TableCell(value=each.step.title), TableCell(value=each.episodes), TableCell(value=each.moved_m.steps),
            _spread(each.period_s), _spread(each.moved_m), _spread(each.width_m), _spread(each.share, PERCENT),
        )  # fmt: skip
        blocks.setdefault(f"{each.entrant}, {cell_title(each.cell).lower()}", []).append(TableRow(cells=cells))
    if not blocks:
        return None
    return ReportTable(
        name=along.named("target_motion"),
        title="What the target moves during one decision",
        caption=(
            "Of flights whose target moves: the time from one picture to the drone's next, the metres between the"
            " target's places at both, and the width of the picture at the target's depth (90° across). Medians, with"
            " what 90 % of the steps lie between."
        ),
        columns=columns,
        blocks=tuple(TableBlock(title=title, rows=tuple(rows)) for title, rows in blocks.items()),
        command=found.command,
    )


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
    blocks: dict[str, list[TableRow]] = {}
    for each in found.effects:
        factor = factors[each.factor]
        cells = (
            TableCell(value=factor.name.replace("_", " ")),
            TableCell(value=factor.told(each.begin)),
            TableCell(value=factor.told(each.end)),
            TableCell(value=PERCENT * each.share_begin),
            TableCell(value=PERCENT * each.share_end),
            TableCell(value=each.log_odds, low=each.low, high=each.high),
            TableCell(value=each.p),
            TableCell(value=each.p_holm),
            TableCell(value=each.episodes),
        )
        blocks.setdefault(f"{each.entrant}, {cell_title(each.cell).lower()}", []).append(TableRow(cells=cells))
    return ReportTable(
        name="main_effects",
        title="Main effects",
        caption=(
            "One logistic regression on all factors with a random intercept an episode. Each line is a factor from its"
            " lowest to its highest level while the others stay at their middle: the fitted success rates, the change"
            " of the log odds with its 95 % profile-likelihood interval, and the p of the likelihood ratio."
        ),
        columns=columns,
        blocks=tuple(TableBlock(title=title, rows=tuple(rows)) for title, rows in blocks.items()),
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
        blocks = [
            TableBlock(title=f"{each.entrant}, {cell_title(each.cell).lower()}", rows=tuple(
                TableRow(entrant=each.entrant, cells=(
                    TableCell(value=step.title), *map(percent, shares), TableCell(value=each.p if k == 0 else None),
                ))
                for k, (step, shares) in enumerate(zip(each.row_steps, each.shares, strict=True))
            ))
            for each in maps
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
                blocks=tuple(blocks),
                command=found.command,
            )
        )
    return made


def setup(found: Findings) -> ReportTable:
    """Return how the study was laid out."""
    studied = found.studied
    scored, flown = len(studied.scored), len(studied.flights)
    told = [
        ("Study", studied.name),
        ("Design", studied.design),
        *(
            (factor.title, ", ".join(factor.told(level) for level in factor.levels) if len(factor.levels) <= 24
             else f"{len(factor.levels)} levels")
            for factor in studied.factors
        ),
        ("Who flew", ", ".join(studied.entrants)),
        ("Cells", ", ".join(cell_title(cell) for cell in studied.cells)),
        ("Episodes", str(len({each.scored.episode for each in studied.flights}))),
        ("Flights", f"{flown} of {studied.planned} flown, {scored} of them scored"),
        ("Seeds", "the same flight of an episode has the same seed at every level"),
    ]  # fmt: skip
    return ReportTable(
        name="setup",
        title="How it was flown",
        caption="What the folder of the study tells.",
        columns=(
            TableColumn(name="what", title="What", align="left"),
            TableColumn(name="told", title="", align="left"),
        ),
        blocks=(TableBlock(title="", rows=tuple(
            TableRow(cells=(TableCell(value=what), TableCell(value=value))) for what, value in told
        )),),
        command=found.command,
    )  # fmt: skip


def _quantiles(told: StepQuantiles) -> list[TableCell]:
    return [TableCell(value=value) for value in told.at] or [TableCell(value=None)] * len(QUANTILES)


def _spread(told: StepQuantiles, scale: float = 1.0) -> TableCell:
    """Return a median with what 90 % of the steps lie between."""
    if not told.at:
        return TableCell(value=None)
    return TableCell(value=scale * told.at[MIDDLE], low=scale * told.at[LEAST], high=scale * told.at[MOST])
