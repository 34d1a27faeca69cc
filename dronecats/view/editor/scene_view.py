"""The map in 3-D with everything on it that can be dragged."""

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import viser

from dronecats.report.kit import palette
from dronecats.view.editor.assessment import PREVIEW
from dronecats.view.editor.draft import Draft, Drafting
from dronecats.view.scene import display
from episodes.authoring.check.finding import OF_OTHER_MAPS, RULES
from episodes.maps.assets.materials import PAINTS
from episodes.world.target import motion
from foundation.frames import Vec3
from foundation.protocol import RADIUS_M

LINE, PATH = (palette.rgb(palette.MARKS[name]) for name in ("goal", "path"))
RULER = (255, 255, 255)


class Hands(Protocol):
    """What the view calls when something was moved, with the name of the thing and where it is now."""

    def moved(self, thing: str, north: float, east: float, yaw_deg: float) -> None:
        """`thing` is 'target', 'waypoint-2', 'drone-0' or 'candidate-1'."""

    def let_go(self) -> None:
        """The drag is over."""


@dataclass(slots=True)
class _Gizmo:
    handle: Any
    look: object  # another one needs another shape
    shape: Any


class SceneView:
    """Shows drafts of one map; what it is told twice it sends once."""

    def __init__(self, server: viser.ViserServer, drafting: Drafting, hands: Hands) -> None:
        """Send the map to the browser."""
        self._server = server
        self._drafting = drafting
        self._hands = hands
        self._gizmos: dict[str, _Gizmo] = {}
        self._frustums: dict[int, Any] = {}
        self._held = ""
        self._lines: dict[str, tuple[object, Any]] = {}
        display.light(server, drafting.scene.sun)
        server.scene.add_glb("/map", display.map_glb(drafting.scene), cast_shadow=False, receive_shadow=False)
        self.look_at_start()

    def look_at_start(self) -> None:
        """Put the view of browsers that come behind and above the map's free place, looking north."""
        north, east, down = self._drafting.scene.spawn_ned
        view = self._server.initial_camera
        view.up = (0.0, 1.0, 0.0)
        view.position = display.place_of((north - 16.0, east - 7.0, down - 11.0))
        view.look_at = display.place_of((north + 9.0, east, down))

    def frame(self, draft: Draft) -> None:
        """Put the view of browsers that come so that the first drone and the target are in it."""
        here, goal = np.array(draft.record.starts[0].position_ned), np.array(self._drafting.centre(draft.record))
        away, span = here - goal, max(float(np.linalg.norm((here - goal)[:2])), 6.0)
        back = away[:2] / max(float(np.linalg.norm(away[:2])), 1e-6)
        aside = np.array([-back[1], back[0]])
        eye = here[:2] + back * 0.42 * span + aside * 0.38 * span
        view = self._server.initial_camera
        view.position = display.place_of((float(eye[0]), float(eye[1]), float(here[2]) - 0.42 * span - 2.0))
        middle = goal * 0.62 + here * 0.38
        view.look_at = display.place_of((float(middle[0]), float(middle[1]), float(middle[2])))

    def show(self, draft: Draft) -> None:
        """Bring the browser up to a draft; what is being dragged stays in the hand."""
        with self._server.atomic():
            wanted = self._things(draft)
            for name in [name for name in self._gizmos if name not in wanted]:
                self._drop(name)
            for name, (place, yaw, look, make) in wanted.items():
                self._place(name, place, yaw, look, make)
            self._show_lines(draft)
        self._server.flush()

    def show_view(self, drone: int, picture: Any) -> None:
        """Put the picture of a drone's camera into its frustum."""
        if drone in self._frustums:
            self._frustums[drone].image = picture[::2, ::2]

    def _things(self, draft: Draft) -> dict[str, tuple[Vec3, float, object, Callable[[str], Any]]]:
        """Return name → (place, yaw, look, what adds its shape under a node)."""
        record = draft.record
        found: dict[str, tuple[Vec3, float, object, Callable[[str], Any]]] = {}
        for k, one in enumerate((record.target, *record.candidates)):
            if one.native is not None:
                continue
            place, yaw = motion(one).pose(0.0)
            look = ("thing", one.asset, one.paint, one.inscription)
            mesh = self._drafting.mesh(one)

            def body(node: str, mesh: Any = mesh) -> Any:
                return self._server.scene.add_glb(
                    f"{node}/body", display.thing_glb(mesh), cast_shadow=False, receive_shadow=False
                )

            found["target" if k == 0 else f"candidate-{k}"] = (place, yaw, look, body)
        for k, (north, east) in enumerate(draft.knots[1:], 1):
            place = self._drafting.on_ground(north, east)
            found[f"waypoint-{k}"] = (place, 0.0, ("waypoint",), self._bead)
        for k, start in enumerate(record.starts):

            def drone(node: str, k: int = k) -> Any:
                return self._drone(node, k)

            found[f"drone-{k}"] = (start.position_ned, math.radians(start.yaw_deg), ("drone", k), drone)
        return found

    def _bead(self, node: str) -> Any:
        return self._server.scene.add_icosphere(f"{node}/bead", 0.22, PATH)

    def _drone(self, node: str, which: int) -> Any:
        color = palette.DRONES[which % len(palette.DRONES)]
        mesh = display.thing_glb(display.drone_mesh(palette.linear(color)))
        body = self._server.scene.add_glb(f"{node}/body", mesh, scale=1.8, cast_shadow=False, receive_shadow=False)
        self._frustums[which] = self._server.scene.add_camera_frustum(
            f"{node}/camera",
            fov=2.0 * math.atan(PREVIEW.height / 2.0 / PREVIEW.focal_px),
            aspect=PREVIEW.width / PREVIEW.height,
            scale=1.1,
            color=palette.rgb(color),
            wxyz=(0.0, 1.0, 0.0, 0.0),  # its axes are right, down, ahead
            position=(PREVIEW.offset_frd[1], -PREVIEW.offset_frd[2], -PREVIEW.offset_frd[0]),
        )
        self._server.scene.add_label(
            f"{node}/name", f"drone {which + 1}", position=(0.0, 0.55, 0.0), anchor="bottom-center"
        )
        return body

    def _place(self, name: str, place: Vec3, yaw: float, look: object, make: Callable[[str], Any]) -> None:
        known = self._gizmos.get(name)
        if known is None:
            waypoint = name.startswith("waypoint")
            handle = self._server.scene.add_transform_controls(
                f"/edit/{name}",
                scale=1.2 if waypoint else 1.7 if name.startswith("drone") else 3.2,
                line_width=3.0,
                active_axes=(True, False, True),
                disable_rotations=waypoint,
                depth_test=False,
                position=display.place_of(place),
                wxyz=display.wxyz_of(yaw),
            )

            async def dragged(event: Any) -> None:  # async: one after the other, in the order in which they came
                self._dragged(name, event)

            handle.on_update(dragged)
            self._gizmos[name] = _Gizmo(handle, look, make(f"/edit/{name}"))
            return
        if known.look != look:
            known.shape.remove()
            known.shape, known.look = make(f"/edit/{name}"), look
        if name != self._held:
            known.handle.position = display.place_of(place)
            known.handle.wxyz = display.wxyz_of(yaw)

    def _drop(self, name: str) -> None:
        self._gizmos.pop(name).handle.remove()
        if name.startswith("drone-"):
            self._frustums.pop(int(name.removeprefix("drone-")), None)

    def _dragged(self, name: str, event: Any) -> None:
        if event.phase == "start":
            self._held = name
            return
        if event.phase == "end":
            self._held = ""
            self._hands.let_go()
            return
        north, east, _ = display.ned_of(event.target.position)
        self._hands.moved(name, north, east, math.degrees(display.yaw_of(event.target.wxyz)))

    def _show_lines(self, draft: Draft) -> None:
        record, terrain = draft.record, self._drafting.scene.terrain
        centre, here = self._drafting.centre(record), record.starts[0].position_ned
        self._line("success", (centre[:2],), LINE, lambda: display.ring(terrain, centre[:2], RADIUS_M), 3.0)
        low, high = RULES.get(record.map, OF_OTHER_MAPS).start_distance_m
        radii = () if record.cell == "commanding" or high > 60.0 else (low, high)
        for k in range(2):
            far = radii[k] if radii else 0.0

            def circle(far: float = far) -> Any:
                return display.ring(terrain, centre[:2], far)

            key = (centre[:2], far)
            self._line(f"distance-{k}", key, RULER, circle, 1.5, far > 0.0)
        sight = np.array([[display.place_of(here), display.place_of(centre)]])
        self._line("sight", (here, centre), LINE, lambda: sight, 2.0)
        path = record.target.path
        points = [display.place_of((n, e, d - 0.12)) for n, e, d in path.waypoints_ned] if path else []
        legs = np.array([[a, b] for a, b in itertools.pairwise(points)])
        self._line("path", tuple(points), PATH, lambda: legs, 5.0, bool(points))
        color = PAINTS.get(record.target.paint or "", (255, 255, 255))
        name = record.target.native or f"{record.target.paint} {record.target.asset}"
        above = (centre[0], centre[1], 2.0 * centre[2] - terrain.at(centre[0], centre[1]) - 0.5)
        self._label("target-name", (name, above, color), name, above)

    def _line(
        self,
        name: str,
        key: object,
        color: tuple[int, int, int],
        points: Callable[[], Any],
        width: float,
        shown: bool = True,
    ) -> None:
        """Draw a line anew when its key has changed."""
        known = self._lines.get(name)
        if known is not None and known[0] == (key, shown):
            return
        if known is not None:
            known[1].remove()
            del self._lines[name]
        if shown:
            handle = self._server.scene.add_line_segments(
                f"/lines/{name}", points(), color, thickness=width, thickness_units="screen"
            )
            self._lines[name] = ((key, shown), handle)

    def _label(self, name: str, key: object, text: str, place: Vec3) -> None:
        known = self._lines.get(name)
        if known is not None and known[0] == key:
            return
        if known is not None:
            known[1].remove()
        handle = self._server.scene.add_label(
            f"/lines/{name}", text, position=display.place_of(place), anchor="bottom-center"
        )
        self._lines[name] = (key, handle)
