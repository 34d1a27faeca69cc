"""Pictures of a scene from a pose."""

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from episodes.once import once
from episodes.render.coverage import BAND, draw_bands, new_drawn, set_up, sort_into_bands
from episodes.render.layout import Laid, laid_out, lay_out
from episodes.render.pose import depth_per_metre, eye_of
from episodes.render.resolve import resolve_rows
from episodes.render.shading import shade_rows
from episodes.render.shadow import CELLS, SunMap, cast_movable, restore, sun_map
from episodes.render.sky import daylight, display_table
from episodes.render.triangles import SceneArrays, place_all
from episodes.scene import Moved, Scene
from foundation.camera import CameraModel, CameraPose
from foundation.errors import UsageError

NOTHING_MOVED: Moved = MappingProxyType({})


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """What the camera sees at one instant. Depth and ids belong to the exact middle of each pixel."""

    rgb: NDArray[np.uint8]  # (H, W, 3) sRGB
    depth: NDArray[np.float32]  # (H, W) m along the optical axis; inf = sky
    ids: NDArray[np.int32]  # (H, W) instance id; 0 = sky


class Renderer:
    """Draws one scene through one camera.

    The picture depends on scene, camera, pose and `moved` alone: every thread owns whole rows, so the bytes are the
    same for any number of threads. `render` may be called from several Python threads; they take turns.
    """

    def __init__(self, scene: Scene, camera: CameraModel, threads: int = 2, shadow_cells: int = CELLS) -> None:
        """Lay out the scene and draw the shadows of what never moves.

        `shadow_cells` is the number of cells per side of the shadow map. Raises UsageError for a camera that cannot be
        or for a scene whose ids repeat.
        """
        if camera.width < 1 or camera.height < 1 or not 0.0 < camera.hfov_deg < 180.0:
            raise UsageError(
                f"a camera of {camera.width}×{camera.height} px and {camera.hfov_deg}° cannot be drawn: "
                "give at least one pixel each way and a field of view between 0 and 180°."
            )
        self.camera = camera
        of_map = laid_out(scene.base) if scene.base else None
        self._layout = lay_out(scene, of_map)
        place_all(self._layout, NOTHING_MOVED)
        self._sun = _shadows(scene, self._layout, of_map, shadow_cells)
        self._day = daylight(scene.sun)
        triangles = self._layout.triangles
        self._drawn = new_drawn(len(triangles.position), len(triangles.chunk_first))
        self._samples = np.empty((2 * camera.height + 1, 2 * camera.width + 1), np.int32)
        self._light = np.empty((camera.height, camera.width, 3), np.float32)
        self._per_metre = depth_per_metre(camera)
        self._table = display_table()
        self._threads = max(1, threads)
        self._pool = ThreadPoolExecutor(max(1, self._threads - 1), thread_name_prefix="render")
        self._turn = threading.Lock()

    def render(self, pose: CameraPose, moved: Moved = NOTHING_MOVED) -> View:
        """Return what the camera at `pose` sees.

        `moved` gives movable instances their position (m, NED) and yaw (rad) or attitude of this instant, or None when
        they are not there; those it leaves out stand where the scene has them. Raises UsageError when it names an
        instance that cannot be moved.
        """
        eye = eye_of(pose, self.camera)
        shape = (self.camera.height, self.camera.width)
        rgb = np.empty((*shape, 3), np.uint8)
        depth = np.empty(shape, np.float32)
        ids = np.empty(shape, np.int32)
        with self._turn:
            triangles, drawn, samples, light = self._layout.triangles, self._drawn, self._samples, self._light
            covered = cast_movable(self._sun, triangles, place_all(self._layout, moved))
            try:
                self._together(set_up, triangles, eye, drawn)
                start, items = sort_into_bands(triangles, drawn, max(1, (samples.shape[0] - 1) // BAND))
                self._together(draw_bands, drawn, start, items, samples)
                self._together(
                    shade_rows,
                    eye,
                    drawn,
                    triangles,
                    self._layout.surfaces,
                    self._layout.atlas,
                    self._sun,
                    self._day,
                    self._per_metre,
                    samples,
                    light,
                    depth,
                    ids,
                )
                self._together(resolve_rows, samples, triangles.plane, light, self._table, rgb)
            finally:
                restore(self._sun, covered)
        return View(rgb=rgb, depth=depth, ids=ids)

    def close(self) -> None:
        """Let the helper threads go."""
        self._pool.shutdown()

    def _together(self, kernel: Callable[..., None], *arguments: Any) -> None:
        """Run `kernel(thread, threads, …)` once per thread. Kernels release the interpreter's lock."""
        others = [self._pool.submit(kernel, k, self._threads, *arguments) for k in range(1, self._threads)]
        try:
            kernel(0, self._threads, *arguments)
        finally:
            for other in others:
                other.result()


def _shadows(scene: Scene, layout: SceneArrays, of_map: Laid | None, cells: int) -> SunMap:
    """Return the shadows of what never moves in a scene; those of its map are kept where that is laid out."""
    if scene.base is None or of_map is None:
        return sun_map(layout, scene.sun, _ground(scene), cells)
    before = _shadows_of_map(scene.base, cells)
    return sun_map(layout, scene.sun, _ground(scene), cells, before, of_map.arrays.static_count)


@once(3)
def _shadows_of_map(scene: Scene, cells: int) -> SunMap:
    return sun_map(lay_out(scene), scene.sun, _ground(scene), cells)


def _ground(scene: Scene) -> frozenset[int]:
    return frozenset(i.id for i in scene.instances if i.kind == "ground")
