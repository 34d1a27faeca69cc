"""What only the judge knows, in the browser: which thing the target is, and the ring within which success lies."""

from typing import Any

import viser

from dronecats.report.kit import palette
from dronecats.view.live.moment import JudgeMoment
from dronecats.view.scene import display
from episodes.maps.scene import Scene
from foundation.frames import Vec3
from foundation.protocol import RADIUS_M
from foundation.terrain import FLAT

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
