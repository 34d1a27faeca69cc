"""Who solved which episode: a square for each, which shows what no rate does."""

from typing import Any

from dronecats.report.blocks import BUILT_IN, MODELS, Lineup, titled
from dronecats.report.figures import style
from episodes.records.record import CELLS

SIDE = 0.84  # of a square


def grid(lineup: Lineup) -> Any:
    """Return the figure: a line for each entrant, a column for each episode, filled by the share of flights solved."""
    order = {cell: k for k, cell in enumerate(CELLS)}
    flown = {each.episode: (order.get(each.cell, len(CELLS)), each.map, each.episode) for each in lineup.episodes}
    columns = sorted(flown, key=lambda name: flown[name])
    lines, heads, y = [], [], 0.0
    for title, is_model in ((MODELS, True), (BUILT_IN, False)):
        members = [entrant for entrant in lineup.entrants if entrant.is_model is is_model]
        if members:
            heads.append((title, y))
            y += 0.9
        for entrant in members:
            lines.append((entrant, y))
            y += 1.0
    made, axis = style.figure(y + 0.5, line_in=0.24, below_in=1.15)
    for entrant, height in lines:
        for x, name in enumerate(columns):
            _square(axis, x, height, entrant.by_episode.get(name), any(e.episode == name for e in entrant.episodes))
    _groups(axis, [(flown[name][0], flown[name][1]) for name in columns], y)
    axis.set_yticks([height for _, height in lines], [entrant.label for entrant, _ in lines])
    axis.tick_params(axis="both", length=0)
    for title, height in heads:
        axis.annotate(title, (0.0, height), xytext=(-4, 0), xycoords=("axes fraction", "data"), ha="right",
                      textcoords="offset points", va="center", style="italic", color=style.GREY)  # fmt: skip
    axis.set_xlim(-0.7, len(columns) - 0.3)
    axis.set_ylim(y - 0.3, -0.6)
    for spine in axis.spines.values():
        spine.set_visible(False)
    made.legend(handles=_keys(), loc="outside lower center", ncols=4)
    return made


def _square(axis: Any, x: int, y: float, scored: Any, tried: bool) -> None:
    """Draw one entrant's flights of one episode."""
    from matplotlib.patches import Rectangle

    if scored:
        share = sum(each.success for each in scored) / len(scored)
        filled = SIDE * share  # from below
        for top, height, colour in ((-SIDE / 2, SIDE - filled, style.LIGHT), (SIDE / 2 - filled, filled, style.BLUE)):
            if height > 0:
                axis.add_patch(Rectangle((x - SIDE / 2, y + top), SIDE, height, facecolor=colour, linewidth=0))
    elif tried:
        axis.plot(x, y, "x", color=style.VERMILION, markersize=3, markeredgewidth=0.8)


def _groups(axis: Any, groups: list[tuple[int, str]], bottom: float) -> None:
    """Name the columns by cell and map, with a line between."""
    ticks, labels = [], []
    begin = 0
    for end in range(1, len(groups) + 1):
        if end == len(groups) or groups[end] != groups[begin]:
            cell, map_ = groups[begin]
            ticks.append((begin + end - 1) / 2)
            labels.append(f"{titled(CELLS[cell]) if cell < len(CELLS) else 'Other'}\n{map_}")
            if end < len(groups):
                thick = groups[end][0] != cell
                axis.axvline(end - 0.5, color=style.GREY, linewidth=0.9 if thick else 0.3)
            begin = end
    axis.set_xticks(ticks, labels, rotation=45, ha="right", rotation_mode="anchor", fontsize=7)


def _keys() -> list[Any]:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    return [
        Patch(facecolor=style.BLUE, label="solved (filled by the share of flights)"),
        Patch(facecolor=style.LIGHT, label="not solved"),
        Line2D([], [], marker="x", color=style.VERMILION, linestyle="", markersize=4, label="not scored"),
    ]
