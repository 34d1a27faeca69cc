"""Where replies point and how deep: how well a point is on the target, and how far the depth is off."""

from dronecats.report import names
from dronecats.report.blocks import Lineup
from dronecats.report.entries import NAME, NONE, count, part, quantile, steps
from dronecats.report.report_table import ReportTable, TableCell, TableColumn
from dronecats.report.results.entrants import Entrant

COLUMNS = (
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


def grounding(lineup: Lineup) -> ReportTable | None:
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

    blocks = lineup.blocks(COLUMNS, row)
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
        columns=COLUMNS,
        blocks=blocks,
        command=lineup.command,
    )
