"""Success over two factors: a field a choice of their levels, with its number in it."""

import math
from collections.abc import Sequence
from typing import Any

from dronecats.report.figures import style
from dronecats.study.analysis.effects import HeatMap
from dronecats.study.report.figures import panels
from dronecats.study.report.findings import Findings
from dronecats.study.report.words import PERCENT, cell_title, probability

COLOURS = "cividis"  # even in lightness, and the same to eyes that see no red
DARK = 55.0  # %, below which a field is dark


def heat(found: Findings, maps: Sequence[HeatMap]) -> Any:
    """Return the maps of one pair of factors, a panel an entrant and cell."""
    down, across = (found.studied.factors[number] for number in (maps[0].rows, maps[0].columns))
    rows, columns = len(maps[0].row_steps), len(maps[0].column_steps)
    several = len(found.studied.entrants) > 1
    made, axes = panels.panels(len(maps), 0.75 + 0.3 * rows, 2 if columns > 5 else panels.ACROSS)
    for axis, each in zip(axes, maps, strict=True):
        shares = [[PERCENT * known.share for known in line] for line in each.shares]
        image = axis.imshow(shares, cmap=COLOURS, vmin=0.0, vmax=100.0, aspect="auto")
        for y, line in enumerate(shares):
            for x, share in enumerate(line):
                if not math.isnan(share):
                    axis.text(x, y, f"{share:.0f}", ha="center", va="center", fontsize=7,
                              color="white" if share < DARK else "black")  # fmt: skip
        axis.set_xticks(range(columns), [panels.plain(step, across) for step in each.column_steps])
        axis.set_yticks(range(rows), [panels.plain(step, down) for step in each.row_steps])
        axis.tick_params(length=0)
        for spine in axis.spines.values():
            spine.set_visible(False)
        who = f"{each.entrant}, {cell_title(each.cell).lower()}" if several else cell_title(each.cell)
        axis.set_title(who + ("" if each.p is None else f"\ninteraction p {_equals(each.p)}"))
        axis.set_xlabel(across.title)
        axis.set_ylabel(down.title)
    bar = made.colorbar(image, ax=axes, shrink=0.9, pad=0.02)
    bar.set_label("success rate (%)")
    bar.outline.set_linewidth(0.0)
    bar.ax.tick_params(color=style.GREY)
    return panels.finished(made, axes, found.command)


def _equals(p: float) -> str:
    told = probability(p)
    return told if told.startswith("<") else f"= {told}"
