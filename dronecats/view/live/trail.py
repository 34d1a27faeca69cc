"""Where a drone has been, as a line in the browser that grows at its end alone."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import viser

from dronecats.view.scene import display
from foundation.frames import Vec3

STEP_M = 0.15  # between two places of the line
PIECE = 64  # places; a piece that is full is never sent again


class Trail:
    """One line."""

    def __init__(self, server: viser.ViserServer, node: str, color: tuple[int, int, int]) -> None:
        self._server, self._node, self._color = server, node, color
        self._pieces: list[Any] = []
        self._points: list[tuple[float, float, float]] = []  # of the piece that grows

    def go_on(self, place_ned: Vec3) -> None:
        """Lead the line on to a place (m, NED), if that is far enough to be seen."""
        point = display.place_of(place_ned)
        if self._points and float(np.hypot.reduce(np.subtract(point, self._points[-1]))) < STEP_M:
            return
        self._points.append(point)
        if len(self._points) == 2:
            self._pieces.append(self._piece(self._points))
        elif len(self._points) > 2:
            self._pieces[-1].points = _segments(self._points)
            if len(self._points) > PIECE:
                self._points = [point]

    def set(self, places_ned: Sequence[Vec3]) -> None:
        """Have the line lead through these places (m, NED) and no other."""
        points = [display.place_of(place) for place in places_ned]
        self.clear()
        for first in range(0, max(0, len(points) - 1), PIECE):
            self._pieces.append(self._piece(points[first : first + PIECE + 1]))
        self._points = points[-1:]

    def clear(self) -> None:
        """Take the line away."""
        for piece in self._pieces:
            piece.remove()
        self._pieces, self._points = [], []

    def _piece(self, points: Sequence[tuple[float, float, float]]) -> Any:
        return self._server.scene.add_line_segments(
            f"{self._node}/{len(self._pieces)}", _segments(points), self._color, thickness=3.0, thickness_units="screen"
        )


def _segments(points: Sequence[tuple[float, float, float]]) -> Any:
    line = np.array(points, np.float32)
    return np.stack([line[:-1], line[1:]], axis=1)
