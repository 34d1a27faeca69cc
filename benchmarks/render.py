"""Measures the time of a frame of the forward camera.

    python -m benchmarks.render [--json] [--map NAME] [--repeat N] [--threads N] [--short] [--peers --peers-dir DIR]

prints, for each shipped map in a process of its own, the median milliseconds per frame at 1280×720 and 640×360, of four
drones that share one world at 640×360, and the resident memory in MB. `cpu_ms…` counts all processors, which says more
than the wall where other programs run too; `…_per_loop` is that divided by `python_loop_ms`, which tells little of the
machine (`benchmarks/machine.py`). The figures that stand first are the residential map's. `--peers` draws that map,
from the same poses, with the software renderers of MuJoCo and PyBullet. `--short` only shows, in seconds, that every
figure can be had: one round over the simplest map, which is then what the peers draw.
"""

import json
import math
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import psutil

from benchmarks import render_peers
from benchmarks.machine import Machine, benchmark_parser
from benchmarks.render_export import export
from episodes import maps
from episodes.camera.renderer import Renderer
from episodes.maps.scene import Scene
from foundation.camera import CameraModel, CameraPose
from foundation.frames import quat_from_euler

MAPS = ("residential", "campus", "blocks")
SIMPLEST = "blocks"
FIRST = ("ms_1280x720", "ms_640x360", "ms_fleet4_640x360", "cpu_ms_1280x720_per_loop", "rss_mb")
FLEET = 4
VIEWS = 8  # headings over which a figure is taken
LARGE, SMALL = CameraModel(1280, 720), CameraModel(640, 360)


def headings(scene: Scene, count: int, height: float = 6.0) -> list[CameraPose]:
    """Return poses that look around from above the map's free place, slightly down."""
    n, e, d = scene.spawn_ned
    turns = (scene.spawn_yaw + 2.0 * math.pi * k / count for k in range(count))
    return [CameraPose((n, e, d - height), quat_from_euler(0.0, -0.08, turn)) for turn in turns]


def frame_ms(renderer: Renderer, poses: list[CameraPose], repeat: int) -> tuple[float, float]:
    """Return the median time of one frame over `repeat` rounds of `poses`: by the wall, and by all processors (ms)."""
    renderer.render(poses[0])
    walls, cpus = [], []
    for _ in range(repeat):
        for pose in poses:
            wall, cpu = time.perf_counter(), time.process_time()
            renderer.render(pose)
            walls.append(1e3 * (time.perf_counter() - wall))
            cpus.append(1e3 * (time.process_time() - cpu))
    return statistics.median(walls), statistics.median(cpus)


def fleet_ms(renderer: Renderer, poses: list[CameraPose], repeat: int) -> float:
    """Return the median time of one frame of each pose (ms), one after the other."""
    rounds = []
    for _ in range(repeat):
        begun = time.perf_counter()
        for pose in poses:
            renderer.render(pose)
        rounds.append(1e3 * (time.perf_counter() - begun))
    return statistics.median(rounds)


def measure(name: str, repeat: int, threads: int) -> dict[str, float | int]:
    """Return the figures of one map. Raises UsageError for a map that does not exist."""
    scene = maps.build(name)
    poses = headings(scene, VIEWS)
    machine = Machine()
    begun = time.perf_counter()
    large = Renderer(scene, LARGE, threads)
    large.render(poses[0])
    ready_s = time.perf_counter() - begun
    ms_large, cpu_large = frame_ms(large, poses, repeat)
    rss_mb = psutil.Process().memory_info().rss / 1e6
    large.close()
    small = Renderer(scene, SMALL, threads)
    ms_small, cpu_small = frame_ms(small, poses, repeat)
    ms_fleet = fleet_ms(small, headings(scene, FLEET, 4.0), 2 * repeat)
    small.close()
    machine.look()
    return {
        "ms_1280x720": round(ms_large, 1),
        "ms_640x360": round(ms_small, 1),
        "ms_fleet4_640x360": round(ms_fleet, 1),
        "cpu_ms_1280x720": round(cpu_large, 1),
        "cpu_ms_640x360": round(cpu_small, 1),
        "cpu_ms_1280x720_per_loop": machine.per_loop(cpu_large),
        "cpu_ms_640x360_per_loop": machine.per_loop(cpu_small),
        "python_loop_ms": round(machine.loop_ms, 1),
        "rss_mb": round(rss_mb),
        "ready_s": round(ready_s, 1),
        "triangles": sum(len(i.mesh.triangles) for i in scene.instances),
        "instances": len(scene.instances),
    }


def measured_apart(name: str, repeat: int, threads: int) -> dict[str, Any]:
    """Return the figures of one map, taken in a process that has never seen another: memory is per process."""
    command = [sys.executable, "-m", "benchmarks.render", "--json", "--map", name]
    command += ["--repeat", str(repeat), "--threads", str(threads)]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
    return dict(json.loads(done.stdout)["maps"][name])


def compared(name: str, folder: Path, repeat: int, threads: int) -> dict[str, Any]:
    """Return the peers' figures on a map, ours taken just before each of theirs."""
    scene = maps.build(name)
    poses = headings(scene, VIEWS)
    with tempfile.TemporaryDirectory(prefix="dronecats-peers-") as kept:
        export(scene, poses, LARGE, Path(kept))
        renderers = {size: Renderer(scene, CameraModel(*size), threads) for size in render_peers.SIZES}

        def ours() -> dict[str, float]:
            figures = {}
            for (w, h), renderer in renderers.items():
                figures[f"ms_{w}x{h}"], figures[f"cpu_ms_{w}x{h}"] = frame_ms(renderer, poses, max(1, repeat // 2))
            return figures

        peers = render_peers.compare(folder, Path(kept), ours)
        for renderer in renderers.values():
            renderer.close()
    return peers


def main() -> None:
    parser = benchmark_parser(__doc__, short="draw one map once, to check that it runs")
    parser.add_argument("--map", metavar="NAME", help="this map alone")
    parser.add_argument("--repeat", type=int, default=4, help="rounds over the poses")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--peers", action="store_true", help="draw with MuJoCo and PyBullet as well")
    parser.add_argument("--peers-dir", type=Path, default=Path("peers"), metavar="DIR", help="their environments")
    args = parser.parse_args()
    repeat, drawn = max(1, args.repeat), MAPS[0]
    if args.short:
        repeat, args.map, drawn = 1, SIMPLEST, SIMPLEST
    machine = Machine()
    if args.map:
        by_map = {args.map: measure(args.map, repeat, args.threads)}
    else:
        by_map = {name: measured_apart(name, repeat, args.threads) for name in MAPS}
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
