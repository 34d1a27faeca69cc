"""Draws a map in other software renderers (peers), each in its own virtual environment, and times them.

`compare` runs this file with the Python of each environment that exists. There the file imports only the peer and
nothing of this project. Environments: DIR/mujoco and DIR/pybullet, one package each. MuJoCo draws through OpenGL
without a display and needs Mesa's libEGL or libOSMesa (Debian: libegl1 with libgl1-mesa-dri, or libosmesa6). PyBullet's
TinyRenderer needs nothing.
"""

import json
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

SIZES = ((1280, 720), (640, 360))  # px
NEAR_M, FAR_M = 0.1, 600.0
ROUNDS = 2  # rounds over the views
LIMIT_S = 240  # wall s, after which a peer is stopped
TOLERANCE = 0.04  # a larger error of `covered` means another scene
SHADOW_CELLS = 4096  # cells per side of a shadow map, if the peer has this setting

Draw = Callable[[int, tuple[int, int]], Any]  # view and size → (H, W, 3) uint8
Covered = Callable[[int], float]  # view → share of pixels that are not sky


def timed(draw: Draw, covered: Covered, scene: dict[str, Any]) -> dict[str, float]:
    """Return the median milliseconds per frame over all views, at each size: in wall and in processor time.

    Raises RuntimeError if the peer draws another scene, because its time would not be comparable.
    """
    for view, wanted in enumerate(scene["covered"]):
        seen = covered(view)
        if abs(seen - wanted) > TOLERANCE:
            raise RuntimeError(
                f"it drew another scene: {seen:.3f} of view {view} is not sky, but should be {wanted:.3f}"
            )
    figures = {}
    for width, height in SIZES:
        walls, cpus = [], []
        draw(0, (width, height))
        for _ in range(ROUNDS):
            for view in range(len(scene["views"])):
                wall, cpu = time.perf_counter(), time.process_time()
                draw(view, (width, height))
                walls.append(1e3 * (time.perf_counter() - wall))
                cpus.append(1e3 * (time.process_time() - cpu))
        figures[f"ms_{width}x{height}"] = round(statistics.median(walls), 1)
        figures[f"cpu_ms_{width}x{height}"] = round(statistics.median(cpus), 1)
    return figures


def pybullet(scene: dict[str, Any], folder: Path) -> dict[str, float]:
    import numpy as np
    import pybullet as p

    p.connect(p.DIRECT)
    shapes: dict[str, int] = {}
    for piece in scene["pieces"]:
        name = piece["file"]
        if name not in shapes:
            color = [*piece["color"], 1.0]
            shapes[name] = p.createVisualShape(p.GEOM_MESH, fileName=str(folder / name), rgbaColor=color)
        turn = p.getQuaternionFromEuler((0.0, 0.0, piece["yaw"]))
        p.createMultiBody(0, -1, shapes[name], piece["position"], turn)

    def image(view: int, size: tuple[int, int]) -> Any:
        v = scene["views"][view]
        ahead = [a + b for a, b in zip(v["eye"], v["forward"], strict=True)]
        looking = p.computeViewMatrix(v["eye"], ahead, v["up"])
        lens = p.computeProjectionMatrixFOV(scene["vfov_deg"], size[0] / size[1], NEAR_M, FAR_M)
        return p.getCameraImage(
            *size, looking, lens, lightDirection=scene["sun"], shadow=1, renderer=p.ER_TINY_RENDERER
        )

    def draw(view: int, size: tuple[int, int]) -> Any:
        return np.reshape(image(view, size)[2], (size[1], size[0], 4))[..., :3].astype(np.uint8)

    def covered(view: int) -> float:
        return float((np.reshape(image(view, SIZES[1])[4], -1) >= 0).mean())

    np.save(folder / "picture.npy", draw(0, SIZES[0]))
    return timed(draw, covered, scene)


def mujoco(scene: dict[str, Any], folder: Path) -> dict[str, float]:
    os.environ.setdefault("MUJOCO_GL", "egl")
    import mujoco as m
    import numpy as np

    model = m.MjModel.from_xml_string(_mjcf(scene, folder))
    data = m.MjData(model)
    m.mj_forward(model, data)
    renderers = {size: m.Renderer(model, size[1], size[0], max_geom=20_000) for size in SIZES}

    def draw(view: int, size: tuple[int, int]) -> Any:
        renderers[size].update_scene(data, camera=view)
        return renderers[size].render()

    def covered(view: int) -> float:
        renderer = renderers[SIZES[1]]
        renderer.enable_depth_rendering()
        renderer.update_scene(data, camera=view)
        depth = renderer.render()
        renderer.disable_depth_rendering()
        return float((depth < 0.99 * FAR_M).mean())

    np.save(folder / "picture.npy", draw(0, SIZES[0]))
    return timed(draw, covered, scene)


def _mjcf(scene: dict[str, Any], folder: Path) -> str:
    """Return the scene as MuJoCo's XML. Collisions are off, so that MuJoCo computes no convex hulls."""

    def text(values: Any) -> str:
        return " ".join(f"{v:.6f}" for v in values)

    names = {piece["file"]: None for piece in scene["pieces"]}
    meshes = "".join(f'<mesh name="{n}" file="{n}" inertia="shell"/>' for n in names)
    geoms = "".join(
        f'<geom type="mesh" mesh="{g["file"]}" pos="{text(g["position"])}" euler="0 0 {g["yaw"]:.6f}" '
        f'rgba="{text(g["color"])} 1" contype="0" conaffinity="0"/>'
        for g in scene["pieces"]
    )
    cameras = "".join(
        f'<camera pos="{text(v["eye"])}" xyaxes="{text(v["right"])} {text(v["up"])}" fovy="{scene["vfov_deg"]:.4f}"/>'
        for v in scene["views"]
    )
    light = text([-c for c in scene["sun"]])
    width, height = SIZES[0]
    return (
        f'<mujoco><compiler angle="radian" meshdir="{folder}"/><statistic extent="1" center="0 0 0"/>'
        f'<visual><global offwidth="{width}" offheight="{height}"/><quality shadowsize="{SHADOW_CELLS}"/>'
        f'<map znear="{NEAR_M}" zfar="{FAR_M}" shadowclip="150"/></visual><asset>{meshes}</asset><worldbody>'
        f'<light directional="true" castshadow="true" dir="{light}" pos="0 0 60"/>{geoms}{cameras}'
        "</worldbody></mujoco>"
    )


PEERS: dict[str, Callable[[dict[str, Any], Path], dict[str, float]]] = {"mujoco": mujoco, "pybullet": pybullet}


def compare(folder: Path, exported: Path, ours: Callable[[], dict[str, float]]) -> dict[str, Any]:
    """Return by peer: its milliseconds, the project's, and their ratio; or a `note` on why these are absent.

    `exported` is the folder that `render.export` wrote. `ours` times the project's renderer and is called before
    each peer. The first picture of a peer is kept as `folder`/NAME.npy, (720, 1280, 3).
    """
    results: dict[str, Any] = {}
    this = Path(__file__).absolute()
    for name in PEERS:
        python = folder.absolute() / name / "bin" / "python"
        if not python.exists():
            results[name] = {"note": f"absent: no virtual environment at {folder / name}"}
            continue
        our_ms = ours()
        try:
            done = subprocess.run(
                [python, this, name, exported], cwd=folder, capture_output=True, text=True, timeout=LIMIT_S, check=True
            )
            figures = json.loads(done.stdout.splitlines()[-1])
            (exported / "picture.npy").replace(folder / f"{name}.npy")
            for size, ms in our_ms.items():
                figures[f"ours_{size}"] = round(ms, 1)
                figures[f"over_ours_{size}"] = round(figures[size] / ms, 1)
            results[name] = figures
        except subprocess.TimeoutExpired:
            results[name] = {"note": f"absent: took longer than {LIMIT_S} s"}
        except (subprocess.CalledProcessError, ValueError, IndexError, KeyError, OSError) as error:
            lines = (getattr(error, "stderr", "") or str(error)).strip().splitlines()
            results[name] = {"note": f"absent: {lines[-1] if lines else error}"}
    return results


if __name__ == "__main__":
    where = Path(sys.argv[2])
    scene = json.loads((where / "scene.json").read_text(encoding="utf-8"))
    print(json.dumps(PEERS[sys.argv[1]](scene, where)))
