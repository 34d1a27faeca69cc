"""The renderer: draws pictures of a scene from the pose of a camera."""

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from episodes.camera.renderer.coverage import BAND, draw_bands, new_drawn, set_up, sort_into_bands
from episodes.camera.renderer.environment import mean_reflectance, reflection_map
from episodes.camera.renderer.layout import SOURCES, SceneArrays, eye_of, lay_out, map_layout, place_all
from episodes.camera.renderer.occlusion import Columns, ContactShadows, Occlusion, columns_of, footprint, occlusion_of
from episodes.camera.renderer.shading import SceneLight, ShadingInput, measure_rows, resolve_rows, shade_rows
from episodes.camera.renderer.shadow import CELLS, Shadows, SunMap, fits, instance_slices, sun_map
from episodes.camera.renderer.sky import daylight, display_table, sky_of
from episodes.camera.renderer.textures import drift_table
from episodes.maps.scene import Moved, Scene, kept_of_scene
from foundation.camera import CameraModel, CameraPose
from foundation.errors import UsageError
from foundation.threads import once

NOTHING_MOVED: Moved = MappingProxyType({})


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """The camera's view at one instant. `depth` and `ids` belong to the exact middle of each pixel."""

    rgb: NDArray[np.uint8]  # (H, W, 3) sRGB
    depth: NDArray[np.float32]  # (H, W) m along the optical axis; inf = sky
    ids: NDArray[np.int32]  # (H, W) instance id; 0 = sky


class Renderer:
    """Draws one scene through one camera.

    The bytes of a picture depend only on scene, camera, `shadow_cells`, `grain`, pose and `moved`. The number of
    threads has no effect, because every thread draws whole rows. `render` may be called from several Python threads;
    they take turns.
    """

    def __init__(
        self, scene: Scene, camera: CameraModel, threads: int = 2, shadow_cells: int = CELLS, grain: int = 2
    ) -> None:
        """Lay out the scene and draw the shadows of static instances.

        `shadow_cells` is the number of cells per side of the shadow map. `grain`, an even number, is the number of
        samples per pixel in each direction. Raises UsageError for an impossible camera or a scene with repeated ids.
        """
        if camera.width < 1 or camera.height < 1 or not 0.0 < camera.hfov_deg < 180.0:
            raise UsageError(
                f"a camera of {camera.width}×{camera.height} px and {camera.hfov_deg}° cannot be drawn: "
                "give at least one pixel each way and a field of view between 0 and 180°."
            )
        self.camera = camera
        self._layout = lay_out(scene, map_layout(scene.base) if scene.base else None)
        place_all(self._layout, NOTHING_MOVED)
        self._shadows, self._contacts, columns, shade = _static_data(scene, self._layout, shadow_cells)
        self._day, self._sky = daylight(scene.sun), sky_of(scene.sun)
        north, east, _ = scene.spawn_ned
        self._mirrored = reflection_map(columns, shade, self._day, self._sky, float(north), float(east))
        self._drift = drift_table()
        triangles = self._layout.triangles
        self._drawn = new_drawn(len(triangles.position), len(triangles.chunk_first))
        self._opaque_chunks, self._cut_chunks = (np.flatnonzero(triangles.chunk_cut == cut) for cut in (False, True))
        self._grain = grain
        self._sheet = _sheet(camera, grain)
        self._table = display_table()
        self._threads = max(1, threads)
        columns = self._sheet.samples.shape[1]
        self._inverse_depths = np.empty((self._threads, 2 * BAND, columns), np.float32)
        self._lowest = np.empty((self._threads, columns), np.float32)
        self._count_up = np.arange(columns, dtype=np.float32)
        self._edges = np.empty((self._threads, columns), np.bool_)
        room = self._threads, (grain + 1) ** 2 * camera.width
        self._places = np.empty((*room, 3), np.int32)
        self._own = np.empty((*room, 3), np.float32)
        self._weights = np.empty(room, np.float32)
        self._means = np.empty((self._threads, camera.width, 3), np.float32)
        self._pool = ThreadPoolExecutor(max(1, self._threads - 1), thread_name_prefix="render")

    def render(self, pose: CameraPose, moved: Moved = NOTHING_MOVED) -> View:
        """Return the view of the camera at `pose`.

        `moved` maps the id of a movable instance to its position (m, NED) and its yaw (rad) or attitude. None instead
        of a pose omits the instance. Instances without an entry keep their pose in the scene. Raises UsageError for
        the id of an instance that cannot be moved.
        """
        shape = (self.camera.height, self.camera.width)
        depth, ids = np.empty(shape, np.float32), np.empty(shape, np.int32)
        return View(self._draw(pose, moved, (depth, ids)), depth, ids)

    def picture(self, pose: CameraPose, moved: Moved = NOTHING_MOVED) -> NDArray[np.uint8]:
        """Return only the picture of `render`, (H, W, 3) sRGB. Raises UsageError as `render` does."""
        return self._draw(pose, moved, None)

    def _draw(
        self, pose: CameraPose, moved: Moved, measures: tuple[NDArray[np.float32], NDArray[np.int32]] | None
    ) -> NDArray[np.uint8]:
        """Return the picture; fill `measures` (depth and ids) unless it is None."""
        eye = eye_of(pose, self.camera, self._grain)
        rgb = np.empty((self.camera.height, self.camera.width, 3), np.uint8)
        with self._sheet.turn:
            layout, drawn, samples, light = self._layout, self._drawn, self._sheet.samples, self._sheet.light
            triangles = layout.triangles
            placed = place_all(layout, moved)
            feet = [footprint(triangles.position[part.triangles]) for part in placed]
            with self._shadows.cast(layout, placed) as sun, self._contacts.cast(feet) as shade:
                self._run_on_threads(set_up, triangles, eye, drawn)
                bands = max(1, (samples.shape[0] - 1) // BAND)
                opaque = sort_into_bands(triangles, drawn, bands, self._opaque_chunks)
                # chunks with cut-out textures (leaves) nearest first, so that hidden leaves cost less work
                away = triangles.chunk_center[self._cut_chunks] - eye.position
                nearest_first = self._cut_chunks[np.argsort(np.einsum("ij,ij->i", away, away), kind="stable")]
                cut_out = sort_into_bands(triangles, drawn, bands, nearest_first)
                holes = triangles.uv, triangles.cutout, layout.cutouts
                room = samples, self._inverse_depths, self._lowest, self._count_up
                self._run_on_threads(draw_bands, drawn, *opaque, *cut_out, *holes, *room)
                lights = SceneLight(self._day, sun, shade, self._sky, self._mirrored, self._drift)
                shot = ShadingInput(eye, drawn, triangles, layout.surfaces, layout.atlas, lights, samples)
                self._run_on_threads(shade_rows, shot, light, self._places)
                more_room = self._edges, self._places, self._own, self._weights, self._means
                self._run_on_threads(resolve_rows, shot, light, self._table, rgb, *more_room)
                if measures:
                    self._run_on_threads(measure_rows, shot, *measures)
        return rgb

    def close(self) -> None:
        """Stop the helper threads."""
        self._pool.shutdown()

    def _run_on_threads(self, kernel: Callable[..., None], *arguments: Any) -> None:
        """Run `kernel(thread, threads, …)` once per thread. Kernels release the interpreter's lock."""
        futures = [self._pool.submit(kernel, k, self._threads, *arguments) for k in range(1, self._threads)]
        try:
            kernel(0, self._threads, *arguments)
        finally:
            for future in futures:
                future.result()


@dataclass(frozen=True, slots=True, eq=False)
class _Sheet:
    """The buffers of a picture. One renderer at a time uses them."""

    samples: NDArray[np.int32]  # (grain · H + 1, grain · W + 1) triangle that each sample sees
    light: NDArray[np.float32]  # (H, W, 3) linear
    turn: threading.Lock = field(default_factory=threading.Lock)


@once(2)
def _sheet(camera: CameraModel, grain: int) -> _Sheet:
    """Return the buffers that all renderers of this process share for one camera and grain: 26 MB at 1280×720."""
    height, width = camera.height, camera.width
    return _Sheet(
        samples=np.empty((grain * height + 1, grain * width + 1), np.int32),
        light=np.empty((height, width, 3), np.float32),
    )


def _static_data(scene: Scene, layout: SceneArrays, cells: int) -> tuple[Shadows, ContactShadows, Columns, Occlusion]:
    """Return the data of a scene's static instances. Scenes of one map share data, unless `_of_map` returns None."""
    own = layout.static_count
    if scene.base is not None and not any(i.movable for i in scene.base.instances):
        own = sum(len(i.mesh.triangles) for i in scene.base.instances)
    more = instance_slices(layout.triangles, own, layout.static_count)
    feet = [footprint(layout.triangles.position[rows]) for rows in more]
    if scene.base is not None and (of_map := _of_map(scene.base, cells)):
        (sun, turn), columns, shade, shade_turn = of_map
        shadows = Shadows(sun, turn, more)
        if not fits(layout, scene.sun, _ground(scene), sun):
            shadows = Shadows(sun_map(layout, scene.sun, _ground(scene), cells), threading.Lock())
        return shadows, ContactShadows(shade, shade_turn, feet), columns, shade
    shadows = Shadows(sun_map(layout, scene.sun, _ground(scene), cells), threading.Lock())
    columns, shade = _surroundings(scene, layout, own)
    return shadows, ContactShadows(shade, threading.Lock(), feet), columns, shade


def _surroundings(scene: Scene, layout: SceneArrays, stop: int) -> tuple[Columns, Occlusion]:
    """Return height columns of the triangles 0 … stop - 1 except the ground, and the share of sky they leave open."""
    columns = columns_of(layout, stop, _ground(scene), mean_reflectance(layout.surfaces, layout.atlas))
    return columns, occlusion_of(columns, scene.terrain)


@once(3)
def _of_map(
    scene: Scene, cells: int
) -> tuple[tuple[SunMap, threading.Lock], Columns, Occlusion, threading.Lock] | None:
    """Return the data that `_static_data` shares between the scenes of a map; None for a map with movable instances."""
    laid = map_layout(scene)
    if laid is None:
        return None
    layout = laid.arrays
    sun = sun_map(layout, scene.sun, _ground(scene), cells)
    around = kept_of_scene("occlusion", SOURCES, scene, lambda: _surroundings(scene, layout, layout.static_count))
    return (sun, threading.Lock()), *around, threading.Lock()


def _ground(scene: Scene) -> frozenset[int]:
    return frozenset(i.id for i in scene.instances if i.kind == "ground")
