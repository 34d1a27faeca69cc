"""Shared parts of the figures of a study: panels, colours and markers of entrants, axes of levels, and the legend."""

import textwrap
from collections.abc import Sequence
from typing import Any

from dronecats.report import figures as style
from dronecats.study.analysis.study_results import LevelStep, StudiedFactor

COLOURS = (style.BLUE, style.VERMILION, style.GREEN, style.PURPLE, style.ORANGE, style.SKY)
MARKERS = "osD^vP"
COLUMNS_MAX = 3  # at most this many panels in a row
COMMAND_LINE_CHARS = 118  # at most this many characters in a line of the command below a figure
TICK_GAP = 0.045  # half of the least distance between two labels, as a share of the axis


def panels(count: int, height_in: float, across: int = COLUMNS_MAX, *, share_y: bool = True) -> tuple[Any, list[Any]]:
    """Return a figure with `count` panels, at most `across` in a row, and their axes, row by row."""
    columns = min(across, count)
    rows = -(-count // columns)
    figure = style.canvas(rows * height_in + 0.55)
    grid = figure.subplots(rows, columns, sharey=share_y, squeeze=False)
    axes = [axis for line in grid for axis in line]
    for axis in axes[count:]:
        axis.set_visible(False)
    return figure, axes[:count]


def colour(number: int) -> str:
    """Return the colour of the entrant with this index."""
    return COLOURS[number % len(COLOURS)]


def marker(number: int) -> str:
    return MARKERS[number % len(MARKERS)]


def places_of(steps: Sequence[LevelStep]) -> list[float]:
    """Return the places of levels on an axis: the value of a numeric level, the index of any other level."""
    return [float(number) if step.at is None else step.at for number, step in enumerate(steps)]


def name_levels(axis: Any, factor: StudiedFactor, steps: Sequence[LevelStep]) -> None:
    """Label the levels below a panel. A level too close to the previous label gets no label."""
    places = places_of(steps)
    reach = max(places) - min(places) or 1.0
    words = any(step.at is None for step in steps)
    ticks, last = [], -float("inf")
    for at, step in zip(places, steps, strict=True):
        if words or at - last >= TICK_GAP * 2 * reach:
            ticks.append((at, without_unit(step, factor)))
            last = at
    axis.set_xticks([at for at, _ in ticks], [name for _, name in ticks])
    axis.set_xticks(places, minor=True)
    axis.set_xlim(min(places) - 0.06 * reach, max(places) + 0.06 * reach)
    axis.set_xlabel(factor.title)


def without_unit(step: LevelStep, factor: StudiedFactor) -> str:
    """Return the title of a level without the unit, since the title of the axis has it."""
    return step.title.removesuffix(f" {factor.unit}") if factor.unit else step.title


def shifted(places: Sequence[float], number: int, count: int) -> list[float]:
    """Return the places with a small shift per entrant, so that markers do not hide each other."""
    reach = max(places, default=0.0) - min(places, default=0.0) or 1.0
    aside = 0.012 * reach * (number - (count - 1) / 2)
    return [place + aside for place in places]


def draw_spans(
    axis: Any, places: Sequence[float], spans: Sequence[tuple[float, float, float]], number: int, **options: Any
) -> None:
    """Draw values with their intervals, as (low, value, high), with the colour and marker of an entrant."""
    reach = [[value - low for low, value, _ in spans], [high - value for _, value, high in spans]]
    usual = {"color": colour(number), "marker": marker(number), "markersize": 3.5, "linewidth": 1.0, "elinewidth": 0.8}
    axis.errorbar(places, [value for _, value, _ in spans], yerr=reach, **{**usual, **options})


def finish(figure: Any, axes: Sequence[Any], command: str) -> Any:
    """Return the figure with a legend above it and the command below it."""
    handles: dict[str, Any] = {}
    for axis in axes:
        for handle, label in zip(*axis.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    if len(handles) > 1:
        figure.legend(list(handles.values()), list(handles), loc="outside upper center", ncols=min(3, len(handles)))
    lines = textwrap.wrap(command, COMMAND_LINE_CHARS, break_long_words=False, break_on_hyphens=False)
    figure.supxlabel("\n".join(lines), x=0.01, ha="left", fontsize=5.5, color=style.GREY, family="monospace")
    figure.draw_without_rendering()
    figure.set_layout_engine("none")  # now the SVG, PDF and PNG files share this layout
    return figure
