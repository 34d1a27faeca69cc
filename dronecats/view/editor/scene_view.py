"""The 3-D view of the editor: the map and the objects that can be dragged."""

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import viser

from dronecats.report.kit import palette
from dronecats.view.editor.assessment import PREVIEW
from dronecats.view.editor.draft import Draft, Drafting
from dronecats.view.scene import display
from episodes.authoring.check.finding import DEFAULT_RULES, RULES
from episodes.maps.scene import Mesh
from episodes.world.target import motion
from foundation.frames import Vec3, vec3
from foundation.protocol import RADIUS_M
from foundation.run_folder.rows import drone_label

LINE, PATH = (palette.rgb(palette.MARKS[name]) for name in ("goal", "path"))
RULER = (255, 255, 255)


# called during a drag with (name, north, east, yaw in °); example names: 'target', 'waypoint-2', 'drone-0'
OnMove = Callable[[str, float, float, float], None]


@dataclass(frozen=True, slots=True)
class _Object:
    """An object of a draft that can be dragged."""

    place: Vec3  # m, NED
    yaw: float  # rad
    look: object  # key of the appearance; a new key rebuilds the shape
    add: Callable[[str], object]  # adds the shape under the node with this path


class SceneView:
    """Shows drafts of one map, and sends only changes to the browser."""

    def __init__(
        self, server: viser.ViserServer, drafting: Drafting, on_move: OnMove, on_release: Callable[[], None]
    ) -> None:
        """Send the map to the browser. `on_release` is called at the end of a drag."""
        self._server = server
        self._drafting = drafting
        self._on_move, self._on_release = on_move, on_release
        self._gizmos = display.SceneNodes(server, "/edit")
        self._looks: dict[str, object] = {}  # name of an object → look of its shape
        self._frustums: dict[int, Any] = {}
        self._held = ""  # name of the dragged object; "": none
        self._lines = display.SceneNodes(server, "/lines")
        display.light(server, drafting.scene.sun)
        display.add_glb(server, "/map", display.map_glb(drafting.scene))

    def frame(self, draft: Draft) -> None:
        """Set the initial view of browsers. The first drone and the target are in this view."""
        here, goal = np.array(draft.record.starts[0].position_ned), np.array(self._drafting.centre(draft.record))
        away, span = here - goal, max(float(np.linalg.norm((here - goal)[:2])), 6.0)
        back = away[:2] / max(float(np.linalg.norm(away[:2])), 1e-6)
        aside = np.array([-back[1], back[0]])
        eye = here[:2] + back * 0.42 * span + aside * 0.38 * span
        view = self._server.initial_camera
        view.up = (0.0, 1.0, 0.0)
        view.position = display.place_of(vec3((*eye, here[2] - 0.42 * span - 2.0)))
        view.look_at = display.place_of(vec3(goal * 0.62 + here * 0.38))

    def show(self, draft: Draft) -> None:
        """Show a draft. The dragged object keeps its place in the browser."""
        with self._server.atomic():
            objects = self._objects(draft)
            for name in [name for name in self._looks if name not in objects]:
                self._drop(name)
            for name, shown in objects.items():
                self._place(name, shown)
            self._show_lines(draft)
        self._server.flush()

    def show_view(self, drone: int, picture: Any) -> None:
        """Put the picture of a drone's camera into its frustum."""
        if drone in self._frustums:
            self._frustums[drone].image = picture[::2, ::2]

    def _objects(self, draft: Draft) -> dict[str, _Object]:
        record = draft.record
        objects: dict[str, _Object] = {}
        for k, target in enumerate((record.target, *record.candidates)):
            if target.native is None:
                look = ("target", target.asset, target.paint, target.inscription)
                body = partial(self._body, mesh=self._drafting.mesh(target))
                objects["target" if k == 0 else f"candidate-{k}"] = _Object(*motion(target).pose(0.0), look, body)
        for k, (north, east) in enumerate(draft.knots[1:], 1):
            place = self._drafting.on_ground(north, east)
            objects[f"waypoint-{k}"] = _Object(place, 0.0, ("waypoint",), self._bead)
        for k, start in enumerate(record.starts):
            yaw = math.radians(start.yaw_deg)
            objects[f"drone-{k}"] = _Object(start.position_ned, yaw, ("drone", k), partial(self._drone, which=k))
        return objects

    def _body(self, node: str, mesh: Mesh) -> Any:
        return display.add_glb(self._server, f"{node}/body", display.mesh_glb(mesh))

    def _bead(self, node: str) -> Any:
        return self._server.scene.add_icosphere(f"{node}/bead", 0.22, PATH)

    def _drone(self, node: str, which: int) -> None:
        color = palette.linear(palette.DRONES[which % len(palette.DRONES)])
        _, self._frustums[which] = display.add_drone(self._server, node, color, PREVIEW, drone_label(which))

    def _place(self, name: str, shown: _Object) -> None:
        place = {"position": display.place_of(shown.place), "wxyz": display.wxyz_of(shown.yaw)}
        is_dragged = name == self._held and name in self._looks
        self._gizmos.put(name, partial(self._add_gizmo, name), **({} if is_dragged else place))
        if self._looks.get(name) != shown.look:
            shown.add(f"/edit/{name}")  # replaces the shape
            self._looks[name] = shown.look

    def _add_gizmo(self, name: str, path: str) -> Any:
        waypoint = name.startswith("waypoint")
        handle = self._server.scene.add_transform_controls(
            path,
            scale=1.2 if waypoint else 1.7 if name.startswith("drone") else 3.2,
            line_width=3.0,
            active_axes=(True, False, True),
            disable_rotations=waypoint,
            depth_test=False,
        )

        async def dragged(event: Any) -> None:  # async: viser then calls it in the order of the events
            self._dragged(name, event)

        handle.on_update(dragged)
        return handle

    def _drop(self, name: str) -> None:
        self._gizmos.drop(name)
        del self._looks[name]
        if name.startswith("drone-"):
            self._frustums.pop(int(name.removeprefix("drone-")), None)

    def _dragged(self, name: str, event: Any) -> None:
        if event.phase == "start":
            self._held = name
            return
        if event.phase == "end":
            self._held = ""
            self._on_release()
            return
        north, east, _ = display.ned_of(event.target.position)
        self._on_move(name, north, east, math.degrees(display.yaw_of(event.target.wxyz)))

    def _show_lines(self, draft: Draft) -> None:
        record, terrain = draft.record, self._drafting.scene.terrain
        centre, here = self._drafting.centre(record), record.starts[0].position_ned
        self._lines.lines("success", display.ring(terrain, centre[:2], RADIUS_M), LINE, 3.0)
        low, high = RULES.get(record.map, DEFAULT_RULES).start_distance_m
        has_radii = record.cell != "commanding" and high <= 60.0
        for k, radius_m in enumerate((low, high)):
            circle = display.ring(terrain, centre[:2], radius_m) if has_radii else ()
            self._lines.lines(f"distance-{k}", circle, RULER, 1.5)
        self._lines.lines("sight", np.array([[display.place_of(here), display.place_of(centre)]]), LINE, 2.0)
        path = record.target.path
        points = [display.place_of((n, e, d - 0.12)) for n, e, d in path.waypoints_ned] if path else []
        self._lines.lines("path", np.array(list(itertools.pairwise(points))), PATH, 5.0)
        name = record.target.native or f"{record.target.paint} {record.target.asset}"
        above = display.place_of((centre[0], centre[1], 2.0 * centre[2] - terrain.at(centre[0], centre[1]) - 0.5))
        self._lines.label("target-name", name, above)
