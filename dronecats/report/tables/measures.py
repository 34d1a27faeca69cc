"""What is measured step by step: pointing and depth, replies, the served rate, thinking; and the user's own metrics."""

import statistics
from collections.abc import Callable, Sequence
from dataclasses import replace

from dronecats.judge.metrics.deliberation import Followed, deliberation
from dronecats.judge.metrics.metric import Metric
from dronecats.report import names
from dronecats.report.cells import FLIGHTS, NAME, NONE, PERCENT, count, mean, part, percent, quantile, steps, total
from dronecats.report.report_data import ReportData, titled
from dronecats.report.results.collection import ScoredEpisode
from dronecats.report.results.entrants import Entrant
from dronecats.report.table import ReportTable, TableCell, TableColumn
from episodes.records.record import CELLS

GROUNDING = (
    NAME,
    TableColumn(name="gos", title="Gos"),
    TableColumn(name="on_target_percent", title="On target", group="Pointing", unit="%", better="more"),
    TableColumn(name="pointing_50_deg", title="median", group="Pointing", unit="°", decimals=1, better="less"),
    TableColumn(name="pointing_95_deg", title="95 %", group="Pointing", unit="°", decimals=1),
    TableColumn(name="depth_50_m", title="median", group="Depth error", unit="m", decimals=1),
    TableColumn(name="depth_absolute_50_m", title="median, absolute", group="Depth error", unit="m", decimals=1,
                better="less"),
    TableColumn(name="depth_absolute_95_m", title="95 %, absolute", group="Depth error", unit="m", decimals=1),
    TableColumn(name="rescaled_percent", title="Rescaled copies", unit="%"),
    TableColumn(name="wide_percent", title="Turns beyond 90°", unit="%"),
)  # fmt: skip


def grounding(data: ReportData) -> ReportTable | None:
    """Return pointing and depth over all steps with the target in view; None where no step tells."""

    def row(entrant: Entrant) -> list[TableCell] | None:
        flown = entrant.scored
        hits, angles = steps(flown, names.ON_TARGET), steps(flown, names.POINTING)
        depths, apart = steps(flown, names.DEPTH), steps(flown, names.DEPTH_ABSOLUTE)
        rescaled, wide = steps(flown, names.RESCALED), steps(flown, names.WIDE)
        if not (angles or depths or wide):
            return None
        return [
            count(len(angles)) if angles else NONE,
            part(int(sum(hits)), len(hits)),
            quantile(angles, 0.5),
            quantile(angles, 0.95),
            quantile(depths, 0.5),
            quantile(apart, 0.5),
            quantile(apart, 0.95),
            part(int(sum(rescaled)), len(rescaled)),
            part(int(sum(wide)), len(wide)),
        ]

    blocks = data.blocks(GROUNDING, row)
    if not blocks:
        return None
    return ReportTable(
        name="grounding",
        title="Pointing and depth",
        caption=(
            "Of the gos that were told with the target in view: whether the point is within its box, and the angle"
            " from its centre; of those on the target, the told depth less the true one (positive: too deep). Rescaled"
            " copies: gos that repeat the pixels by which the history shows the go before. Over the steps of all scored"
            " flights; steps of one flight are no sample of their own, so no interval stands here."
        ),
        columns=GROUNDING,
        blocks=blocks,
        command=data.command,
    )


WHY = {names.UNREADABLE: "Unreadable", names.REFUSED: "Refused", names.CUT_OFF: "Cut off"}
REPLIES = (
    NAME,
    FLIGHTS,
    TableColumn(name="decisions", title="Decisions"),
    *(TableColumn(name=f"{name}_percent", title=title, unit="%", decimals=1, better="less")
      for name, title in WHY.items()),
    TableColumn(name="unreadable_flights", title="Flights with any", better="less"),
)  # fmt: skip


def replies(data: ReportData) -> ReportTable | None:
    """Return the shares of unreadable, refused and cut-off replies; None where only built-in pilots flew."""

    def row(entrant: Entrant) -> list[TableCell] | None:
        flown = entrant.scored
        decisions, *counts = (_sum(entrant, name) for name in (names.DECISIONS, *WHY))
        if not (entrant.is_model and decisions):
            return None
        hurt = sum(bool(each.values.get(names.UNREADABLE)) for each in flown)
        return [count(len(flown)), count(decisions), *(part(each, decisions) for each in counts), count(hurt)]

    blocks = data.blocks(REPLIES, row)
    if not blocks:
        return None
    return ReportTable(
        name="replies",
        title="Replies",
        caption=(
            "% of the decisions of all scored flights. Unreadable: the reply holds no action, and the drone holds."
            " Of these, refused: by the model or by a filter of its provider; cut off: at the longest reply that was"
            " allowed, so that a larger max_tokens or less reasoning may help."
        ),
        columns=REPLIES,
        blocks=blocks,
        command=data.command,
    )


def _sum(entrant: Entrant, metric: str) -> int:
    return round(float(total(entrant.scored, metric).value or 0))


QUANTILES = (5, 25, 50, 75, 95)  # %
SERVED = (
    NAME,
    TableColumn(name="steps", title="Steps"),
    *(TableColumn(name=f"rate_{q}_hz", title=f"{q} %", group="Control rate", unit="Hz", decimals=2)
      for q in QUANTILES),
    *(TableColumn(name=f"latency_{q}_s", title=f"{q} %", group="Latency", unit="s", decimals=2) for q in (50, 95)),
    TableColumn(name="stalled_steps_percent", title="Steps", group="Held up by the host", unit="%", decimals=1),
    TableColumn(name="stalled_flights", title="Flights", group="Held up by the host"),
)  # fmt: skip


def served(data: ReportData) -> ReportTable | None:
    """Return the quantiles of rate and latency over all steps, and how many steps the host held up."""

    def row(entrant: Entrant) -> list[TableCell] | None:
        rates, latencies = (steps(entrant.scored, name) for name in (names.RATE, names.LATENCY))
        if not rates:
            return None
        told = [each for each in entrant.scored if each.host_stalls is not None]
        stalled = sum(each.host_stalls or 0 for each in told)
        asked = sum(each.usage.questions for each in told)
        return [
            count(len(rates)),
            *(quantile(rates, q / 100) for q in QUANTILES),
            *(quantile(latencies, q / 100) for q in (50, 95)),
            part(stalled, asked),
            count(sum(bool(each.host_stalls) for each in told)) if told else NONE,
        ]

    blocks = data.blocks(SERVED, row)
    if not blocks:
        return None
    return ReportTable(
        name="served",
        title="Served control rate",
        caption=(
            "Decisions per second of vehicle time, and the vehicle time that replies took, as quantiles over the steps"
            " of all scored flights. Held up: steps that the host, and not the model, delayed, as a simulator that"
            " falls behind does; only flights in real time tell."
        ),
        columns=SERVED,
        blocks=blocks,
        command=data.command,
    )


STALLS, LOSSES = "Stalls broken", "Target seen again"
THINKING = (
    NAME,
    TableColumn(name="thinks", title="Thinks"),
    TableColumn(name="matched", title="Matched"),
    TableColumn(name="gain_m_per_step", title="Gain", unit="m/step", decimals=2),
    *(
        TableColumn(name=f"{name}_after_{who}_percent", title=f"after {words}", group=group, unit="%", decimals=1)
        for name, group in (("stalls", STALLS), ("losses", LOSSES))
        for who, words in (("think", "a think"), ("other", "another"))
    ),
)


def thinking(data: ReportData) -> ReportTable | None:
    """Return the paper's three comparisons over all steps of each line; None where nobody thought."""

    def row(entrant: Entrant) -> list[TableCell] | None:
        told = deliberation(step for each in entrant.scored for step in each.outlooks)
        if not told.thinks:
            return None
        gain = NONE if told.gain_m_per_step is None else TableCell(value=told.gain_m_per_step, of=told.matched)
        return [count(told.thinks), count(told.matched), gain, *_shares(told.stalls), *_shares(told.losses)]

    blocks = data.blocks(THINKING, row)
    if not blocks:
        return None
    return ReportTable(
        name="thinking",
        title="What thinking bought",
        caption=(
            "Of the scored flights, step by step. Gain: metres that the three steps after a think closed, each, more"
            " than those after other steps that had closed at the same rate (matched). Stalls broken, and targets"
            " out of view that were seen again, within three steps. Pilots think where they are in trouble: this"
            " observes, and proves nothing."
        ),
        columns=THINKING,
        blocks=blocks,
        command=data.command,
    )


def _shares(told: Followed) -> tuple[TableCell, TableCell]:
    return part(told.think, told.of_thinks), part(told.other, told.of_others)


def own(metrics: Sequence[Metric]) -> Callable[[ReportData], ReportTable | None]:
    """Return what makes the table of these metrics; of none it makes none."""

    def table(data: ReportData) -> ReportTable | None:
        cells = data.cells(CELLS)
        if not metrics or not cells:
            return None
        columns = [NAME]
        for metric in metrics:
            columns += [_column(metric, cell, data) for cell in cells]

        def row(entrant: Entrant) -> list[TableCell] | None:
            told = [_cell(m, [e for e in entrant.scored if e.cell == cell]) for m in metrics for cell in cells]
            return told if any(cell.value is not None for cell in told) else None

        blocks = data.blocks(columns, row)
        said = tuple(f"{metric.title}: {metric.definition}." for metric in metrics)
        return ReportTable(
            name="own",
            title="Metrics of our own",
            caption="Means over the scored flights; of what is measured step by step, the median over all steps.",
            columns=tuple(columns),
            blocks=blocks,
            notes=said,
            command=data.command,
        )

    return table


def _column(metric: Metric, cell: str, data: ReportData) -> TableColumn:
    unit = "%" if metric.is_share else "" if metric.unit in ("count", "ratio") else metric.unit
    return TableColumn(
        name=f"{cell.replace('-', '_')}_{metric.name}{'_percent' if metric.is_share else ''}",
        title=titled(cell),
        group=metric.title,
        unit=unit,
        decimals=0 if metric.is_share else _decimals(metric, data),
        better=metric.better,
        cell=cell,
    )


def _cell(metric: Metric, flown: Sequence[ScoredEpisode]) -> TableCell:
    if metric.level == "step":
        every = steps(flown, metric.name)
        return part(int(sum(every)), len(every)) if metric.is_share else quantile(every, 0.5)
    if metric.is_share and all(each.values.get(metric.name) in (None, False, True) for each in flown):
        return percent(flown, metric.name)
    told = mean(flown, metric.name)
    return replace(told, value=PERCENT * told.value) if metric.is_share and isinstance(told.value, float) else told


def _decimals(metric: Metric, data: ReportData) -> int:
    """Return as many as show about three digits."""
    told = [abs(value) for each in data.episodes if isinstance(value := each.values.get(metric.name), int | float)]
    size = statistics.median(told) if told else 1.0
    return 0 if size >= 100 else 1 if size >= 10 else 2
