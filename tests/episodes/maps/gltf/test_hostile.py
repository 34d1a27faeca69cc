"""Damaged and hostile files are rejected with a UsageError of one sentence, before they use much memory."""

import base64
import math
import os
import struct
import tracemalloc
import zlib
from typing import Any

import cv2
import numpy as np
import pytest

from episodes.maps import gltf
from foundation.errors import UsageError
from tests.episodes.maps.gltf.files import LAWN, SQUARE, Glb, container


def refused(path, *words, spawn=(0.0, 0.0)) -> str:
    """Load a file that is rejected, and return the error. The error names the file and contains all `words`."""
    with pytest.raises(UsageError) as raised:
        gltf.load(path, spawn)
    text = str(raised.value)
    assert path.name in text
    assert len(text) < 400
    assert "\n" not in text
    for word in words:
        assert word in text
    return text


def png(width, height, body=b"\0" * 100) -> bytes:
    """Return a PNG whose header has this width and height; `body` need not match them."""

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0))
    return bytes(b"\x89PNG\r\n\x1a\n" + head + chunk(b"IDAT", zlib.compress(body)) + chunk(b"IEND", b""))


def textured(image: dict[str, Any], file: Glb | None = None) -> Glb:
    file = file or Glb()
    file.doc["images"].append(image)
    file.doc["textures"].append({"source": 0})
    file.doc["materials"].append({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}})
    file.node(mesh=file.mesh(file.primitive(material=0)))
    return file


# ---- containers


def test_invalid_containers_are_rejected(tmp_path):
    for data, words in (
        (b"", ("'glTF'",)),
        (b"glTF", ("'glTF'",)),
        (b"PK\3\4" + b"x" * 100, ("'glTF'",)),
        (b'{"asset": {"version": "2.0"}}', ("text", ".glb")),
        (struct.pack("<4sII", b"glTF", 1, 12), ("version 1",)),
        (struct.pack("<4sII", b"glTF", 2, 2**32 - 1), ("4294967295", "12")),
        (struct.pack("<4sIIII", b"glTF", 2, 20, 2**31, 0x4E4F534A), ("2147483648", "0")),
        (container(b"[]"), ("JSON", "object")),
        (container(b'{"asset": '), ("JSON",)),
        (container(b'{"asset": {"version": "2.0"}, "x": NaN}'), ("NaN",)),
        (container(b'{"x": ' + b"9" * 10_000 + b"}"), ("JSON", "digits")),
        (container(b"\xff\xfe{}"), ("JSON", "utf-8")),
        (container(b"[" * 500_000 + b"]" * 500_000), ("JSON", "recursion")),
        (container(b"[" + b"[]," * 1_100_000 + b"[]]"), ("1000000",)),
        (container(b"{}"), ("asset.version",)),
        (container(b'{"asset": {"version": "1.0"}}'), ("asset.version",)),
        (container(b'{"asset": {"version": "2.0"}}'), ("triangles",)),
        (container(b'{"asset": {"version": "2.0"}, "nodes": 3}'), ("nodes", "list")),
        (container(b'{"asset": {"version": "2.0"}, "nodes": [3]}'), ("nodes", "list")),
    ):
        path = tmp_path / "hostile.glb"
        path.write_bytes(data)
        refused(path, *words)


def test_missing_and_invalid_files_are_rejected(tmp_path):
    refused(tmp_path, "regular file")
    refused(tmp_path / "absent.glb", "absent.glb")
    os.mkfifo(tmp_path / "pipe.glb")
    refused(tmp_path / "pipe.glb", "regular file")


def test_a_file_of_1_gib_is_rejected_before_it_is_read(tmp_path):
    path = tmp_path / "huge.glb"
    with path.open("wb") as file:
        file.write(struct.pack("<4sII", b"glTF", 2, 2**30))
        file.truncate(2**30)
    tracemalloc.start()
    try:
        refused(path, "1024 MiB")
        assert tracemalloc.get_traced_memory()[1] < 1_000_000
    finally:
        tracemalloc.stop()


# ---- contents


def bent(change) -> Glb:
    file = Glb().lawn()
    change(file)
    return file


def sets(table, k, **fields):
    return lambda file: file.doc[table][k].update(fields)


WRONG = {
    "a count beyond the bytes": (sets("accessors", 0, count=2000), "accessors[0] declares 2000"),
    "a count beyond all bytes": (sets("accessors", 0, count=2**31), "20000000 vertices"),
    "more corners than anything has": (sets("accessors", 1, count=2**32 - 1), "1000000"),
    "a negative count": (sets("accessors", 0, count=-1), "accessors[0].count is -1"),
    "a count that is text": (sets("accessors", 0, count="4"), "accessors[0].count is '4'"),
    "a view beyond the buffer": (sets("bufferViews", 0, byteLength=10**6), "at byte 1000000 "),
    "an offset beyond the buffer": (sets("bufferViews", 0, byteOffset=2**32 - 4), "at byte 4294967340"),
    "a buffer that is not there": (lambda f: f.doc.update(buffers=[{"byteLength": 10**9}]), "buffers[0] declares"),
    "a stride smaller than an element": (sets("bufferViews", 0, byteStride=4), "accessors[0] steps by 4"),
    "a stride that leads out": (sets("bufferViews", 0, byteStride=252), "accessors[0] declares 4 "),
    "an unknown component": (sets("accessors", 0, componentType=5124), "accessors[0].componentType"),
    "an unknown type": (sets("accessors", 0, type="MAT4"), "accessors[0].type"),
    "positions of two numbers": (sets("accessors", 0, type="VEC2"), "accessors[0].type"),
    "indices that are floats": (sets("accessors", 1, componentType=5126, count=3), "accessors[1]"),
    "a sparse accessor": (sets("accessors", 0, sparse={"count": 1}), "accessors[0] is sparse"),
    "an accessor of nothing": (lambda f: f.doc["accessors"][0].pop("bufferView"), "bufferView"),
    "an empty accessor": (sets("accessors", 0, count=0), "accessors[0]"),
    "a mesh that is not there": (sets("nodes", 0, mesh=7), "nodes[0].mesh is 7"),
    "a mesh that is true": (sets("nodes", 0, mesh=True), "nodes[0].mesh is True"),
    "a material that is not there": (lambda f: f.doc["meshes"][0]["primitives"][0].update(material=4), "material is 4"),
    "no positions": (lambda f: f.doc["meshes"][0]["primitives"][0].update(attributes={}), "POSITION"),
    "an unknown mode": (lambda f: f.doc["meshes"][0]["primitives"][0].update(mode=9), "primitives[0].mode is 9"),
    "a loop of nodes": (sets("nodes", 0, children=[0]), "nodes[0]"),
    "children that are no list": (sets("nodes", 0, children=3), "nodes[0].children"),
    "a child that is not there": (sets("nodes", 0, children=[9]), "node is 9"),
    "a root twice": (lambda f: f.doc["scenes"][0].update(nodes=[0, f.node(root=False) * 0]), "nodes[0]"),
    "a scene that is not there": (lambda f: f.doc.update(scene=4), "scene is 4"),
    "a rotation of nothing": (sets("nodes", 0, rotation=[0, 0, 0, 0]), "nodes[0].rotation"),
    "a scale of millions": (sets("nodes", 0, scale=[1e9, 1, 1]), "20000 m"),
    "a place at infinity": (sets("nodes", 0, translation=[1e400, 0, 0]), "Infinity"),
    "a place with too many digits": (sets("nodes", 0, translation=[10**400, 0, 0]), "nodes[0].translation"),
    "a short matrix": (sets("nodes", 0, matrix=[1.0] * 15), "nodes[0].matrix"),
    "Draco": (lambda f: f.doc.update(extensionsRequired=["KHR_draco_mesh_compression"]), "KHR_draco_mesh_compression"),
    "meshopt": (lambda f: f.doc.update(extensionsRequired=["EXT_meshopt_compression"]), "EXT_meshopt_compression"),
    "a Draco primitive": (
        lambda f: f.doc["meshes"][0]["primitives"][0].update(extensions={"KHR_draco_mesh_compression": {}}),
        "meshes[0].primitives[0]",
    ),
    "a meshopt view": (sets("bufferViews", 0, extensions={"EXT_meshopt_compression": {}}), "bufferViews[0]"),
    "WebP": (lambda f: f.doc.update(extensionsRequired=["EXT_texture_webp"]), "EXT_texture_webp"),
    "an extension of nobody": (lambda f: f.doc.update(extensionsRequired=["ACME_magic"]), "ACME_magic"),
    "extensions that are no names": (lambda f: f.doc.update(extensionsRequired=[{}]), "extensionsRequired"),
    "a file beside it": (lambda f: f.doc.update(buffers=[{"byteLength": 4, "uri": "scene.bin"}]), "scene.bin"),
    "a path out of the folder": (
        lambda f: f.doc.update(buffers=[{"byteLength": 4, "uri": "../../../../etc/passwd"}]), "/etc/passwd"
    ),
    "a web address": (lambda f: f.doc.update(buffers=[{"byteLength": 4, "uri": "http://a.example/b"}]), "a.example"),
    "base64 that is none": (
        lambda f: f.doc.update(buffers=[{"byteLength": 4, "uri": "data:a/b;base64,!!"}]), "buffers[0].uri"
    ),
}  # fmt: skip


def test_invalid_contents_are_rejected(tmp_path):
    for case in WRONG:
        change, words = WRONG[case]
        refused(bent(change).write(tmp_path / "hostile.glb"), words)


def test_vertices_that_are_not_finite_or_too_far_are_rejected(tmp_path):
    for value in (math.nan, math.inf, -math.inf, 3e38):
        positions = LAWN.copy()
        positions[2, 1] = value
        file = Glb()
        file.node(mesh=file.mesh(file.primitive(positions)))
        refused(file.write(tmp_path / "hostile.glb"))


def test_an_index_beyond_the_vertices_is_rejected(tmp_path):
    file = Glb()
    file.node(mesh=file.mesh(file.primitive(order=[0, 1, 9])))
    refused(file.write(tmp_path / "hostile.glb"), "vertex 9")


def test_attributes_of_different_lengths_are_rejected(tmp_path):
    file = Glb()
    normal = file.accessor([(0, 1, 0)] * 3)
    file.node(mesh=file.mesh(file.primitive(attributes={"NORMAL": normal})))
    refused(file.write(tmp_path / "hostile.glb"), "3 ", "4 vertices")


def test_a_node_tree_of_a_thousand_levels_is_rejected(tmp_path):
    file = Glb()
    below = file.node(root=False, mesh=file.mesh(file.primitive()))
    for _ in range(1000):
        below = file.node(root=False, children=[below])
    file.doc["scenes"][0]["nodes"] = [below]
    refused(file.write(tmp_path / "hostile.glb"), "nodes")


def test_too_many_instances_of_a_mesh_are_rejected(tmp_path):
    file = Glb()
    mesh = file.mesh(file.primitive(order=np.tile(SQUARE, 50)))
    for _ in range(10_001):
        file.node(mesh=mesh)
    tracemalloc.start()
    try:
        refused(file.write(tmp_path / "hostile.glb"), "1000100 triangles")
        assert tracemalloc.get_traced_memory()[1] < 40_000_000
    finally:
        tracemalloc.stop()


def test_repeated_references_to_one_block_of_vertices_are_rejected(tmp_path):
    """A few kilobytes of JSON refer hundreds of times to one megabyte of vertices."""
    file = Glb()
    many = file.accessor(np.zeros((100_000, 3)))
    order = file.accessor([0, 1, 2], "u2")
    for k in range(300):
        file.doc["accessors"].append({**file.doc["accessors"][many], "name": str(k)})
        primitive = {"attributes": {"POSITION": len(file.doc["accessors"]) - 1}, "indices": order}
        file.node(mesh=file.mesh(primitive))
    tracemalloc.start()
    try:
        refused(file.write(tmp_path / "hostile.glb"), "vertices")
        assert tracemalloc.get_traced_memory()[1] < 60_000_000
    finally:
        tracemalloc.stop()


# ---- pictures


def test_a_picture_bomb_is_not_decoded(tmp_path):
    file = Glb()
    path = textured({"bufferView": file.view(png(60_000, 60_000)), "mimeType": "image/png"}, file).write(
        tmp_path / "hostile.glb"
    )
    tracemalloc.start()
    try:
        refused(path, "60000×60000")
        assert tracemalloc.get_traced_memory()[1] < 5_000_000
    finally:
        tracemalloc.stop()


def test_invalid_pictures_are_rejected(tmp_path):
    for data, word in (
        (png(16, 16), "images[0]"),  # the body is too short
        (png(0, 16), "0×16"),
        (b"\x89PNG\r\n\x1a\n", "PNG"),
        (b"\xff\xd8\xff\xe0\x00\x00", "PNG"),
        (b"RIFF....WEBPVP8 ", "PNG"),
        (b"", "PNG"),
        (cv2.imencode(".jpg", np.zeros((8, 8, 3), np.uint8))[1].tobytes()[:200], "images[0]"),
    ):
        uri = f"data:image/png;base64,{base64.b64encode(data).decode()}"
        refused(textured({"uri": uri}).write(tmp_path / "hostile.glb"), word)


def test_pictures_outside_the_file_are_never_opened(tmp_path):
    for uri in ("texture.png", "../secret.png", "/etc/passwd", "file:///etc/passwd", "data:,abc"):
        (tmp_path / "texture.png").write_bytes(png(1, 1, b"\0" * 4))
        refused(textured({"uri": uri}).write(tmp_path / "hostile.glb"), "images[0].uri")


def test_many_pictures_are_downscaled_to_a_total_limit(tmp_path, monkeypatch):
    monkeypatch.setattr(gltf.materials, "MAX_TEXELS", 3 * 256 * 256)
    file = Glb()
    data = cv2.imencode(".png", np.full((512, 512, 3), 77, np.uint8))[1].tobytes()
    for k in range(3):
        file.doc["images"].append({"bufferView": file.view(data), "mimeType": "image/png"})
        file.doc["textures"].append({"source": k})
        file.doc["materials"].append({"pbrMetallicRoughness": {"baseColorTexture": {"index": k}}})
    file.node(mesh=file.mesh(*(file.primitive(material=k) for k in range(3))))
    mesh = gltf.load(file.write(tmp_path / "m.glb"), (0, 0)).instances[0].mesh
    assert [m.texture.shape for m in mesh.materials if m.texture is not None] == [(256, 256, 3)] * 3


# ---- the project's own extras


def test_invalid_scene_extras_are_rejected(tmp_path):
    for facts in (
        {"sun": 3},
        {"sun": {"toward_ned": [0, 0, 0]}},
        {"origin": [91, 0, 0]},
        {"origin": "home"},
        {"spawn_ned": [1]},
        {"spawn_yaw": "north"},
        {"terrain": {"shape": [1e9, 1e9], "cell_m": 0}},
        {"terrain": {"shape": [0, 0], "cell_m": 1.0}},
    ):
        file = Glb().lawn()
        file.doc["scenes"][0]["extras"] = {"dronecats": facts}
        refused(file.write(tmp_path / "hostile.glb"), "dronecats")
