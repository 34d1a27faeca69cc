"""How long a frame of the forward camera takes.

    python -m benchmarks.render [--json] [--repeat N] [--threads N]

prints the median milliseconds per frame at 1280×720 and 640×360, for four drones that share one world at 640×360, and
the resident memory in MB. The residential map is drawn where it exists, otherwise a made-up suburb of the same size.
"""

import argparse
import importlib
import json
import math
import statistics
import time

import numpy as np
import psutil

from dronecats.border.camera import CameraModel, CameraPose
from dronecats.border.frames import quat_from_euler
from dronecats.border.terrain import FLAT
from episodes.render import Renderer
from episodes.scene import Instance, Material, Mesh, Scene, Sun

FLEET = 4
VIEWS = 8  # headings over which a figure is taken


def residential_or_made_up() -> tuple[Scene, str]:
    """Return the scene to be drawn and what it is."""
    try:
        maps = importlib.import_module("episodes.maps")
        return maps.build("residential"), "residential map"
    except (ImportError, AttributeError):
        return suburb(), "made-up suburb"


def suburb() -> Scene:
    """Return 100 houses, 150 trees of 756 triangles and 30 cars on textured ground: about 120,000 triangles."""
    rng = np.random.default_rng(1)
    noise = rng.integers(60, 140, (256, 256, 3)).astype(np.uint8)
    grass = Material("grass", (0.35, 0.5, 0.2), noise)
    wall = Material("wall", (0.7, 0.6, 0.5), noise)
    leaves = Material("leaves", (0.1, 0.25, 0.05))
    paint = Material("paint", (0.6, 0.1, 0.1), specular=0.5)
    ground, house, crown, car = (
        _grid(500.0, 40, grass),
        _ball(12, 1, (6.0, 5.0, 4.0), wall),
        _ball(27, 14, (2.5, 2.5, 3.5), leaves),
        _ball(12, 6, (2.2, 0.9, 0.7), paint),
    )
    instances = [Instance(1, "ground", "ground", ground, (0.0, 0.0, 0.0))]
    for mesh, kind, count, height in ((house, "house", 100, 4.0), (crown, "tree", 150, 5.0), (car, "suv", 30, 0.7)):
        for _ in range(count):
            place = (float(rng.uniform(-120, 120)), float(rng.uniform(-120, 120)), -height)
            instances.append(Instance(len(instances) + 1, kind, kind, mesh, place, float(rng.uniform(0, 6))))
    sun = Sun((0.4, 0.5, -math.sqrt(1.0 - 0.41)))
    return Scene("suburb", tuple(instances), FLAT, sun, 47.0, 8.0, 400.0)


def _grid(side: float, cells: int, material: Material) -> Mesh:
    """Return a level square of 2·cells² triangles."""
    i, j = np.meshgrid(np.arange(cells + 1), np.arange(cells + 1), indexing="ij")
    v = np.stack(((i / cells - 0.5) * side, (j / cells - 0.5) * side, 0.0 * i), axis=-1).reshape(-1, 3)
    n = np.tile((0.0, 0.0, -1.0), (len(v), 1))
    return _mesh(v, n, v[:, :2] / 4.0, cells, cells, material)


def _ball(around: int, rings: int, half: tuple[float, float, float], material: Material) -> Mesh:
    """Return an ellipsoid of 2·around·(rings + 1) triangles about its origin."""
    i, j = np.meshgrid(np.arange(rings + 2), np.arange(around + 1), indexing="ij")
    polar, turn = math.pi * i / (rings + 1), 2.0 * math.pi * j / around
    n = np.stack((np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)), axis=-1).reshape(-1, 3)
    uv = np.stack((j / 2.0, i / 1.0), axis=-1).reshape(-1, 2)
    return _mesh(n * half, n, uv, rings + 1, around, material)


def _mesh(v: np.ndarray, n: np.ndarray, uv: np.ndarray, rows: int, columns: int, material: Material) -> Mesh:
    """Return the mesh of a (rows + 1) × (columns + 1) lattice of corners."""
    a = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    b = a + columns + 1
    triangles = np.concatenate((np.column_stack((a, b, a + 1)), np.column_stack((b, b + 1, a + 1)))).astype(np.int32)
    order = np.zeros(len(triangles), np.int32)
    return Mesh(v.astype(np.float32), n.astype(np.float32), uv.astype(np.float32), triangles, order, (material,))


def headings(scene: Scene, count: int, height: float = 6.0) -> list[CameraPose]:
    """Return poses that look around from above the map's free place, slightly down."""
    n, e, d = scene.spawn_ned
    turns = (scene.spawn_yaw + 2.0 * math.pi * k / count for k in range(count))
    return [CameraPose((n, e, d - height), quat_from_euler(0.0, -0.08, turn)) for turn in turns]


def frame_ms(renderer: Renderer, poses: list[CameraPose], repeat: int) -> float:
    """Return the median time of one frame (ms) over `repeat` rounds of `poses`."""
    renderer.render(poses[0])
    times = []
    for _ in range(repeat):
        for pose in poses:
            begun = time.perf_counter()
            renderer.render(pose)
            times.append(1e3 * (time.perf_counter() - begun))
    return statistics.median(times)


def measure(repeat: int, threads: int) -> dict[str, float | int | str]:
    """Return every figure of this benchmark."""
    scene, what = residential_or_made_up()
    poses = headings(scene, VIEWS)
    begun = time.perf_counter()
    large = Renderer(scene, CameraModel(1280, 720), threads)
    large.render(poses[0])
    ready_s = time.perf_counter() - begun
    ms_large = frame_ms(large, poses, repeat)
    rss_mb = psutil.Process().memory_info().rss / 1e6
    large.close()
    small = Renderer(scene, CameraModel(640, 360), threads)
    ms_small = frame_ms(small, poses, repeat)
    rounds = []
    fleet = headings(scene, FLEET, 4.0)
    for _ in range(2 * repeat):
        begun = time.perf_counter()
        for pose in fleet:
            small.render(pose)
        rounds.append(1e3 * (time.perf_counter() - begun))
    small.close()
    return {
        "scene": what,
        "triangles": sum(len(i.mesh.triangles) for i in scene.instances),
        "instances": len(scene.instances),
        "threads": threads,
        "ms_1280x720": round(ms_large, 1),
        "ms_640x360": round(ms_small, 1),
        "ms_fleet4_640x360": round(statistics.median(rounds), 1),
        "rss_mb": round(rss_mb),
        "ready_s": round(ready_s, 1),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--repeat", type=int, default=4, help="rounds over the poses")
    parser.add_argument("--threads", type=int, default=2)
    chosen = parser.parse_args()
    figures = measure(max(1, chosen.repeat), chosen.threads)
    if chosen.json:
        print(json.dumps(figures))
    else:
        for name, value in figures.items():
            print(f"{name:20} {value}")


if __name__ == "__main__":
    main()
