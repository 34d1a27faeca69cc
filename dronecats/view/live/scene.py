"""One flight in the browser's world: what flies, what it looks at and is told, and what only the judge knows."""

import math
from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
import viser

from dronecats.report.kit import palette
from dronecats.view.live.layers import AddedThings, JudgedMarks, Trail
from dronecats.view.live.moment import DroneMoment, JudgeMoment, Moment, ShownPicture
from dronecats.view.scene import display
from episodes.maps.scene import Moved, Scene, Sun
from foundation.camera import CameraModel
from foundation.frames import Vec3, quat_yaw
from foundation.run_folder.rows import drone_label

COLORS: tuple[Vec3, ...] = tuple(map(palette.linear, palette.DRONES))
CHOSEN = palette.rgb(palette.MARKS["chosen"])  # the place of a go
MET = palette.rgb(palette.MARKS["declared-bad"])  # what is in its way
TOLD = palette.rgb(palette.MARKS["setpoint"])
WORLD = "/world"  # the node under which everything is: it is moved, not the view, where somebody is followed
NOON = Sun((0.3, 0.2, -0.93))
DRONE_SCALE = 1.8  # a drone is drawn larger than it is, to be seen from where the map is seen
TOLD_M_PER_MPS = 1.5  # length of a setpoint's arrow
STILL_MPS = 0.05  # below it a setpoint is no arrow
GRID_M = 400.0


class FlightScene:
    """Shows one flight, moment by moment; what it is told twice it sends once.

    Several may share a server, by different names: the first brings the map and the light, each its own drones.
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
        """Send the map of a scene, or a plain grid where none is known. What a record has added comes with `show`.

        `name` tells one flight from others in the same browser; `colors` are linear RGB, 0 … 1, one of each drone.
        """
        self._server, self._scene = server, scene
        self._camera = camera or CameraModel()
        self._name, self._root = name, f"{WORLD}/{name or 'flight'}"
        self._nodes: dict[str, Any] = {}
        self._told: dict[str, object] = {}  # what a node shows
        self._added = AddedThings(server, f"{self._root}/thing", scene)
        self._judged = JudgedMarks(server, f"{self._root}/judge", scene)
        self._followed: int | None = None
        self._picker: display.Picker | None = None
        self._looked = False
        self._brought: set[int] = set()  # browsers that have been shown where the flight is
        self.things_shown = True  # of several flights over one another, by one
        self.judge_shown = False  # what only the judge knows is not even sent before it is
        base = None if scene is None else scene.base or scene
        if server.scene.get_handle_by_name(WORLD) is None:
            server.scene.add_frame(WORLD, show_axes=False)
            display.light(server, base.sun if base else NOON)
            self._ground(base)
        server.scene.add_frame(self._root, show_axes=False)
        shades = [colors[k % len(colors)] for k in range(drones)]
        self._shades = [palette.shade(color) for color in shades]
        self._trails = [Trail(server, f"{self._root}/trail-{k}", shade) for k, shade in enumerate(self._shades)]
        self._meshes = [display.drone_mesh(color) for color in shades]

    @property
    def offset(self) -> tuple[float, float, float]:
        """How far the world is moved in the browser so that somebody is followed: m, the browser's axes."""
        x, y, z = (float(v) for v in self._world.position)
        return (x, y, z)

    def show(self, moment: Moment) -> None:
        """Bring the browser up to a moment."""
        with self._server.atomic():
            if self._followed is not None:
                self._keep_up(moment.drones)
            for drone in moment.drones:
                if drone.position_ned is not None and drone.drone < len(self._trails):
                    self._show_drone(drone, drone.position_ned)
            self._show_added(moment.moved)
            self._show_judge(moment.judge)
        self._server.flush()

    def clear_trail(self) -> None:
        """Forget where everybody has been."""
        for trail in self._trails:
            trail.clear()

    def show_trail(self, drone: int, places_ned: Sequence[Vec3]) -> None:
        """Have a drone's trail lead through these places (m, NED), whatever it was before."""
        self._trails[drone].set(places_ned)

    def follow(self, drone: int | None) -> None:
        """Have the view go with a drone from where it is now, or with nobody; it can be turned all the while."""
        self._followed = drone
        self._told.pop("followed", None)

    def bring(self, here: Vec3, yaw: float) -> None:
        """Put every browser that has not been brought to this flight yet behind such a drone: m NED, rad."""
        clients = self._server.get_clients()
        if clients.keys() <= self._brought:
            return
        eye, seen = self._behind(here, yaw)
        for name, client in clients.items():
            if name not in self._brought:
                client.camera.position, client.camera.look_at = eye, seen  # in this order: the first moves both
        self._brought |= clients.keys()

    def remove(self) -> None:
        """Take the flight out of the browser; the map stays for others."""
        self._added.remove()
        self._judged.remove()
        self._server.scene.remove_by_name(self._root)
        self._nodes.clear()
        self._told.clear()

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
        glb = display.map_glb(base)
        self._server.scene.add_glb(f"{WORLD}/map", glb, cast_shadow=False, receive_shadow=False)

    # ---- a drone

    def _show_drone(self, drone: DroneMoment, here: Vec3) -> None:
        k = drone.drone
        node = self._node(k)
        node.position, node.wxyz = display.place_of(here), display.turned(drone.attitude)  # the same is not sent again
        if not self._looked:
            self._look(here, quat_yaw(drone.attitude))
        self._trails[k].go_on(here)
        self._show_told(k, here, drone.setpoint_ned)
        self._show_chosen(k, drone.lens_ned, drone.chosen_ned)
        self._show_picture(k, drone.picture)

    def _node(self, k: int) -> Any:
        """Return the node of a drone, made when it is first seen."""
        path = f"{self._root}/drone-{k}"
        if (known := self._nodes.get(f"drone-{k}")) is not None:
            return known
        scene, lens = self._server.scene, self._camera
        made = self._nodes[f"drone-{k}"] = scene.add_frame(path, show_axes=False)
        glb = display.thing_glb(self._meshes[k])
        scene.add_glb(f"{path}/body", glb, scale=DRONE_SCALE, cast_shadow=False, receive_shadow=False)
        self._nodes[f"camera-{k}"] = scene.add_camera_frustum(
            f"{path}/camera",
            fov=2.0 * math.atan(lens.height / 2.0 / lens.focal_px),
            aspect=lens.width / lens.height,
            scale=1.1,
            color=self._shades[k],
            wxyz=(0.0, 1.0, 0.0, 0.0),  # its axes are right, down, ahead
            position=(lens.offset_frd[1], -lens.offset_frd[2], -lens.offset_frd[0]),
            format="jpeg",
            cast_shadow=False,
        )
        called = " · ".join(part for part in (self._name, drone_label(k) if len(self._trails) > 1 else "") if part)
        if called:
            scene.add_label(f"{path}/name", called, position=(0.0, 0.55, 0.0), anchor="bottom-center")
        return made

    def _show_told(self, k: int, here: Vec3, velocity: Vec3 | None) -> None:
        key = f"setpoint-{k}"
        if velocity is None or math.hypot(*velocity) < STILL_MPS:
            self._drop(key)
            return
        ahead = display.place_of((TOLD_M_PER_MPS * velocity[0], TOLD_M_PER_MPS * velocity[1],
                                  TOLD_M_PER_MPS * velocity[2]))  # fmt: skip
        if self._told.get(key) != velocity:
            points = np.array([[(0.0, 0.0, 0.0), ahead]], np.float32)
            if (known := self._nodes.get(key)) is None:
                self._nodes[key] = self._server.scene.add_arrows(
                    f"{self._root}/{key}", points, TOLD, shaft_radius=0.05, head_radius=0.13, head_length=0.3
                )
            else:
                known.points = points
            self._told[key] = velocity
        self._nodes[key].position = display.place_of(here)

    def _show_chosen(self, k: int, lens: Vec3 | None, place: Vec3 | None) -> None:
        key = f"chosen-{k}"
        if lens is None or place is None:
            for name in (key, f"place-{k}", f"met-{k}"):
                self._drop(name)
            return
        if self._told.get(key) == (lens, place):
            return
        met = self._met(lens, place)
        scene, at = self._server.scene, f"{self._root}/{key}"
        points = np.array([[display.place_of(lens), display.place_of(place)]], np.float32)
        if (known := self._nodes.get(key)) is None:
            self._nodes[key] = scene.add_line_segments(at, points, CHOSEN, thickness=2.5, thickness_units="screen")
            self._nodes[f"place-{k}"] = scene.add_icosphere(
                f"{self._root}/place-{k}", 0.2, CHOSEN, position=display.place_of(place), cast_shadow=False
            )
        else:
            known.points = points
            self._nodes[f"place-{k}"].position = display.place_of(place)
        self._told[key] = (lens, place)
        self._drop(f"met-{k}")
        if met is not None:
            self._nodes[f"met-{k}"] = scene.add_icosphere(
                f"{self._root}/met-{k}", 0.16, MET, position=display.place_of(met), cast_shadow=False
            )

    def _met(self, lens: Vec3, place: Vec3) -> Vec3 | None:
        """Return where the ray meets something of the map that is nearer than the place, None where nothing is."""
        if self._scene is None:
            return None
        if self._picker is None:
            self._picker = display.Picker(self._scene.base or self._scene)
        n, e, d = (b - a for a, b in zip(lens, place, strict=True))
        far = math.hypot(n, e, d)
        hit = self._picker.pick(lens, (n, e, d)) if far > 0.0 else None
        return hit[0] if hit is not None and math.dist(lens, hit[0]) < far - 0.05 else None

    def _show_picture(self, k: int, picture: ShownPicture | None) -> None:
        if picture is None or self._told.get(f"picture-{k}") == picture.frame_id:
            return
        self._told[f"picture-{k}"] = picture.frame_id
        small = cv2.imdecode(np.frombuffer(picture.jpeg, np.uint8), cv2.IMREAD_REDUCED_COLOR_4)
        if small is not None:  # a picture that is being written is seen next time
            self._nodes[f"camera-{k}"].image = np.ascontiguousarray(small[..., ::-1])

    def _drop(self, key: str) -> None:
        self._told.pop(key, None)
        if (node := self._nodes.pop(key, None)) is not None:
            node.remove()

    # ---- what the record has added, and the judge

    def _show_added(self, moved: Moved) -> None:
        if self.things_shown:
            self._added.show(moved)
        else:
            self._added.remove()

    def _show_judge(self, judge: JudgeMoment) -> None:
        if self.judge_shown:
            self._judged.show(judge)
        else:
            self._judged.remove()

    # ---- the view

    def _look(self, here: Vec3, yaw: float) -> None:
        """Put the view of browsers that come behind and above the first drone that is seen."""
        self._looked = True
        view = self._server.initial_camera
        view.up = (0.0, 1.0, 0.0)
        view.position, view.look_at = self._behind(here, yaw)

    def _behind(self, here: Vec3, yaw: float) -> tuple[Vec3, Vec3]:
        """Return a place behind and above a drone, and what is looked at from there: m, the browser's axes."""
        c, s = math.cos(yaw), math.sin(yaw)
        eye = display.place_of((here[0] - 9.0 * c + 3.0 * s, here[1] - 9.0 * s - 3.0 * c, here[2] - 4.5))
        seen = display.place_of((here[0] + 5.0 * c, here[1] + 5.0 * s, here[2] + 0.5))
        x, y, z = self.offset  # somebody may have been followed before
        return (eye[0] + x, eye[1] + y, eye[2] + z), (seen[0] + x, seen[1] + y, seen[2] + z)

    def _keep_up(self, drones: Sequence[DroneMoment]) -> None:
        """Move the world so that the drone that is followed stays where it was in the browser."""
        here = next((one.position_ned for one in drones if one.drone == self._followed), None)
        if here is None:
            return
        x, y, z = display.place_of(here)
        anchor = self._told.get("followed")
        if not isinstance(anchor, tuple):
            a, b, c = self.offset
            anchor = self._told["followed"] = (a + x, b + y, c + z)
        place = (anchor[0] - x, anchor[1] - y, anchor[2] - z)
        if place != self.offset:
            self._world.position = place
