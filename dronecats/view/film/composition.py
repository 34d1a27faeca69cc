"""One picture of a film: chase views on the left, what the pilots saw over the map on the right, words below."""

import math
from dataclasses import dataclass

import numpy as np

from dronecats.view.film import captions, onboard
from dronecats.view.film.chase import chase
from dronecats.view.film.flown import FilmedFlight
from dronecats.view.film.map_pane import MapPane
from dronecats.view.film.stage import FilmStage, chase_lens, standing
from dronecats.view.film.words import BACKGROUND, Picture, color_of, plate, write
from foundation.run_folder.rows import drone_label

REFERENCE_PX = 720  # height at which words are as large as they are written down
GAP = 4  # px there, between the panes


@dataclass(frozen=True, slots=True)
class Pane:
    """A part of the picture, px."""

    left: int
    top: int
    width: int
    height: int


@dataclass(frozen=True, slots=True)
class Panes:
    """Where everything stands in a picture of a certain size."""

    chase: tuple[Pane, ...]  # one a drone
    onboard: tuple[Pane, ...]  # likewise
    map: Pane
    bar: Pane
    unit: float  # px of this picture to one of the reference's


def panes(width: int, height: int, drones: int) -> Panes:
    """Return the panes of a picture (px) of so many drones."""
    unit = height / REFERENCE_PX
    gap = max(1, round(GAP * unit))
    column, low = round(0.3125 * width), round(0.165 * height)
    high = height - low - gap
    seen = round(column * 9 / 16)
    chase_area = Pane(0, 0, width - column - gap, high)
    seen_area = Pane(width - column, 0, column, seen)
    return Panes(
        chase=_grid(chase_area, drones, gap),
        onboard=_grid(seen_area, drones, gap),
        map=Pane(width - column, seen + gap, column, high - seen - gap),
        bar=Pane(0, height - low, width, low),
        unit=unit,
    )


def _grid(area: Pane, count: int, gap: int) -> tuple[Pane, ...]:
    """Return an area shared out: rows of as many columns as make the parts as like the whole as can be."""
    columns = math.ceil(math.sqrt(count))
    rows = math.ceil(count / columns)
    width, height = (area.width - gap * (columns - 1)) // columns, (area.height - gap * (rows - 1)) // rows
    return tuple(
        Pane(area.left + (k % columns) * (width + gap), area.top + (k // columns) * (height + gap), width, height)
        for k in range(count)
    )


class Composition:
    """Draws the pictures of a film of one flight, at any time of it."""

    def __init__(self, flight: FilmedFlight, width: int, height: int, drone: int | None = None) -> None:
        """`drone`: the only one that is followed; None: each of the fleet in a pane of its own."""
        self._flight, self._size = flight, (width, height)
        self._followed = flight.drones if drone is None else (drone,)
        self.panes = panes(width, height, len(self._followed))
        first = self.panes.chase[0]
        self._stage = FilmStage(flight, chase_lens(first.width, first.height))
        stands = standing(flight)
        self._ways = {each: chase(flight.tracks[each], flight.end_s, stands) for each in self._followed}
        where = self.panes.map
        self._map = MapPane(flight, where.width, where.height, self.panes.unit)
        self._kept: tuple[float, Picture] | None = None  # the newest picture, without its bar

    def at(self, t: float, speed: float = 1.0, over: bool = False) -> Picture:
        """Return the picture at a time, (height, width, 3) RGB. `over`: the flight is, and its verdict is said."""
        if self._kept is None or self._kept[0] != t:
            self._kept = t, self._views(t)
        picture = self._kept[1].copy()
        where, unit = self.panes.bar, self.panes.unit
        _put(picture, where, captions.bar(self._flight, t, speed, over, where.width, where.height, unit))
        return picture

    def _views(self, t: float) -> Picture:
        width, height = self._size
        picture = np.full((height, width, 3), BACKGROUND, np.uint8)
        for drone, view, seen in zip(self._followed, self.panes.chase, self.panes.onboard, strict=True):
            drawn = self._stage.picture(self._ways[drone].at(t), t)
            if len(self._flight.drones) > 1:
                self._name(drawn, drone, t)
            _put(picture, view, drawn)
            _put(picture, seen, onboard.pane(self._flight, drone, t, seen.width, seen.height, self.panes.unit))
        _put(picture, self.panes.map, self._map.at(t))
        return picture

    def _name(self, view: Picture, drone: int, t: float) -> None:
        """Say on a chase view whose it is and what that one is about."""
        small = max(9, round(15 * self.panes.unit))
        plate(view, 0, 0, view.shape[1], round(1.6 * small))
        text, color = captions.action(self._flight, drone, t)
        left, top = round(0.5 * small), round(0.15 * small)
        left += write(view, drone_label(drone), (left, top), small, color_of(drone), True) + small
        write(view, text, (left, top), small, color)

    def close(self) -> None:
        """Let the renderer go."""
        self._stage.close()


def _put(picture: Picture, pane: Pane, part: Picture) -> None:
    picture[pane.top : pane.top + pane.height, pane.left : pane.left + pane.width] = part
