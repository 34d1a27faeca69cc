"""Every figure of the report, in its order."""

from collections.abc import Sequence
from pathlib import Path

from dronecats.report.blocks import Lineup
from dronecats.report.figures import bars, style
from dronecats.report.figures.grid import grid
from dronecats.report.figures.rates import rates
from dronecats.report.report_table import ReportTable

GRID = "episode_by_episode"  # which is of no table
OF_TABLES = {  # table → its figure's name, and what draws it
    "approaching": ("reach_declare_succeed", bars.nested),
    "failures": ("failure_modes", bars.modes),
    "drones": ("commanding_by_drone", bars.decomposition),
    "served": ("served_rate", rates),
}


def draw(lineup: Lineup, made: Sequence[ReportTable], out: Path) -> dict[str, Path]:
    """Draw what there is to draw as SVG, PDF and PNG, and return the PNG of each table, and GRID's.

    Raises InfrastructureError.
    """
    drawn = {}
    with style.styled():
        for table in made:
            if table.name in OF_TABLES and table.rows:
                name, figure = OF_TABLES[table.name]
                drawn[table.name] = style.save(figure(table), out, name)
        if lineup.episodes:
            drawn[GRID] = style.save(grid(lineup), out, GRID)
    return drawn
