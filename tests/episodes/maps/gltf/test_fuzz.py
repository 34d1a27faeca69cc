"""Randomly changed files: each file loads as a sound scene or is rejected in one sentence."""

import copy
import json
import random
from typing import Any

import cv2
import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from episodes.maps import gltf
from foundation.errors import UsageError
from tests.episodes.maps.gltf.files import LAWN, Glb, container


def healthy() -> Glb:
    """Return a small valid file that uses many features. The fuzzers change it."""
    file = Glb().lawn()
    picture = cv2.imencode(".png", np.full((4, 4, 3), 99, np.uint8))[1].tobytes()
    file.doc["images"].append({"bufferView": file.view(picture), "mimeType": "image/png"})
    file.doc["textures"].append({"source": 0})
    file.doc["materials"].append(
        {
            "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "roughnessFactor": 0.5},
            "emissiveFactor": [0.1, 0.1, 0.1],
            "extras": {"dronecats_look": [1.0, 1.0, 1.0, 0.1, 0.5, 0.2]},
        }
    )
    normal, uv = file.accessor([(0, 1, 0)] * 4), file.accessor([(0, 0), (1, 0), (1, 1), (0, 1)])
    colour = file.accessor([(255, 255, 255, 255)] * 4, "u1", normalized=True)
    attributes = {"NORMAL": normal, "TEXCOORD_0": uv, "COLOR_0": colour}
    mesh = file.mesh(file.primitive(LAWN * 0.1 + [0, 1, 0], material=0, attributes=attributes, mode=5))
    leaf = file.node(root=False, name="Leaf.001", mesh=mesh, translation=[1, 2, 3], extras={"dronecats_id": 2})
    file.node(children=[leaf], rotation=[0, 1, 0, 0], scale=[1, 2, 1])
    file.doc["scenes"][0]["extras"] = {"dronecats": {"name": "fuzz", "spawn_ned": [0, 0, 0], "origin": [1, 2, 3]}}
    return file


NASTY: list[Any] = [
    None,
    True,
    -1,
    0,
    1,
    2,
    3,
    7,
    2**31,
    2**63,
    10**40,
    1e308,
    -0.5,
    "",
    "x",
    "data:;base64,AA==",
    [],
    {},
    [0] * 5,
]


def places(tree, path=()):
    yield path
    for key, value in tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ():
        yield from places(value, (*path, key))


def loads_or_is_refused(path) -> None:
    for spawn in (None, (0.5, 0.5)):
        try:
            scene = gltf.load(path, spawn)
        except UsageError as error:
            text = str(error)
            assert "\n" not in text
            assert len(text) < 600
        else:
            assert all(np.isfinite(one.mesh.vertices).all() for one in scene.instances)
            assert all(one.mesh.triangles.max() < len(one.mesh.vertices) for one in scene.instances)
            assert np.isfinite(scene.terrain.down).all()


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.tuples(st.integers(0, 10**6), st.sampled_from(NASTY), st.booleans()), min_size=1, max_size=3))
def test_a_file_with_a_fuzzed_document_loads_or_is_rejected(tmp_path, changes):
    file = healthy()
    file.doc["buffers"] = [{"byteLength": len(file.binary)}]
    file.doc = copy.deepcopy(file.doc)
    for where, value, drop in changes:
        *parents, last = random.Random(where).choice([p for p in places(file.doc) if p])
        node = file.doc
        for key in parents:
            node = node[key]
        if drop:
            del node[last]
        else:
            node[last] = copy.deepcopy(value)  # a later change may be inside it
    text = json.dumps(file.doc).encode()
    path = tmp_path / "fuzz.glb"
    path.write_bytes(container(text, bytes(file.binary)))
    loads_or_is_refused(path)


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_a_file_with_fuzzed_bytes_loads_or_is_rejected(tmp_path, data):
    raw = bytearray(healthy().bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(raw) - 1))
        raw[at] = data.draw(st.integers(0, 255))
    cut = data.draw(st.one_of(st.none(), st.integers(0, len(raw))))
    path = tmp_path / "fuzz.glb"
    path.write_bytes(raw[:cut])
    loads_or_is_refused(path)


def test_the_unchanged_seed_file_loads(tmp_path):
    scene = gltf.load(healthy().write(tmp_path / "m.glb"))
    assert len(scene.instances) == 2
