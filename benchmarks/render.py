"""Measures the time of a frame of the forward camera.

    python -m benchmarks.render [--json] [--map NAME] [--repeat N] [--threads N] [--poses N] [--short]
                                [--peers --peers-dir DIR]

For each shipped map, in its own process, prints the median milliseconds per frame: at 1280×720, at 640×360, for the
agent's picture with its JPEG encoding, and for the pictures of four drones in one world. Also prints the resident
memory in MB. `ssim…` compares the agent's picture with the frame of 1280×720 reduced to the same size, at `--poses`
places of the map. `cpu_ms…` counts all processors, which is more meaningful than wall time if other programs run too.
`…_per_loop` is `cpu_ms…` divided by `python_loop_ms`; it depends little on the machine (`benchmarks/machine.py`). The
figures at the top are those of the residential map. `--peers` draws that map, from the same poses, with the software
renderers of MuJoCo and PyBullet. `--short` takes seconds and only checks that every figure can be measured: one round
over the simplest map, which the peers then draw too.
"""

import json
import math
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import psutil
from numpy.typing import NDArray

from benchmarks import render_peers
from benchmarks.machine import Machine, benchmark_parser
from dronecats.flight.sitl.camera import GRAIN
from episodes import maps
from episodes.camera.renderer import Renderer
from episodes.camera.renderer.layout import eye_of
from episodes.maps.scene import Material, Mesh, Scene
from foundation.camera import CameraModel, CameraPose, encode, reduced
from foundation.frames import quat_from_euler

LEAST_AREA_M2 = 1e-7  # MuJoCo rejects smaller pieces as degenerate


def export(scene: Scene, poses: list[CameraPose], camera: CameraModel, folder: Path) -> None:
    """Write `scene.json` and its OBJ files. World axes are north, west, up; asset axes ahead, left, up.

    A mean colour replaces each material's texture. In scene.json, `pieces` are the files with their poses in the world,
    and `views` are the cameras. `covered`, the share of pixels without sky in each view, shows whether another renderer
    draws the same scene.
    """
    files: dict[int, list[dict[str, Any]]] = {}
    pieces: list[dict[str, Any]] = []
    triangles = 0
    for instance in scene.instances:
        if id(instance.mesh) not in files:
            files[id(instance.mesh)] = _written(instance.mesh, len(files), folder)
        n, e, d = instance.position_ned
        place = {"position": (float(n), -float(e), -float(d)), "yaw": -float(instance.yaw)}
        for piece in files[id(instance.mesh)]:
            pieces.append({**place, **piece})
            triangles += piece["triangles"]
    renderer = Renderer(scene, CameraModel(320, 180))
    covered = [float((renderer.render(pose).ids > 0).mean()) for pose in poses]
    renderer.close()
    vfov = math.degrees(2.0 * math.atan(camera.height / camera.width * math.tan(math.radians(camera.hfov_deg / 2.0))))
    n, e, d = scene.sun.toward_ned
    views = [_view(pose, camera) for pose in poses]
    exported = {"pieces": pieces, "triangles": triangles, "views": views, "covered": covered, "vfov_deg": vfov}
    exported["sun"] = (float(n), -float(e), -float(d))
    (folder / "scene.json").write_text(json.dumps(exported), encoding="utf-8")


def _view(pose: CameraPose, camera: CameraModel) -> dict[str, Any]:
    eye = eye_of(pose, camera)

    def turned(v: tuple[float, float, float]) -> tuple[float, float, float]:
        return (v[0], -v[1], -v[2])

    down = turned(eye.down)
    up = (-down[0], -down[1], -down[2])
    return {"eye": turned(eye.position), "forward": turned(eye.forward), "right": turned(eye.right), "up": up}


def _written(mesh: Mesh, number: int, folder: Path) -> list[dict[str, Any]]:
    """Write one OBJ per material of a mesh; return the file, colour and triangle count of each OBJ."""
    pieces = []
    for k, material in enumerate(mesh.materials):
        chosen = mesh.triangles[mesh.material == k]
        corners = mesh.vertices[chosen].astype(float) * (1.0, -1.0, -1.0)
        area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        if not len(chosen) or area.sum() < LEAST_AREA_M2:
            continue
        used, at = np.unique(chosen, return_inverse=True)
        at = at.reshape(-1, 3) + 1
        lines = [f"v {x:.5f} {y:.5f} {z:.5f}" for x, y, z in mesh.vertices[used].astype(float) * (1.0, -1.0, -1.0)]
        lines += [f"vn {x:.4f} {y:.4f} {z:.4f}" for x, y, z in mesh.normals[used].astype(float) * (1.0, -1.0, -1.0)]
        lines += [f"f {a}//{a} {b}//{b} {c}//{c}" for a, b, c in at]
        name = f"mesh-{number}-{k}.obj"
        (folder / name).write_text("\n".join(lines) + "\n", encoding="ascii")
        pieces.append({"file": name, "color": _mean_color(material), "triangles": len(chosen)})
    return pieces


def _mean_color(material: Material) -> tuple[float, float, float]:
    """Return a material's mean colour (sRGB, 0 … 1)."""
    light = np.asarray(material.color, float)
    if material.texture is not None:
        light = light * ((material.texture / 255.0) ** 2.2).mean(axis=(0, 1))
    r, g, b = (float(c) for c in np.clip(light, 0.0, 1.0) ** (1.0 / 2.2))
    return (r, g, b)


MAPS = ("residential", "campus", "blocks")  # the first map's figures are printed first
SIMPLEST = "blocks"
FIRST = ("ms_1280x720", "ms_640x360", "ms_agent", "ms_fleet4_agent", "cpu_ms_agent_per_loop", "ssim_mean", "rss_mb")
FLEET = 4
VIEWS = 8  # number of camera headings over which each figure is measured
LARGE, SMALL = CameraModel(1280, 720), CameraModel(640, 360)


def headings(scene: Scene, count: int, height: float = 6.0) -> list[CameraPose]:
    """Return poses above the map's spawn point that look around and slightly down."""
    n, e, d = scene.spawn_ned
    turns = (scene.spawn_yaw + 2.0 * math.pi * k / count for k in range(count))
    return [CameraPose((n, e, d - height), quat_from_euler(0.0, -0.08, turn)) for turn in turns]


def frame_ms(draw: Callable[[CameraPose], object], poses: list[CameraPose], repeat: int) -> tuple[float, float]:
    """Return the median time of one frame over `repeat` rounds of `poses`: (wall time, processor time), ms."""
    draw(poses[0])
    walls, cpus = [], []
    for _ in range(repeat):
        for pose in poses:
            wall, cpu = time.perf_counter(), time.process_time()
            draw(pose)
            walls.append(1e3 * (time.perf_counter() - wall))
            cpus.append(1e3 * (time.process_time() - cpu))
    return statistics.median(walls), statistics.median(cpus)


def fleet_ms(draw: Callable[[CameraPose], object], poses: list[CameraPose], repeat: int) -> float:
    """Return the median time (ms) to draw all poses, one after the other."""
    rounds = []
    for _ in range(repeat):
        begun = time.perf_counter()
        for pose in poses:
            draw(pose)
        rounds.append(1e3 * (time.perf_counter() - begun))
    return statistics.median(rounds)


def ssim(a: NDArray[np.uint8], b: NDArray[np.uint8]) -> float:
    """Return the mean structural similarity of two RGB pictures in greyscale.

    Window (Gaussian, 11 px, 1.5 px) and constants are from Wang et al., "Image quality assessment: from error
    visibility to structural similarity", 2004.
    """
    x, y = (cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY).astype(np.float64) for picture in (a, b))
    mean_x, mean_y, xx, yy, xy = (cv2.GaussianBlur(v, (11, 11), 1.5) for v in (x, y, x * x, y * y, x * y))
    c1, c2 = (0.01 * 255) ** 2, (0.03 * 255) ** 2
    both = mean_x * mean_y
    alike = (2 * both + c1) * (2 * (xy - both) + c2)
    spread = (mean_x**2 + mean_y**2 + c1) * (xx - mean_x**2 + yy - mean_y**2 + c2)
    return float((alike / spread).mean())


def places(scene: Scene, count: int) -> list[CameraPose]:
    """Return poses from 1.5 to 20 m above the ground around the map's spawn point, random from a fixed seed."""
    rng = np.random.default_rng(1)
    poses = []
    for k in range(count):
        height = (1.5, 3.0, 8.0, 20.0)[k % 4]
        n, e, _ = (float(at) for at in scene.spawn_ned + np.append(rng.normal(scale=8.0, size=2), 0.0))
        d = float(scene.spawn_ned[2]) - height
        down = -0.3 if height > 10.0 else 0.0
        roll, pitch, yaw = rng.normal(scale=0.03), rng.normal(down, 0.08), rng.uniform(0.0, 2.0 * math.pi)
        poses.append(CameraPose((n, e, d), quat_from_euler(float(roll), float(pitch), float(yaw))))
    return poses


def measure(name: str, repeat: int, threads: int, compared_poses: int) -> dict[str, float | int]:
    """Return the figures of one map. Raises UsageError for a map that does not exist."""
    scene = maps.build(name)
    poses = headings(scene, VIEWS)
    machine = Machine()
    begun = time.perf_counter()
    large = Renderer(scene, LARGE, threads)
    large.render(poses[0])
    ready_s = time.perf_counter() - begun
    timings = {"1280x720": frame_ms(large.render, poses, repeat)}
    rss_mb = psutil.Process().memory_info().rss / 1e6
    small = Renderer(scene, SMALL, threads)
    timings["640x360"] = frame_ms(small.render, poses, repeat)
    small.close()
    agents = Renderer(scene, SMALL, threads, grain=GRAIN)

    def jpeg(pose: CameraPose) -> bytes:
        return encode(agents.picture(pose))

    timings["agent"] = frame_ms(jpeg, poses, repeat)
    ms_fleet = fleet_ms(jpeg, headings(scene, FLEET, 4.0), 2 * repeat)
    alike = [ssim(agents.picture(pose), reduced(large.picture(pose))) for pose in places(scene, compared_poses)]
    large.close()
    agents.close()
    machine.look()
    return {
        **{f"ms_{name}": round(wall_ms, 1) for name, (wall_ms, _) in timings.items()},
        "ms_fleet4_agent": round(ms_fleet, 1),
        **{f"cpu_ms_{name}": round(cpu_ms, 1) for name, (_, cpu_ms) in timings.items()},
        **{f"cpu_ms_{name}_per_loop": machine.per_loop(cpu_ms) for name, (_, cpu_ms) in timings.items()},
        "ssim_mean": round(statistics.mean(alike), 4),
        "ssim_min": round(min(alike), 4),
        "python_loop_ms": round(machine.loop_ms, 1),
        "rss_mb": round(rss_mb),
        "ready_s": round(ready_s, 1),
        "triangles": sum(len(i.mesh.triangles) for i in scene.instances),
        "instances": len(scene.instances),
    }


def measured_apart(name: str, repeat: int, threads: int, compared_poses: int) -> dict[str, Any]:
    """Return the figures of one map, measured in a new process, so that the memory is of this map only."""
    command = [sys.executable, "-m", "benchmarks.render", "--json", "--map", name]
    command += ["--repeat", str(repeat), "--threads", str(threads), "--poses", str(compared_poses)]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
    return dict(json.loads(done.stdout)["maps"][name])


def compared(name: str, folder: Path, repeat: int, threads: int) -> dict[str, Any]:
    """Return the peers' figures on a map. The project's renderer is measured just before each peer."""
    scene = maps.build(name)
    poses = headings(scene, VIEWS)
    with tempfile.TemporaryDirectory(prefix="dronecats-peers-") as kept:
        export(scene, poses, LARGE, Path(kept))
        renderers = {size: Renderer(scene, CameraModel(*size), threads) for size in render_peers.SIZES}

        def ours() -> dict[str, float]:
            figures = {}
            for (w, h), renderer in renderers.items():
                figures[f"ms_{w}x{h}"], figures[f"cpu_ms_{w}x{h}"] = frame_ms(
                    renderer.render, poses, max(1, repeat // 2)
                )
            return figures

        peers = render_peers.compare(folder, Path(kept), ours)
        for renderer in renderers.values():
            renderer.close()
    return peers


def main() -> None:
    parser = benchmark_parser(__doc__, short="draw one map once, to check that it runs")
    parser.add_argument("--map", metavar="NAME", help="only this map")
    parser.add_argument("--repeat", type=int, default=4, help="rounds over the poses")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--poses", type=int, default=40, help="places where the agent's picture is compared")
    parser.add_argument("--peers", action="store_true", help="also draw with MuJoCo and PyBullet")
    parser.add_argument("--peers-dir", type=Path, default=Path("peers"), metavar="DIR", help="their environments")
    args = parser.parse_args()
    repeat, poses, drawn = max(1, args.repeat), max(1, args.poses), MAPS[0]
    if args.short:
        repeat, poses, args.map, drawn = 1, 2, SIMPLEST, SIMPLEST
    machine = Machine()
    if args.map:
        by_map = {args.map: measure(args.map, repeat, args.threads, poses)}
    else:
        by_map = {name: measured_apart(name, repeat, args.threads, poses) for name in MAPS}
    first = next(iter(by_map.values()))
    figures: dict[str, Any] = {
        **{name: first[name] for name in FIRST},
        "threads": args.threads,
        "machine": machine.figures(),
        "maps": by_map,
    }
    if args.peers:
        figures["peers"] = compared(drawn, args.peers_dir, repeat, args.threads)
    if args.json:
        print(json.dumps(figures))
        return
    for name, value in figures.items():
        rows = value.items() if isinstance(value, dict) else [("", value)]
        for row, cell in rows:
            print(f"{name:18} {row:12} {cell}")


if __name__ == "__main__":
    main()
