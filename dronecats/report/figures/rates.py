"""At which rate pilots were served: a box for each, from the table's quantiles."""

from typing import Any

from dronecats.report.figures import style
from dronecats.report.figures.bars import cell
from dronecats.report.report_table import ReportTable
from dronecats.report.tables.served import QUANTILES


def rates(table: ReportTable) -> Any:
    """Return the figure of the table `served`: whiskers from 5 to 95 %, the box from 25 to 75, a line at the median."""
    found, heads = style.lines(table)
    made, axis = style.figure(found[-1].y + 1.0, below_in=0.6)
    for line in found:
        told = [cell(table, line.row, f"rate_{q}_hz").value for q in QUANTILES]
        low, begin, middle, end, high = (float(value) for value in told if isinstance(value, int | float))
        axis.plot([low, high], [line.y, line.y], color=style.INK, linewidth=0.8)
        axis.barh(
            line.y, end - begin, left=begin, height=0.5, color=style.SKY, edgecolor=style.INK, linewidth=0.6, zorder=3
        )
        axis.plot([middle, middle], [line.y - 0.25, line.y + 0.25], color=style.INK, linewidth=1.6, zorder=4)
    style.named(axis, found, heads)
    axis.set_xlim(left=0.0)
    axis.set_xlabel("decisions per second of vehicle time: 5, 25, 50, 75 and 95 % of the steps")
    return made
