"""What a record adds to its map, in the browser: the target and its look-alikes as pictures show them, unmarked."""

from typing import Any

import viser

from dronecats.view.scene import display
from episodes.maps.scene import Moved, Scene


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
