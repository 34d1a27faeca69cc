"""A small map that a browser's software renderer draws quickly, and a free port."""

import socket

import numpy as np
import pytest

from episodes.maps import user
from tests.support.ports import free_port


@pytest.fixture
def port():
    return free_port(socket.SOCK_STREAM)


@pytest.fixture
def yard(tmp_path, monkeypatch):
    """Import the map 'yard': a level square of 80 m by 80 m with a shed on it."""
    import trimesh

    monkeypatch.setenv(user.FOLDER, str(tmp_path / "maps"))
    scene = trimesh.Scene()
    for name, size, place, shade in (
        ("slab", (80.0, 1.0, 80.0), (0.0, -0.5, 0.0), (0.25, 0.4, 0.2, 1.0)),
        ("shed", (4.0, 3.0, 6.0), (9.0, 1.5, -9.0), (0.5, 0.2, 0.15, 1.0)),
    ):
        box = trimesh.creation.box(size)
        material = trimesh.visual.material.PBRMaterial(baseColorFactor=shade, metallicFactor=0.0, roughnessFactor=1.0)
        box.visual = trimesh.visual.TextureVisuals(uv=np.zeros((len(box.vertices), 2)), material=material)
        scene.add_geometry(box, node_name=name, transform=trimesh.transformations.translation_matrix(place))
    path = tmp_path / "yard.glb"
    path.write_bytes(scene.export(file_type="glb"))
    user.add(path, "yard", (0.0, 0.0))
    return "yard"
