"""What only the judge knows, in the browser: the target, its look-alikes, and the ring within which success lies."""

import math
from typing import Any

import viser

from dronecats.scenery import display
from dronecats.watch.moment import JudgeMoment
from episodes.scene import Instance, Scene
from foundation.frames import Vec3
from foundation.protocol import RADIUS_M
from foundation.terrain import FLAT

JUDGE = (255, 107, 53)
TARGET = "target"  # the name of a placed target in a world's scene


class JudgedThings:
    """Nothing of them is sent before `show`, and nothing is left after `remove`."""

    def __init__(self, server: viser.ViserServer, node: str, scene: Scene | None) -> None:
        """Take a world's scene with what its record has added; None: what is known is where the target is."""
        self._server, self._node, self._scene = server, node, scene
        base = scene.base if scene is not None else None
        on_map = {one.id for one in base.instances} if base else set()
        self._things = tuple(one for one in scene.instances if one.id not in on_map) if scene and base else ()
        self._nodes: dict[str, Any] = {}
        self._told: object = None

    def show(self, judge: JudgeMoment) -> None:
        """Show them as they stand."""
        if not self._nodes:
            for one in self._things:
                self._add(one)
        if judge.target_ned is None or self._told == (judge.target_ned, judge.target_yaw):
            return
        self._told = (judge.target_ned, judge.target_yaw)
        target = next((one for one in self._things if one.name == TARGET), None)
        if target is not None:
            node = self._nodes[TARGET]
            node.position = display.place_of(_origin(target, judge.target_ned, judge.target_yaw))
            node.wxyz = display.wxyz_of(judge.target_yaw)
        self._mark(judge.target_ned)

    def remove(self) -> None:
        """Take them away."""
        for node in self._nodes.values():
            node.remove()
        self._nodes, self._told = {}, None

    def _add(self, one: Instance) -> None:
        self._nodes[one.name] = self._server.scene.add_glb(
            f"{self._node}/{one.name}",
            display.thing_glb(one.mesh),
            position=display.place_of(one.position_ned),
            wxyz=display.wxyz_of(one.yaw),
            cast_shadow=False,
            receive_shadow=False,
        )

    def _mark(self, centre: Vec3) -> None:
        """Draw the ring on the ground around the target and its name above it, both as the judge's."""
        terrain = self._scene.terrain if self._scene is not None else FLAT
        points = display.ring(terrain, centre[:2], RADIUS_M)
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


def _origin(one: Instance, centre: Vec3, yaw: float) -> Vec3:
    """Return where the origin (m, NED) of a thing is whose box has its centre there."""
    low, high = one.mesh.vertices.min(axis=0), one.mesh.vertices.max(axis=0)
    x, y, z = (float(v) for v in (high + low) / 2)
    c, s = math.cos(yaw), math.sin(yaw)
    return (centre[0] - c * x + s * y, centre[1] - s * x - c * y, centre[2] - z)
