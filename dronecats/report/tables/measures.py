"""Tables of declarations, thinking, pointing and depth, replies, served rate, incidents; and the user's own metrics."""

import statistics
from collections.abc import Sequence
from dataclasses import replace

from dronecats.judge.metrics.audit import Followed, deliberation
from dronecats.judge.metrics.metric import Metric
from dronecats.report.report_data import (
    FLIGHTS,
    NAME,
    PERCENT,
    Cells,
    Entrant,
    ReportData,
    by_entrant,
    cell_heading,
    fraction,
    known_values,
    mean,
    percent,
    quantile,
    steps,
    total,
)
from dronecats.report.results.collection import ScoredEpisode
from dronecats.report.table import ReportTable, TableCell, TableColumn
from dronecats.report.tables.outcomes import cut_off, rate
from episodes.records.record import CELLS


def declarations(data: ReportData) -> ReportTable | None:
    """Return success rates, and number and precision of declarations.

    A flight has `success` if one of its declarations qualifies, even if others are false.
    """
    rates = {"success": "SR", "success_at_first": "SR₁", "success_within_three": "SR₃"}
    columns = [
        NAME,
        FLIGHTS,
        *(replace(rate(metric, title, None), group="") for metric, title in rates.items()),
        TableColumn(name="declarations_per_flight", title="Declarations", decimals=1),
        TableColumn(name="false_per_flight", title="of these, false", decimals=1, better="less"),
        TableColumn(name="precision_percent", title="Precision", unit="%", better="more"),
    ]

    def row_of(entrant: Entrant) -> Cells | None:
        flights = entrant.scored
        if not flights:
            return None
        precision = mean(flights, "declaration_precision")
        if isinstance(precision.value, float):
            precision = replace(precision, value=PERCENT * precision.value)
        counts = [mean(flights, "declarations"), mean(flights, "false_declarations")]
        return [len(flights), *(percent(flights, metric) for metric in rates), *counts, precision]

    return data.table(
        name="declarations",
        title="Declarations",
        caption=(
            "SR₁ and SR₃: solved by the first declaration, or by one of the first three. Declarations per flight,"
            " and how many of them did not qualify. Precision: the share that qualified, mean over the flights"
            " with declarations. All cells; the declarations of a fleet are counted together."
        ),
        columns=columns,
        row_of=row_of,
        notes=cut_off(data.episodes),
    )


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


@by_entrant(
    title="Pointing and depth",
    caption=(
        "Go actions with the target in view: share of points within the target's box, and angle from its"
        " centre. Depth error: depth of the action minus true depth, for points on the target (positive: too"
        " deep). Rescaled copies: go actions that repeat the pixels of the previous go in the history. Over"
        " the steps of all scored flights; without intervals, because the steps of a flight are not independent."
    ),
    columns=GROUNDING,
)
def grounding(entrant: Entrant) -> Cells | None:
    """Return errors of `go` actions (pointing, depth) and the share of turns beyond 90°; None without such steps."""
    flights = entrant.scored
    angles, depths = steps(flights, "pointing_error_deg"), steps(flights, "depth_error_m")
    distances, turns = steps(flights, "depth_error_abs_m"), steps(flights, "wide_rotation")
    if not (angles or depths or turns):
        return None
    return [
        len(angles) or None,
        _share(steps(flights, "on_target")),
        quantile(angles, 0.5),
        quantile(angles, 0.95),
        quantile(depths, 0.5),
        quantile(distances, 0.5),
        quantile(distances, 0.95),
        _share(steps(flights, "rescaled")),
        _share(turns),
    ]


def _share(values: Sequence[float]) -> TableCell:
    """Return the mean (%) of values from 0 to 1. If all are 0 or 1, it is the share of ones, with the counts."""
    if not set(values) <= {0.0, 1.0}:
        return TableCell(value=PERCENT * statistics.fmean(values), of=len(values))
    return fraction(int(sum(values)), len(values))


FAULTS = {"unreadable": "Unreadable", "refused": "Refused", "cut_off": "Cut off"}  # metric → title
REPLIES = (
    NAME,
    FLIGHTS,
    TableColumn(name="decisions", title="Decisions"),
    *(TableColumn(name=f"{name}_percent", title=title, unit="%", decimals=1, better="less")
      for name, title in FAULTS.items()),
    TableColumn(name="unreadable_flights", title="Flights with any", better="less"),
)  # fmt: skip


@by_entrant(
    title="Replies",
    caption=(
        "% of the decisions of all scored flights. Unreadable: the reply has no action, and the drone hovers."
        " Some of these: refused by the model or by a filter of its provider; cut off at max_tokens, so a"
        " larger max_tokens or less reasoning may help."
    ),
    columns=REPLIES,
)
def replies(entrant: Entrant) -> Cells | None:
    """Return the shares of unreadable, refused and cut-off replies; None if only built-in pilots flew."""
    flights = entrant.scored
    decisions = total(flights, "decisions")
    if not (entrant.is_model and decisions):
        return None
    shares = [fraction(total(flights, name), decisions) for name in FAULTS]
    return [len(flights), decisions, *shares, sum(bool(flight.values.get("unreadable")) for flight in flights)]


INCIDENTS = (
    NAME,
    FLIGHTS,
    TableColumn(name="hit_flights_percent", title="Flights with any", group="Hits", unit="%", better="less"),
    TableColumn(name="hits", title="Hits", group="Hits"),
    TableColumn(name="crashes", title="Crashes", group="Hits"),
    TableColumn(name="hardest_hit_mps", title="Hardest", group="Hits", unit="m/s", decimals=1),
    TableColumn(name="contact_s", title="In contact", group="Hits", unit="s", decimals=1),
    TableColumn(name="reset_flights_percent", title="Flights with any", group="Estimator resets", unit="%",
                better="less"),
    TableColumn(name="estimator_resets", title="Resets", group="Estimator resets"),
)  # fmt: skip


@by_entrant(
    title="Collisions and estimator resets",
    caption=(
        "Scored flights. They never change a verdict. Hits: contacts with obstacles, the ground or other drones."
        " Hardest: highest closing speed. In contact: sum over all drones. --exclude-above hits=0 and"
        " --exclude-above estimator_resets=0 leave such flights out."
    ),
    columns=INCIDENTS,
)
def incidents(entrant: Entrant) -> Cells | None:
    """Return collisions and estimator resets, which never change a verdict; None if neither was logged."""
    flights = entrant.scored
    hits, resets = known_values(flights, "hits"), known_values(flights, "estimator_resets")
    if not (hits or resets):
        return None
    contact_s = known_values(flights, "contact_s")
    return [
        len(flights),
        fraction(sum(map(bool, hits)), len(hits)),
        total(flights, "hits") if hits else None,
        total(flights, "crashes") if hits else None,
        max(known_values(flights, "hardest_hit_mps"), default=None),
        sum(contact_s) if hits else None,
        fraction(sum(map(bool, resets)), len(resets)),
        total(flights, "estimator_resets") if resets else None,
    ]


QUANTILES = (5, 25, 50, 75, 95)  # %
SERVED = (
    NAME,
    TableColumn(name="steps", title="Steps"),
    *(TableColumn(name=f"rate_{q}_hz", title=f"{q} %", group="Control rate", unit="Hz", decimals=2)
      for q in QUANTILES),
    *(TableColumn(name=f"latency_{q}_s", title=f"{q} %", group="Latency", unit="s", decimals=2) for q in (50, 95)),
    TableColumn(name="stalled_steps_percent", title="Steps", group="Delayed by the host", unit="%", decimals=1),
    TableColumn(name="stalled_flights", title="Flights", group="Delayed by the host"),
)  # fmt: skip


@by_entrant(
    title="Served control rate",
    caption=(
        "Control rate: decisions per second of vehicle time. Latency: vehicle time from a question to its reply."
        " The columns are quantiles over the steps of all scored flights. Delayed by the host: steps that this"
        " computer delayed and not the model, for example when the simulator is too slow. It is known for flights"
        " in real time only."
    ),
    columns=SERVED,
)
def served(entrant: Entrant) -> Cells | None:
    """Return the quantiles of rate and latency over all steps, and the share of steps that the host delayed."""
    rates, latencies = steps(entrant.scored, "rate_hz"), steps(entrant.scored, "latency_s")
    if not rates:
        return None
    timed = [flight for flight in entrant.scored if flight.host_stalls is not None]
    stalls = [flight.host_stalls or 0 for flight in timed]
    return [
        len(rates),
        *(quantile(rates, q / 100) for q in QUANTILES),
        *(quantile(latencies, q / 100) for q in (50, 95)),
        fraction(sum(stalls), sum(flight.usage.questions for flight in timed)),
        sum(map(bool, stalls)) if timed else None,
    ]


THINKING = (
    NAME,
    TableColumn(name="thinks", title="Thinks"),
    TableColumn(name="matched", title="Matched"),
    TableColumn(name="gain_m_per_step", title="Gain", unit="m/step", decimals=2),
    *(
        TableColumn(name=f"{name}_after_{step}_percent", title=f"after {words}", group=group, unit="%", decimals=1)
        for name, group in (("stalls", "Stalls broken"), ("losses", "Target seen again"))
        for step, words in (("think", "a think"), ("other", "another"))
    ),
)


@by_entrant(
    title="Effect of think",
    caption=(
        "Steps of the scored flights. Gain: metres per step that the three steps after a think closed, minus"
        " the same for other steps with an equal closing rate before (matched). Stalls broken, and lost"
        " targets seen again: within three steps. Pilots think when they are in trouble, so this comparison"
        " is an observation and not a proof."
    ),
    columns=THINKING,
)
def thinking(entrant: Entrant) -> Cells | None:
    """Return the paper's three comparisons of `think` with other actions, by pilot; None if no step is a `think`."""
    effect = deliberation(step for flight in entrant.scored for step in flight.step_outlooks)
    if not effect.thinks:
        return None
    gain = TableCell(value=effect.gain_m_per_step, of=None if effect.gain_m_per_step is None else effect.matched)
    return [effect.thinks, effect.matched, gain, *_fractions(effect.stalls), *_fractions(effect.losses)]


def _fractions(followed: Followed) -> tuple[TableCell, TableCell]:
    return fraction(followed.think, followed.of_thinks), fraction(followed.other, followed.of_others)


def own(data: ReportData, metrics: Sequence[Metric]) -> ReportTable | None:
    """Return the table of the user's own metrics; None without metrics or flights."""
    cells = data.cells(CELLS)

    def row_of(entrant: Entrant) -> Cells | None:
        values = [_cell(m, [e for e in entrant.scored if e.cell == cell]) for m in metrics for cell in cells]
        return values if any(cell.value is not None for cell in values) else None

    return data.table(
        name="own",
        title="Your own metrics",
        caption="Means over the scored flights; for metrics of steps, the median over all steps.",
        columns=[NAME, *(_column(metric, cell, data) for metric in metrics for cell in cells)],
        row_of=row_of,
        notes=tuple(f"{metric.title}: {metric.definition}." for metric in metrics),
    )


def _column(metric: Metric, cell: str, data: ReportData) -> TableColumn:
    unit = "%" if metric.is_share else "" if metric.unit in ("count", "ratio") else metric.unit
    return TableColumn(
        name=f"{cell.replace('-', '_')}_{metric.name}{'_percent' if metric.is_share else ''}",
        title=cell_heading(cell),
        group=metric.title,
        unit=unit,
        decimals=0 if metric.is_share else _decimals(metric, data),
        better=metric.better,
        cell=cell,
    )


def _cell(metric: Metric, flights: Sequence[ScoredEpisode]) -> TableCell:
    if metric.level == "step":
        values = steps(flights, metric.name)
        return _share(values) if metric.is_share else quantile(values, 0.5)
    if metric.is_share and all(flight.values.get(metric.name) in (None, False, True) for flight in flights):
        return percent(flights, metric.name)
    cell = mean(flights, metric.name)
    return replace(cell, value=PERCENT * cell.value) if metric.is_share and isinstance(cell.value, float) else cell


def _decimals(metric: Metric, data: ReportData) -> int:
    """Return the number of decimals that shows about three digits of a metric."""
    sizes = [abs(value) for flight in data.episodes
             if isinstance(value := flight.values.get(metric.name), int | float)]  # fmt: skip
    size = statistics.median(sizes) if sizes else 1.0
    return 0 if size >= 100 else 1 if size >= 10 else 2


TABLES = (declarations, thinking, grounding, replies, served, incidents)
