"""Parts of a flight's scene: trails, the objects that the record adds to the map, and the judge's marks."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import viser

from dronecats.report.kit import palette
from dronecats.view.live.moment import JudgeMoment
from dronecats.view.scene import display
from episodes.maps.scene import Moved, Scene
from foundation.frames import Vec3
from foundation.protocol import RADIUS_M
from foundation.terrain import FLAT

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


class AddedThings:
    """Nothing that is sent of them tells which one the target is."""

    def __init__(self, server: viser.ViserServer, node: str, scene: Scene | None) -> None:
        """Take a world's scene with what its record has added; None: there is nothing to show."""
        self._server, self._node = server, node
        base = scene.base if scene is not None else None
        on_map = {one.id for one in base.instances} if base else set()
        self._things = tuple(one for one in scene.instances if one.id not in on_map) if scene and base else ()
        self._nodes: dict[int, Any] = {}

    def show(self, moved: Moved) -> None:
        """Show them as they stand, those that move where they are now."""
        for one in self._things:
            if one.id not in self._nodes:
                self._nodes[one.id] = self._server.scene.add_glb(
                    f"{self._node}/{one.id}",
                    display.thing_glb(one.mesh),
                    position=display.place_of(one.position_ned),
                    wxyz=display.turned_to(one.turned),
                    cast_shadow=False,
                    receive_shadow=False,
                )
            if (pose := moved.get(one.id)) is not None:
                node = self._nodes[one.id]
                node.position, node.wxyz = display.place_of(pose[0]), display.turned_to(pose[1])

    def remove(self) -> None:
        """Take them away."""
        for node in self._nodes.values():
            node.remove()
        self._nodes = {}


JUDGE = palette.rgb(palette.MARKS["goal"])


class JudgedMarks:
    """Nothing of them is sent before `show`, and nothing is left after `remove`."""

    def __init__(self, server: viser.ViserServer, node: str, scene: Scene | None) -> None:
        """Take a world's scene, on whose ground the ring lies; None: the ground is flat."""
        self._server, self._node = server, node
        self._terrain = scene.terrain if scene is not None else FLAT
        self._nodes: dict[str, Any] = {}
        self._told: Vec3 | None = None  # where they are: m, NED

    def show(self, judge: JudgeMoment) -> None:
        """Draw the ring on the ground around the target and its name above it, both as the judge's."""
        centre = judge.target_ned
        if centre is None or centre == self._told:
            return
        self._told = centre
        points = display.ring(self._terrain, centre[:2], RADIUS_M)
        above = display.place_of((centre[0], centre[1], centre[2] - 1.8))
        if (known := self._nodes.get("ring")) is None:
            scene = self._server.scene
            self._nodes["ring"] = scene.add_line_segments(
                f"{self._node}/ring", points, JUDGE, thickness=3.0, thickness_units="screen"
            )
            self._nodes["name"] = scene.add_label(
                f"{self._node}/name", "target (judge)", position=above, anchor="bottom-center"
            )
            return
        known.points = points
        self._nodes["name"].position = above

    def remove(self) -> None:
        """Take them away."""
        for node in self._nodes.values():
            node.remove()
        self._nodes, self._told = {}, None
