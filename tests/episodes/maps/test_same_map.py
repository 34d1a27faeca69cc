"""A map has the same bytes in every process, independent of the order of Python's sets."""

import hashlib
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from episodes import maps

ROOT = Path(__file__).parents[3]


def digest(name: str) -> str:
    """Return a digest of all data of a map that rendering and measurements use."""
    scene, sha256 = maps.build(name, 3), hashlib.sha256()
    sha256.update(scene.terrain.down.tobytes())
    sha256.update(repr((scene.sun.toward_ned, scene.spawn_ned, scene.latitude_deg, scene.longitude_deg)).encode())
    for one in scene.instances:
        sha256.update(repr((one.id, one.name, one.kind, one.position_ned, one.yaw, one.solid)).encode())
        for part in (one.mesh.vertices, one.mesh.normals, one.mesh.uv, one.mesh.triangles, one.mesh.material):
            sha256.update(part.tobytes())
        for look in one.mesh.materials:
            sha256.update(repr((look.name, look.color, look.emission, look.specular)).encode())
            sha256.update(b"" if look.texture is None else look.texture.tobytes())
    return sha256.hexdigest()


@pytest.mark.parametrize("name", ["blocks", "campus"])
def test_another_process_builds_the_same_map(name: str) -> None:
    say = f"from tests.episodes.maps.test_same_map import digest; print(digest({name!r}))"
    other = {"PYTHONHASHSEED": "7", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [sys.executable, "-c", say],
        cwd=ROOT,
        env={**os.environ, **other, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.strip() == digest(name)


@pytest.mark.parametrize("name", maps.shipped())
def test_ground_triangles_face_up(name: str) -> None:
    for one in maps.build(name, 1).instances:
        if one.kind == "ground":
            corners = one.mesh.vertices[one.mesh.triangles].astype(float)
            normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
            assert (normal[:, 2] < 1e-9).all(), one.name  # down is positive. Viewers with back-face culling need this.
