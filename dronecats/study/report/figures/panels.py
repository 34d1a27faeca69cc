"""What the figures share: panels on a page's width, who is drawn how, levels along an axis, the command beneath."""

import textwrap
from collections.abc import Sequence
from typing import Any

from dronecats.report.figures import style
from dronecats.study.analysis.levels import LevelStep
from dronecats.study.analysis.studied import StudiedFactor

COLOURS = (style.BLUE, style.VERMILION, style.GREEN, style.PURPLE, style.ORANGE, style.SKY)
MARKERS = "osD^vP"
ACROSS = 3  # panels beside one another at most
LETTERS = 118  # of the command in a line
CLEAR = 0.045  # of an axis, what two labels keep between them


def panels(count: int, height_in: float, across: int = ACROSS, *, share_y: bool = True) -> tuple[Any, list[Any]]:
    """Return a figure with so many panels, row by row, and their axes."""
    columns = min(across, count)
    rows = -(-count // columns)
    made = style.canvas(rows * height_in + 0.55)
    grid = made.subplots(rows, columns, sharey=share_y, squeeze=False)
    axes = [axis for line in grid for axis in line]
    for axis in axes[count:]:
        axis.set_visible(False)
    return made, axes[:count]


def colour(number: int) -> str:
    """Return the colour of the entrant of this number."""
    return COLOURS[number % len(COLOURS)]


def marker(number: int) -> str:
    """Return the marker of the entrant of this number."""
    return MARKERS[number % len(MARKERS)]


def along(steps: Sequence[LevelStep]) -> list[float]:
    """Return where levels stand on an axis: numbers at their place, words one after another."""
    return [float(number) if step.at is None else step.at for number, step in enumerate(steps)]


def ticked(axis: Any, factor: StudiedFactor, steps: Sequence[LevelStep]) -> None:
    """Name the levels below a panel; where they stand too near to one another, every second is named, or fewer."""
    places = along(steps)
    reach = max(places) - min(places) or 1.0
    words = any(step.at is None for step in steps)
    named, last = [], -float("inf")
    for at, step in zip(places, steps, strict=True):
        if words or at - last >= CLEAR * 2 * reach:
            named.append((at, plain(step, factor)))
            last = at
    axis.set_xticks([at for at, _ in named], [name for _, name in named])
    axis.set_xticks(places, minor=True)
    axis.set_xlim(min(places) - 0.06 * reach, max(places) + 0.06 * reach)
    axis.set_xlabel(factor.title)


def plain(step: LevelStep, factor: StudiedFactor) -> str:
    """Return a level as it stands on an axis that names the unit."""
    return step.title.removesuffix(f" {factor.unit}") if factor.unit else step.title


def shifted(places: Sequence[float], number: int, count: int) -> list[float]:
    """Return the places moved aside a little, so that several entrants do not hide one another."""
    reach = (max(places) - min(places)) or 1.0
    aside = 0.012 * reach * (number - (count - 1) / 2)
    return [place + aside for place in places]


def finished(made: Any, axes: Sequence[Any], command: str) -> Any:
    """Return the figure with its legend above, and beneath it the command that makes it."""
    told: dict[str, Any] = {}
    for axis in axes:
        for handle, label in zip(*axis.get_legend_handles_labels(), strict=True):
            told.setdefault(label, handle)
    if len(told) > 1:
        made.legend(list(told.values()), list(told), loc="outside upper center", ncols=min(3, len(told)))
    lines = textwrap.wrap(command, LETTERS, break_long_words=False, break_on_hyphens=False)
    made.supxlabel("\n".join(lines), x=0.01, ha="left", fontsize=5.5, color=style.GREY, family="monospace")
    made.draw_without_rendering()
    made.set_layout_engine("none")  # it stands as it is: each of the three files would lay it out anew
    return made
