"""Layers of a flight's scene: trails, the target and its look-alikes, and the judge's marks."""

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

STEP_M = 0.15  # least distance between two points of a trail
PIECE = 64  # points per piece of a trail; a complete piece is not sent again
JUDGE = palette.rgb(palette.MARKS["goal"])


class Trail:
    """The trail of a drone: a line in pieces that grows. Only its last piece is sent again."""

    def __init__(self, server: viser.ViserServer, node: str, color: tuple[int, int, int]) -> None:
        self._server, self._node, self._color = server, node, color
        self._pieces: list[Any] = []
        self._points: list[tuple[float, float, float]] = []  # points of the last piece

    def extend(self, place_ned: Vec3) -> None:
        """Extend the line to a position (m, NED), unless it is closer than STEP_M to the last point."""
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
        """Replace the line by a line through these positions (m, NED)."""
        points = [display.place_of(place) for place in places_ned]
        for piece in self._pieces:
            piece.remove()
        self._pieces = []
        for first in range(0, max(0, len(points) - 1), PIECE):
            self._pieces.append(self._piece(points[first : first + PIECE + 1]))
        self._points = points[-1:]

    def _piece(self, points: Sequence[tuple[float, float, float]]) -> Any:
        node = f"{self._node}/{len(self._pieces)}"
        return display.add_lines(self._server, node, _segments(points), self._color, 3.0)


def _segments(points: Sequence[tuple[float, float, float]]) -> Any:
    line = np.array(points, np.float32)
    return np.stack([line[:-1], line[1:]], axis=1)


class AddedObjects:
    """The target and its look-alikes. The data sent to the browser do not reveal which object is the target."""

    def __init__(self, server: viser.ViserServer, node: str, scene: Scene | None) -> None:
        """`scene`: the map with the target and its look-alikes; None: there are no objects."""
        self._server, self._node = server, node
        base = scene.base if scene is not None else None
        on_map = {instance.id for instance in base.instances} if base else set()
        self._instances = tuple(i for i in scene.instances if i.id not in on_map) if scene and base else ()
        self._nodes: dict[int, Any] = {}

    def show(self, moved: Moved) -> None:
        """Show the objects. `moved`: poses of the moving objects."""
        for instance in self._instances:
            if instance.id not in self._nodes:
                self._nodes[instance.id] = display.add_glb(
                    self._server,
                    f"{self._node}/{instance.id}",
                    display.mesh_glb(instance.mesh),
                    position=display.place_of(instance.position_ned),
                    wxyz=display.wxyz_of(instance.turned),
                )
            if (pose := moved.get(instance.id)) is not None:
                node = self._nodes[instance.id]
                node.position, node.wxyz = display.place_of(pose[0]), display.wxyz_of(pose[1])

    def remove(self) -> None:
        for node in self._nodes.values():
            node.remove()
        self._nodes = {}


class JudgeMarks:
    """The marks of the judge's view. The browser has them only between `show` and `remove`."""

    def __init__(self, server: viser.ViserServer, node: str, scene: Scene | None) -> None:
        """`scene`: the world's scene, for the height of the ground; None: flat ground."""
        self._server, self._node = server, node
        self._terrain = scene.terrain if scene is not None else FLAT
        self._nodes: dict[str, Any] = {}
        self._centre: Vec3 | None = None  # m, NED, centre of the shown marks

    def show(self, judge: JudgeMoment) -> None:
        """Draw the success radius as a ring on the ground around the target, and a label above the target."""
        centre = judge.target_ned
        if centre is None or centre == self._centre:
            return
        self._centre = centre
        points = display.ring(self._terrain, centre[:2], RADIUS_M)
        above = display.place_of((centre[0], centre[1], centre[2] - 1.8))
        if not self._nodes:
            self._nodes["ring"] = display.add_lines(self._server, f"{self._node}/ring", points, JUDGE, 3.0)
            self._nodes["name"] = self._server.scene.add_label(
                f"{self._node}/name", "target (judge)", position=above, anchor="bottom-center"
            )
        else:
            self._nodes["ring"].points = points
            self._nodes["name"].position = above

    def remove(self) -> None:
        for node in self._nodes.values():
            node.remove()
        self._nodes, self._centre = {}, None
