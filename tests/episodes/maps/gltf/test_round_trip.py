"""A built map, written as glTF and read back, has the same scene, bytes and picture."""

import dataclasses
import math

import numpy as np
import pytest

from episodes import maps
from episodes.camera.renderer import Renderer
from episodes.maps import assets, gltf
from episodes.maps.scene import Instance, Material, Mesh, Scene, Sun
from foundation.camera import CameraModel, CameraPose
from foundation.terrain import HeightField

VIEWS = ((0.0, 0.0, 0.0), (-30.0, 2.0, 20.0), (20.0, -1.0, 200.0), (45.0, 1.0, 170.0))  # m north, m east, yaw (°)


@pytest.fixture(scope="module")
def built():
    return maps.build("residential", 1)


@pytest.fixture(scope="module")
def loaded(built, tmp_path_factory):
    path = tmp_path_factory.mktemp("gltf") / "residential.glb"
    gltf.save(built, path)
    return gltf.load(path)


def same_mesh(a: Mesh, b: Mesh) -> bool:
    return (
        np.array_equal(a.vertices, b.vertices)
        and np.array_equal(a.normals, b.normals)
        and np.array_equal(a.uv, b.uv)
        and np.array_equal(a.triangles, b.triangles)
        and all(
            same_material(a.materials[i], b.materials[j])
            for i, j in {(int(i), int(j)) for i, j in zip(a.material, b.material, strict=True)}
        )
    )


def same_material(a: Material, b: Material) -> bool:
    plain = [dataclasses.replace(m, texture=None, cutout=None) for m in (a, b)]
    alike = all(getattr(plain[0], f.name) == getattr(plain[1], f.name) for f in dataclasses.fields(Material))
    if a.texture is None or b.texture is None:
        return alike and a.texture is b.texture
    holes = a.cutout is b.cutout or (
        a.cutout is not None and b.cutout is not None and np.array_equal(a.cutout, b.cutout)
    )
    return alike and holes and np.array_equal(a.texture, b.texture)


def test_saving_a_loaded_map_writes_the_same_bytes(loaded, built, tmp_path):
    one, two = tmp_path / "one.glb", tmp_path / "two.glb"
    gltf.save(built, one)
    gltf.save(loaded, two)
    assert one.read_bytes() == two.read_bytes()


def test_every_field_of_a_map_is_restored_exactly(built, loaded):
    for a, b in zip(built.instances, loaded.instances, strict=True):
        for name in ("id", "name", "kind", "position_ned", "yaw", "movable", "solid"):
            assert getattr(a, name) == getattr(b, name), (a.name, name)
    meshes = {id(a.mesh): (a.mesh, b.mesh) for a, b in zip(built.instances, loaded.instances, strict=True)}
    assert all(same_mesh(a, b) for a, b in meshes.values())
    assert len({id(b) for _, b in meshes.values()}) == len(meshes)  # shared meshes are still shared
    assert np.array_equal(built.terrain.down, loaded.terrain.down)
    assert dataclasses.replace(built.terrain, down=None) == dataclasses.replace(loaded.terrain, down=None)
    for name in ("latitude_deg", "longitude_deg", "altitude_m", "spawn_ned", "spawn_yaw", "notes", "name"):
        assert getattr(built, name) == getattr(loaded, name)
    assert dataclasses.asdict(built.sun) == dataclasses.asdict(loaded.sun)


@pytest.mark.parametrize(("north", "east", "degrees"), VIEWS)
def test_the_loaded_map_renders_the_same_picture_as_the_built_map(built, loaded, north, east, degrees, renderers):
    half = math.radians(degrees) / 2
    pose = CameraPose((north, east, -1.8), (math.cos(half), 0.0, 0.0, math.sin(half)))
    a, b = (renderer.render(pose) for renderer in renderers)
    assert np.array_equal(a.rgb, b.rgb)
    assert np.array_equal(a.ids, b.ids)
    assert np.array_equal(a.depth, b.depth)
    assert len(np.unique(a.ids)) > 10  # the picture is not empty


@pytest.fixture(scope="module")
def renderers(built, loaded):
    camera = CameraModel(width=640, height=360)
    made = Renderer(built, camera), Renderer(loaded, camera)
    yield made
    for one in made:
        one.close()


def small(**changes) -> Scene:
    """Return a scene whose fields all have unusual values."""
    rng = np.random.default_rng(5)
    picture = rng.integers(0, 256, (5, 7, 3), dtype=np.uint8)
    looks = (
        Material("tinted", (1.12, 0.3, 0.0), picture),
        Material("lamp", (0.2, 0.4, 0.1), emission=0.35, specular=0.55),
        Material("dark", (0.0, 0.0, 0.0), emission=1.0),
    )
    corners = rng.normal(size=(9, 3)).astype(np.float32)
    normals = corners / np.linalg.norm(corners, axis=1, keepdims=True)
    mesh = Mesh(
        vertices=corners,
        normals=normals.astype(np.float32),
        uv=rng.normal(size=(9, 2)).astype(np.float32),
        triangles=np.arange(9, dtype=np.int32).reshape(3, 3),
        material=np.array([1, 0, 1], np.int32),
        materials=looks,
    )
    car = assets.build("sedan", "red", "B 123")
    field = HeightField(-3.5, 2.25, 0.3, rng.normal(size=(4, 3)))
    things = (
        Instance(7, "Kiosk ‘München’", "kiosk", mesh, (1.5, -2.25, -0.1), 6.2),
        Instance(3, "target", "sedan", car, (0.0, 0.0, 0.0), -1.1, movable=True),
        Instance(900, "ghost", "ground", mesh, (-0.0, 1e-9, 3.0), 0.0, solid=False),
    )
    sun = Sun((0.6, 0.0, -0.8), (1.0, 0.5, 0.25), 1.7, (0.1, 0.2, 0.3), 0.25, (0.5, 0.2, 0.1))
    scene = Scene("small", things, field, sun, -33.9, 151.2, 12.5, (0.1, 0.2, 0.3), 0.7, ("One.", "Two."))
    return dataclasses.replace(scene, **changes)


def test_unusual_values_are_restored_exactly(tmp_path):
    scene, path = small(), tmp_path / "small.glb"
    gltf.save(scene, path)
    back = gltf.load(path)
    for a, b in zip(scene.instances, back.instances, strict=True):
        assert same_mesh(a.mesh, b.mesh)
        for name in ("id", "name", "kind", "position_ned", "yaw", "movable", "solid"):
            assert getattr(a, name) == getattr(b, name)
    assert back.instances[0].mesh is back.instances[2].mesh
    assert dataclasses.asdict(scene.sun) == dataclasses.asdict(back.sun)
    assert np.array_equal(scene.terrain.down, back.terrain.down)
    assert (back.spawn_ned, back.spawn_yaw, back.notes) == (scene.spawn_ned, scene.spawn_yaw, scene.notes)


def test_trimesh_reads_the_same_geometry(tmp_path):
    """The axes of the file: north is −Z, east is +X, up is +Y."""
    import trimesh

    scene, path = small(), tmp_path / "small.glb"
    gltf.save(scene, path)
    theirs = trimesh.load_scene(path)
    low, high = gltf.reader.extent(scene)
    assert np.allclose(theirs.bounds, [(low[1], -high[2], -high[0]), (high[1], -low[2], -low[0])], atol=1e-5)
    assert sum(len(g.faces) * len(theirs.graph.geometry_nodes[k]) for k, g in theirs.geometry.items()) == sum(
        len(i.mesh.triangles) for i in scene.instances
    )


def test_changes_by_another_program_override_our_extras(tmp_path):
    import json
    import struct

    scene, path = small(), tmp_path / "small.glb"
    gltf.save(scene, path)
    data = path.read_bytes()
    span = struct.unpack("<I", data[12:16])[0]
    doc, rest = json.loads(data[20 : 20 + span]), data[20 + span :]
    doc["nodes"][0]["rotation"] = [0.0, math.sin(0.25), 0.0, math.cos(0.25)]  # 0.5 rad, counter-clockwise
    doc["nodes"][1]["translation"] = [4.0, 0.5, -6.0]
    doc["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] = [0.5, 0.25, 0.125, 1.0]
    text = json.dumps(doc).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + rest
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
    back = gltf.load(path)
    assert back.instances[0].yaw == pytest.approx(-0.5)
    assert back.instances[1].position_ned == (6.0, 4.0, -0.5)
    first = next(m for m in back.instances[0].mesh.materials if m.name == doc["materials"][0]["name"])
    assert first.color == (0.5, 0.25, 0.125)
