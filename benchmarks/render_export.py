"""Exports a scene for other renderers: one Wavefront OBJ file for each piece of one colour, and a list of them."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from episodes.camera.renderer import Renderer
from episodes.camera.renderer.layout import eye_of
from episodes.maps.scene import Material, Mesh, Scene
from foundation.camera import CameraModel, CameraPose

LEAST_AREA_M2 = 1e-7  # MuJoCo rejects smaller pieces as degenerate


def export(scene: Scene, poses: list[CameraPose], camera: CameraModel, folder: Path) -> None:
    """Write `scene.json` and its OBJ files. World axes are north, west, up; an asset's are ahead, left, up.

    Each material is replaced by its mean colour, without texture. In scene.json, `pieces` are the files with their
    poses in the world, `views` are the cameras, and `covered` is the share of pixels without sky in each view, which
    shows whether another renderer draws the same scene.
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
    """Write one OBJ per material of a mesh, and return file, colour and triangle count of each."""
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
    """Return the sRGB mean of a material, 0 … 1."""
    light = np.asarray(material.color, float)
    if material.texture is not None:
        light = light * ((material.texture / 255.0) ** 2.2).mean(axis=(0, 1))
    r, g, b = (float(c) for c in np.clip(light, 0.0, 1.0) ** (1.0 / 2.2))
    return (r, g, b)
