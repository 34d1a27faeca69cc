"""Shows a flight in the browser's 3-D scene: drones, their cameras, setpoints and goals, and the judge's marks."""

import math
from collections.abc import Sequence
from functools import partial
from typing import Any

import cv2
import numpy as np
import viser

from dronecats.report.kit import palette
from dronecats.view.live.moment import DroneMoment, JudgeMoment, Moment, ShownPicture
from dronecats.view.scene import display
from episodes.maps.scene import Mesh, Moved, Scene, Sun
from foundation.camera import CameraModel
from foundation.frames import Vec3, quat_yaw, vec3
from foundation.protocol import RADIUS_M
from foundation.run_folder.rows import drone_label
from foundation.terrain import FLAT

COLORS: tuple[Vec3, ...] = tuple(map(palette.linear, palette.DRONES))
CHOSEN = palette.rgb(palette.MARKS["chosen"])  # colour of the point of a `go` action
BLOCKED_POINT = palette.rgb(palette.MARKS["declared-bad"])  # colour of the point where the map blocks the ray
SETPOINT = palette.rgb(palette.MARKS["setpoint"])
JUDGE = palette.rgb(palette.MARKS["goal"])
WORLD = "/world"  # the root node; to follow a drone, the page moves this node and keeps the view
NOON = Sun((0.3, 0.2, -0.93))
SETPOINT_M_PER_MPS = 1.5  # length of the arrow that shows a velocity setpoint
STILL_MPS = 0.05  # a slower setpoint has no arrow
GRID_M = 400.0
STEP_M = 0.15  # least distance between two points of a trail
PIECE = 64  # points per piece of a trail; a complete piece is not sent again


class Trail:
    """The trail of a drone: a growing line, divided into pieces. Only its last piece is sent again."""

    def __init__(self, server: viser.ViserServer, node: str, color: tuple[int, int, int]) -> None:
        self.pieces, self._color = display.SceneNodes(server, node), color
        self._points: list[Vec3] = []  # m, browser's axes

    def extend(self, place_ned: Vec3) -> None:
        """Extend the line to a position (m, NED), unless it is closer than STEP_M to the last point."""
        point = display.place_of(place_ned)
        if not self._points or math.dist(point, self._points[-1]) >= STEP_M:
            self._points.append(point)
            self._show(max(0, len(self._points) - 2) // PIECE)

    def set(self, places_ned: Sequence[Vec3]) -> None:
        """Replace the line by a line through these positions (m, NED)."""
        self.pieces.drop(*self.pieces.names)
        self._points = [display.place_of(place) for place in places_ned]
        for piece in range(math.ceil((len(self._points) - 1) / PIECE)):
            self._show(piece)

    def _show(self, piece: int) -> None:
        points = np.array(self._points[piece * PIECE : (piece + 1) * PIECE + 1], np.float32)
        self.pieces.lines(str(piece), np.stack([points[:-1], points[1:]], axis=1), self._color, 3.0)


class FlightScene:
    """Shows one flight, moment by moment, and sends only changes.

    Several instances with different names may share a server. The first one adds the map and the light.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        scene: Scene | None,
        *,
        drones: int = 1,
        name: str = "",
        colors: Sequence[Vec3] = COLORS,
        camera: CameraModel | None = None,
    ) -> None:
        """Send the map of a scene, or a plain grid if `scene` is None.

        `name`: distinguishes the flights on one server; `colors`: linear RGB, 0 … 1, one per drone.
        """
        self._server, self._scene = server, scene
        self._camera = camera or CameraModel()
        self._name, self._root = name, f"{WORLD}/{name or 'flight'}"
        self._nodes = display.SceneNodes(server, self._root)
        self._frustums: dict[int, Any] = {}  # drone → its camera
        self._pictures: dict[int, int] = {}  # drone → frame id of its shown picture
        self._followed: int | None = None
        self._anchor: Vec3 | None = None  # place at which the page keeps the followed drone (m, browser's axes)
        self._picker: display.Picker | None = None
        self._view_is_set = False
        self._brought: set[int] = set()  # ids of browsers whose view was moved to the flight
        self.shows_objects = True  # whether to show target and look-alikes; only one of several flights shows them
        self.judge_shown = False  # whether to send and show the judge's marks
        base = None if scene is None else scene.base or scene
        on_map = {instance.id for instance in base.instances} if base else set()
        self._added = [instance for instance in (scene.instances if scene else ()) if instance.id not in on_map]
        if server.scene.get_handle_by_name(WORLD) is None:
            server.scene.add_frame(WORLD, show_axes=False)
            display.light(server, base.sun if base else NOON)
            self._ground(base)
        server.scene.add_frame(self._root, show_axes=False)
        self._colors = [colors[k % len(colors)] for k in range(drones)]
        shades = map(palette.shade, self._colors)
        self._trails = [Trail(server, f"{self._root}/trail-{k}", shade) for k, shade in enumerate(shades)]

    @property
    def offset(self) -> Vec3:
        """The displacement of the world that keeps a followed drone in place (m, browser's axes)."""
        return vec3(self._world.position)

    def show(self, moment: Moment) -> None:
        with self._server.atomic():
            if self._followed is not None:
                self._keep_up(moment.drones)
            for drone in moment.drones:
                if drone.position_ned is not None and drone.drone < len(self._trails):
                    self._show_drone(drone, drone.position_ned)
            self._show_added(moment.moved)
            self._show_judge(moment.judge)
        self._server.flush()

    def show_trail(self, drone: int, places_ned: Sequence[Vec3]) -> None:
        """Replace a drone's trail by a line through these positions (m, NED)."""
        self._trails[drone].set(places_ned)

    def follow(self, drone: int | None) -> None:
        """Keep a drone at its current place in the view; None: stop following. Users can still turn their view."""
        self._followed, self._anchor = drone, None

    def move_new_views(self, here: Vec3, yaw: float) -> None:
        """Move the view of each new browser behind a drone at a position (m, NED) and yaw (rad)."""
        clients = self._server.get_clients()
        if clients.keys() <= self._brought:
            return
        eye, seen = self._behind(here, yaw)
        for name, client in clients.items():
            if name not in self._brought:
                client.camera.position, client.camera.look_at = eye, seen  # in this order: `position` changes `look_at`
        self._brought |= clients.keys()

    def remove(self) -> None:
        """Remove the flight from the browser. The map stays for other flights."""
        self._server.scene.remove_by_name(self._root)

    # ---- the ground

    @property
    def _world(self) -> Any:
        return self._server.scene.get_handle_by_name(WORLD)

    def _ground(self, base: Scene | None) -> None:
        if base is None:
            self._server.scene.add_grid(
                f"{WORLD}/map", GRID_M, GRID_M, plane="xz", cell_size=1.0, section_size=10.0,
                cell_color=(190, 196, 203), section_color=(120, 130, 140), fade_distance=GRID_M,
                plane_color=(226, 230, 233), plane_opacity=0.6,
            )  # fmt: skip
            return
        display.add_glb(self._server, f"{WORLD}/map", display.map_glb(base))

    # ---- a drone

    def _show_drone(self, drone: DroneMoment, here: Vec3) -> None:
        k = drone.drone
        self._nodes.put(f"drone-{k}", partial(self._add_drone, k), position=display.place_of(here),
                        wxyz=display.wxyz_of(drone.attitude))  # fmt: skip
        if not self._view_is_set:
            self._look(here, quat_yaw(drone.attitude))
        self._trails[k].extend(here)
        self._show_setpoint(f"setpoint-{k}", here, drone.setpoint_ned)
        self._show_chosen(k, drone.lens_ned, drone.chosen_ned)
        self._show_picture(k, drone.picture)

    def _add_drone(self, k: int, path: str) -> Any:
        label = " · ".join(filter(None, (self._name, drone_label(k) if len(self._trails) > 1 else "")))
        node = self._server.scene.add_frame(path, show_axes=False)
        _, self._frustums[k] = display.add_drone(self._server, path, self._colors[k], self._camera, label)
        return node

    def _show_setpoint(self, name: str, here: Vec3, velocity: Vec3 | None) -> None:
        if velocity is None or math.hypot(*velocity) < STILL_MPS:
            self._nodes.drop(name)
            return
        n, e, d = velocity
        ahead = display.place_of((SETPOINT_M_PER_MPS * n, SETPOINT_M_PER_MPS * e, SETPOINT_M_PER_MPS * d))
        points = np.array([[(0.0, 0.0, 0.0), ahead]], np.float32)
        add = partial(self._server.scene.add_arrows, points=points, colors=SETPOINT, shaft_radius=0.05,
                      head_radius=0.13, head_length=0.3)  # fmt: skip
        self._nodes.put(name, add, points=points, position=display.place_of(here))

    def _show_chosen(self, k: int, lens: Vec3 | None, place: Vec3 | None) -> None:
        if lens is None or place is None:
            self._nodes.drop(f"chosen-{k}", f"place-{k}", f"met-{k}")
            return
        points = np.array([[display.place_of(lens), display.place_of(place)]], np.float32)
        self._nodes.lines(f"chosen-{k}", points, CHOSEN, 2.5)
        self._show_sphere(f"place-{k}", 0.2, CHOSEN, place)
        self._show_sphere(f"met-{k}", 0.16, BLOCKED_POINT, self._blocked_point(lens, place))

    def _show_sphere(self, name: str, radius_m: float, color: tuple[int, int, int], place: Vec3 | None) -> None:
        if place is None:
            self._nodes.drop(name)
            return
        add = partial(self._server.scene.add_icosphere, radius=radius_m, color=color, cast_shadow=False)
        self._nodes.put(name, add, position=display.place_of(place))

    def _blocked_point(self, lens: Vec3, place: Vec3) -> Vec3 | None:
        """Return the point (m, NED) where the map blocks the ray from lens to place; None if the ray is free."""
        if self._scene is None:
            return None
        if self._picker is None:
            self._picker = display.Picker(self._scene.base or self._scene)
        n, e, d = (b - a for a, b in zip(lens, place, strict=True))
        far = math.hypot(n, e, d)
        hit = self._picker.pick(lens, (n, e, d)) if far > 0.0 else None
        return hit[0] if hit is not None and math.dist(lens, hit[0]) < far - 0.05 else None

    def _show_picture(self, k: int, picture: ShownPicture | None) -> None:
        if picture is None or self._pictures.get(k) == picture.frame_id:
            return
        self._pictures[k] = picture.frame_id
        small = cv2.imdecode(np.frombuffer(picture.jpeg, np.uint8), cv2.IMREAD_REDUCED_COLOR_4)
        if small is not None:  # None: the picture is damaged
            self._frustums[k].image = np.ascontiguousarray(small[..., ::-1])

    # ---- the layers

    def _show_added(self, moved: Moved) -> None:
        """Show the target and its look-alikes. The data sent to the browser do not reveal which is the target."""
        for instance in self._added:
            name = f"thing/{instance.id}"
            if not self.shows_objects:
                self._nodes.drop(name)
                continue
            place, turned = moved.get(instance.id) or (instance.position_ned, instance.turned)
            self._nodes.put(name, partial(self._add_object, instance.mesh), position=display.place_of(place),
                            wxyz=display.wxyz_of(turned))  # fmt: skip

    def _add_object(self, mesh: Mesh, path: str) -> Any:
        return display.add_glb(self._server, path, display.mesh_glb(mesh))

    def _show_judge(self, judge: JudgeMoment) -> None:
        """Show the success radius as a ring around the target, and a label. Without the judge's view, remove both."""
        if not self.judge_shown:
            self._nodes.drop("judge/ring", "judge/name")
        elif (centre := judge.target_ned) is not None:
            terrain = self._scene.terrain if self._scene else FLAT
            self._nodes.lines("judge/ring", display.ring(terrain, centre[:2], RADIUS_M), JUDGE, 3.0)
            above = display.place_of((centre[0], centre[1], centre[2] - 1.8))
            self._nodes.label("judge/name", "target (judge)", above)

    # ---- the view

    def _look(self, here: Vec3, yaw: float) -> None:
        """Set the initial view of browsers to a place behind and above a drone."""
        self._view_is_set = True
        view = self._server.initial_camera
        view.up = (0.0, 1.0, 0.0)
        view.position, view.look_at = self._behind(here, yaw)

    def _behind(self, here: Vec3, yaw: float) -> tuple[Vec3, Vec3]:
        """Return a place behind and above a drone, and the point to look at (m, browser's axes)."""
        c, s = math.cos(yaw), math.sin(yaw)
        eye = display.place_of((here[0] - 9.0 * c + 3.0 * s, here[1] - 9.0 * s - 3.0 * c, here[2] - 4.5))
        seen = display.place_of((here[0] + 5.0 * c, here[1] + 5.0 * s, here[2] + 0.5))
        x, y, z = self.offset  # not zero if a drone is followed
        return (eye[0] + x, eye[1] + y, eye[2] + z), (seen[0] + x, seen[1] + y, seen[2] + z)

    def _keep_up(self, drones: Sequence[DroneMoment]) -> None:
        """Move the world so that the followed drone stays at its place in the browser."""
        here = next((drone.position_ned for drone in drones if drone.drone == self._followed), None)
        if here is None:
            return
        x, y, z = display.place_of(here)
        anchor = self._anchor  # read once, because `follow` resets it from another thread
        if anchor is None:
            a, b, c = self.offset
            anchor = self._anchor = (a + x, b + y, c + z)
        self._world.position = (anchor[0] - x, anchor[1] - y, anchor[2] - z)
