"""Maps from files of other programs. Their exporters write the same geometry in several ways."""

import base64
import math
from typing import Any

import cv2
import numpy as np
import pytest

from episodes.maps import gltf
from episodes.world.obstacles import obstacles
from episodes.world.visibility import Solids
from foundation.errors import UsageError
from tests.episodes.maps.gltf.files import LAWN, SQUARE, Glb, block

FACES_UP = np.array([(0, 0, 1), (1, 0, 1), (0, 0, 0)], np.float32)  # a triangle of 0.5 m², glTF axes


def picture(rgb, kind=".png", size=8, alpha=None) -> bytes:
    image = np.full((size, size, 3), rgb[::-1], np.uint8)
    if alpha is not None:
        image = np.dstack([image, alpha.astype(np.uint8)])
    return cv2.imencode(kind, image)[1].tobytes()


def thing(scene, name):
    return next(one for one in scene.instances if one.name == name)


def corners(one) -> np.ndarray:
    """Return an instance's triangles (T, 3, 3) in NED."""
    c, s = math.cos(one.yaw), math.sin(one.yaw)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    placed: np.ndarray = one.mesh.vertices.astype(float) @ turn.T + np.array(one.position_ned)
    placed_corners: np.ndarray = placed[one.mesh.triangles]
    return placed_corners


def normals_outward(one) -> bool:
    tri = corners(one)
    volume = np.einsum("ij,ij->i", tri[:, 0] - tri.mean(axis=(0, 1)), np.cross(tri[:, 1], tri[:, 2])).sum()
    return bool(volume > 0)


def test_a_single_ground_mesh_is_a_map(tmp_path):
    scene = gltf.load(Glb().lawn().write(tmp_path / "a lawn.glb"), (0.0, 0.0))
    assert scene.name == "a-lawn"
    assert [one.kind for one in scene.instances] == ["ground"]
    assert scene.spawn_ned == (0.0, 0.0, 0.0)
    assert np.allclose(scene.terrain.down, 0.0)
    assert np.allclose(thing(scene, "Lawn").mesh.normals, (0.0, 0.0, -1.0))  # flat normals, if the file has none


def test_minus_z_is_north_x_is_east_and_y_is_up(tmp_path):
    file = Glb().lawn()
    file.node(name="Mast", translation=[5.0, 2.0, -7.0], mesh=file.mesh(file.primitive(FACES_UP, [0, 1, 2])))
    mast = thing(gltf.load(file.write(tmp_path / "m.glb"), (0, 0)), "Mast")
    assert mast.position_ned == (7.0, 5.0, -2.0)
    assert np.allclose(corners(mast)[0], [(6.0, 5.0, -2.0), (6.0, 6.0, -2.0), (7.0, 5.0, -2.0)])


def test_indices_of_each_component_type_are_read(tmp_path):
    for component in ("u1", "u2", "u4"):
        file = Glb()
        file.node(mesh=file.mesh(file.primitive(component=component)))
        assert len(gltf.load(file.write(tmp_path / "m.glb"), (0, 0)).instances[0].mesh.triangles) == 2, component


def test_strips_and_fans_give_the_same_triangles(tmp_path):
    for mode, order in ((4, [0, 1, 2, 0, 2, 3]), (5, [0, 1, 3, 2]), (6, [0, 1, 2, 3])):
        file = Glb()
        file.node(mesh=file.mesh(file.primitive(order=order, mode=mode)))
        scene = gltf.load(file.write(tmp_path / "m.glb"), (0, 0))
        tri = corners(scene.instances[0])
        area = np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0])
        assert np.allclose(area, [(0, 0, -1600.0)] * 2), mode  # both triangles face up


def test_a_primitive_without_indices_is_read(tmp_path):
    file = Glb()
    file.node(mesh=file.mesh(file.primitive(LAWN[SQUARE], order=None)))
    assert len(gltf.load(file.write(tmp_path / "m.glb"), (0, 0)).instances[0].mesh.triangles) == 2


def test_points_and_lines_are_omitted_with_a_note(tmp_path):
    file = Glb().lawn()
    file.node(mesh=file.mesh(file.primitive(mode=1), file.primitive(mode=0)))
    scene = gltf.load(file.write(tmp_path / "m.glb"), (0, 0))
    assert len(scene.instances) == 1
    assert any("2 sets" in note for note in scene.notes)


def test_nested_node_transforms_are_combined(tmp_path):
    """The transforms are a matrix, a rotation and a scale, in three levels of nodes."""
    file = Glb().lawn()
    box = block((1.0, 1.0, 1.0))
    mesh = file.mesh(file.primitive(box.vertices, box.faces.ravel()))
    turn = [0.0, math.sin(math.radians(15)), 0.0, math.cos(math.radians(15))]
    child = file.node(root=False, name="cube", mesh=mesh, scale=[1.0, 3.0, 2.0])
    middle = file.node(root=False, children=[child], rotation=turn)
    file.node(children=[middle], matrix=[2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0, 4, 1, -6, 1])
    scene = gltf.load(file.write(tmp_path / "m.glb"), (0, 0))
    cube = thing(scene, "cube")
    spots = corners(cube).reshape(-1, 3)
    assert spots[:, 2].max() == pytest.approx(-1.0, abs=1e-5)  # 1 m above the ground
    assert spots[:, 2].min() == pytest.approx(-7.0, abs=1e-5)  # 3 · 2 m tall
    c, s = math.cos(math.radians(30)), math.sin(math.radians(30))
    east, north = 1.0 * c + 2.0 * s, 1.0 * s + 2.0 * c  # half widths of the turned 2 m × 4 m footprint
    assert (spots[:, 1].min(), spots[:, 1].max()) == pytest.approx((4.0 - east, 4.0 + east), abs=1e-5)
    assert (spots[:, 0].min(), spots[:, 0].max()) == pytest.approx((6.0 - north, 6.0 + north), abs=1e-5)
    assert normals_outward(cube)


def test_faces_of_a_mirrored_node_point_outwards(tmp_path):
    file = Glb().lawn()
    box = block((1.0, 2.0, 3.0))
    mesh = file.mesh(file.primitive(box.vertices, box.faces.ravel()))
    for name, scale in (("plain", [1, 1, 1]), ("mirrored", [-1, 1, 1])):
        file.node(name=name, mesh=mesh, scale=scale, translation=[3.0 * scale[0], 0, 0])
    scene = gltf.load(file.write(tmp_path / "m.glb"), (0, 0))
    assert normals_outward(thing(scene, "plain"))
    assert normals_outward(thing(scene, "mirrored"))
    tri = corners(thing(scene, "mirrored"))
    face = np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0])
    one = thing(scene, "mirrored").mesh
    assert (np.einsum("ij,ij->i", face, one.normals[one.triangles[:, 0]]) > 0).all()


def test_instances_of_one_mesh_share_it(tmp_path):
    file = Glb().lawn()
    mesh = file.mesh(file.primitive(FACES_UP + np.array([0, 1, 0]), [0, 1, 2]))
    for k in range(3):
        turn = [0.0, math.sin(k / 2), 0.0, math.cos(k / 2)]
        file.node(name="Sign", mesh=mesh, translation=[k, 0, 0], rotation=turn)
    scene = gltf.load(file.write(tmp_path / "m.glb"), (0, 0))
    signs = [one for one in scene.instances if one.kind == "sign"]
    assert len({id(one.mesh) for one in signs}) == 1
    assert [one.yaw for one in signs] == pytest.approx([0.0, -1.0, -2.0])  # glTF turns counter-clockwise
    assert len({one.name for one in signs}) == 3


def test_a_node_with_scale_zero_is_omitted_with_a_note(tmp_path):
    file = Glb().lawn()
    file.node(mesh=0, scale=[0, 0, 0])
    scene = gltf.load(file.write(tmp_path / "m.glb"), (0, 0))
    assert len(scene.instances) == 1
    assert scene.notes


@pytest.mark.parametrize("kind", [".png", ".jpg"])
@pytest.mark.parametrize("embedded", ["bufferView", "data URI"])
def test_embedded_textures_are_read(tmp_path, kind, embedded):
    file = Glb()
    data, mime = picture((200, 40, 10), kind), "image/png" if kind == ".png" else "image/jpeg"
    if embedded == "bufferView":
        file.doc["images"].append({"bufferView": file.view(data), "mimeType": mime})
    else:
        file.doc["images"].append({"uri": f"data:{mime};base64,{base64.b64encode(data).decode()}"})
    file.doc["textures"].append({"source": 0})
    file.doc["materials"].append({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "texCoord": 1}}})
    uv = file.accessor([(0, 0), (255, 0), (255, 255), (0, 255)], "u1", normalized=True)
    file.node(mesh=file.mesh(file.primitive(material=0, attributes={"TEXCOORD_1": uv})))
    mesh = gltf.load(file.write(tmp_path / "m.glb"), (0, 0)).instances[0].mesh
    (texture,) = (material.texture for material in mesh.materials)
    assert texture is not None
    assert np.abs(texture.reshape(-1, 3).astype(int) - (200, 40, 10)).max() <= 6
    assert np.allclose(np.unique(mesh.uv, axis=0), [(0, 0), (0, 1), (1, 0), (1, 1)])


def test_the_texture_transform_is_applied(tmp_path):
    file = Glb()
    file.doc["images"].append({"bufferView": file.view(picture((9, 9, 9))), "mimeType": "image/png"})
    file.doc["textures"].append({"source": 0})
    moved = {"offset": [0.5, 0.25], "rotation": math.pi / 2, "scale": [2.0, 3.0]}
    texture = {"index": 0, "extensions": {"KHR_texture_transform": moved}}
    file.doc["materials"].append({"pbrMetallicRoughness": {"baseColorTexture": texture}})
    uv = file.accessor([(0, 0), (1, 0), (1, 1), (0, 1)])
    file.node(mesh=file.mesh(file.primitive(material=0, attributes={"TEXCOORD_0": uv})))
    mesh = gltf.load(file.write(tmp_path / "m.glb"), (0, 0)).instances[0].mesh
    coordinates = {tuple(np.round(row, 4)) for row in mesh.uv}
    # The rotation is counter-clockwise in the image, with v down: (2, 0) → (0, −2) and (0, 3) → (3, 0).
    assert coordinates == {(0.5, 0.25), (0.5, -1.75), (3.5, -1.75), (3.5, 0.25)}


def test_alpha_below_the_cutoff_is_cut_out(tmp_path):
    alpha = np.full((8, 8), 100)
    alpha[:, :4] = 255
    image = np.zeros((8, 8, 3), np.uint8)
    image[:, :4] = (30, 160, 20)
    file = Glb()
    data = cv2.imencode(".png", np.dstack([image[..., ::-1], alpha.astype(np.uint8)]))[1].tobytes()
    file.doc["images"].append({"bufferView": file.view(data), "mimeType": "image/png"})
    file.doc["textures"].append({"source": 0})
    look = {"baseColorTexture": {"index": 0}}
    modes: tuple[dict[str, Any], ...] = (
        {"alphaMode": "MASK"}, {"alphaMode": "MASK", "alphaCutoff": 0.3}, {"alphaMode": "BLEND"}, {},
    )  # fmt: skip
    file.doc["materials"] = [{"pbrMetallicRoughness": look, **mode} for mode in modes]
    file.node(mesh=file.mesh(*(file.primitive(material=k) for k in range(4))))
    masked, low, blended, opaque = gltf.load(file.write(tmp_path / "m.glb"), (0, 0)).instances[0].mesh.materials
    assert masked.cutout is not None
    assert opaque.texture is not None
    assert np.array_equal(masked.cutout, alpha == 255)
    # Transparent pixels get the colour of opaque ones, because they show a little at the edges of holes.
    assert np.all(masked.texture == (30, 160, 20))
    assert np.all(blended.texture == (30, 160, 20))
    assert low.cutout is blended.cutout is opaque.cutout is None
    assert np.all(opaque.texture[:, 4:] == 0)
    assert not masked.foliage


def test_vertex_colours_multiply_the_material_colour(tmp_path):
    file = Glb()
    file.doc["materials"].append({"pbrMetallicRoughness": {"baseColorFactor": [1.0, 0.5, 0.0, 1.0]}})
    colour = file.accessor([(0, 255, 255, 255)] * 4, "u1", normalized=True)
    file.node(mesh=file.mesh(file.primitive(material=0, attributes={"COLOR_0": colour})))
    (material,) = gltf.load(file.write(tmp_path / "m.glb"), (0, 0)).instances[0].mesh.materials
    assert material.color == pytest.approx((0.0, 0.5, 0.0))


def test_materials_keep_roughness_emission_and_diffuse_colour(tmp_path):
    file = Glb()
    file.doc["materials"] = [
        {"pbrMetallicRoughness": {"roughnessFactor": 0.25}},
        {"pbrMetallicRoughness": {"baseColorFactor": [0, 0, 0, 1]}, "emissiveFactor": [1.0, 0.5, 0.25]},
        {"extensions": {"KHR_materials_pbrSpecularGlossiness": {"diffuseFactor": [0.1, 0.2, 0.3, 1]}}},
        {},
    ]
    file.node(mesh=file.mesh(*(file.primitive(material=k) for k in range(4))))
    smooth, lamp, older, plain = gltf.load(file.write(tmp_path / "m.glb"), (0, 0)).instances[0].mesh.materials
    assert smooth.specular == pytest.approx(0.75)
    assert (lamp.color, lamp.emission) == ((1.0, 0.5, 0.25), 1.0)
    assert older.color == (0.1, 0.2, 0.3)
    assert (plain.color, plain.specular, plain.emission) == ((1.0, 1.0, 1.0), 0.0, 0.0)


def test_quantised_positions_are_scaled(tmp_path):
    file = Glb()
    file.doc["extensionsRequired"] = ["KHR_mesh_quantization"]
    raw = np.array([(-127, 0, 127), (127, 0, 127), (127, 0, -127), (-127, 0, -127)])
    primitive = {"attributes": {"POSITION": file.accessor(raw, "i1", normalized=True)}, "indices": 1}
    file.accessor(SQUARE, "u1")
    file.node(mesh=file.mesh(primitive), scale=[20, 20, 20])
    scene = gltf.load(file.write(tmp_path / "m.glb"), (0, 0))
    assert gltf.reader.extent(scene)[1] == pytest.approx((20.0, 20.0, 0.0))


# ---- the ground


def hill(size=41, extent=40.0):
    """Return the positions and the indices of a bumpy square of ground that faces up (glTF axes)."""
    line = np.linspace(-extent / 2, extent / 2, size)
    x, z = np.meshgrid(line, line, indexing="ij")
    y = 1.5 * np.sin(x / 6) * np.cos(z / 5)
    k = np.arange(size * size).reshape(size, size)
    a, b, c, d = k[:-1, :-1].ravel(), k[1:, :-1].ravel(), k[1:, 1:].ravel(), k[:-1, 1:].ravel()
    order = np.concatenate([np.stack([a, d, c], 1), np.stack([a, c, b], 1)])
    return np.stack([x, y, z], axis=-1).reshape(-1, 3), order.ravel()


def test_the_height_field_matches_the_drawn_hills(tmp_path):
    file = Glb()
    positions, order = hill()
    file.node(name="Terrain", mesh=file.mesh(file.primitive(positions, order)))
    scene = gltf.load(file.write(tmp_path / "m.glb"), (3.0, -4.0))
    assert [one.kind for one in scene.instances] == ["ground"]
    solids = Solids(scene.instances)
    for north, east in np.random.default_rng(1).uniform(-19, 19, (200, 2)):
        drawn = -50.0 + solids.range_m((north, east, -50.0), (0.0, 0.0, 1.0))
        assert scene.terrain.at(north, east) == pytest.approx(drawn, abs=0.03)
    assert scene.spawn_ned[2] == pytest.approx(scene.terrain.at(3.0, -4.0), abs=0.02)


def test_roofs_bridges_and_table_tops_are_not_ground_even_in_one_mesh(tmp_path):
    """The file holds a village as a single mesh, as scanners and some asset shops deliver it."""
    import trimesh

    parts = [block((60, 0.5, 60))]
    parts[0].apply_translation((0, -0.5, 0))
    house = block((8, 5, 6))
    house.apply_translation((12, 0, -10))
    bridge = block((4, 0.3, 30))
    bridge.apply_translation((-10, 4, 0))
    kerb = block((60, 0.15, 2))
    kerb.apply_translation((0, 0, 10))
    village = trimesh.util.concatenate([*parts, house, bridge, kerb])
    assert isinstance(village, trimesh.Trimesh)
    file = Glb()
    file.node(name="Village", mesh=file.mesh(file.primitive(village.vertices, village.faces.ravel(), "u2")))
    scene = gltf.load(file.write(tmp_path / "m.glb"), (0, 0))
    assert scene.terrain.at(0.0, -10.0) == pytest.approx(0.0, abs=0.01)  # under the bridge
    assert scene.terrain.at(10.0, 12.0) == pytest.approx(0.0, abs=0.01)  # under the house
    assert scene.terrain.at(-10.0, 20.0) == pytest.approx(-0.15, abs=0.01)  # on the kerb
    soil, rest = thing(scene, "Village ground"), thing(scene, "Village")
    assert soil.kind == "ground"
    assert len(soil.mesh.triangles) + len(rest.mesh.triangles) == len(village.faces)
    assert len(soil.mesh.triangles) == 4  # the top faces of slab and kerb
    hit = obstacles(scene)
    tops = hit.corners.reshape(-1, 3, 3)[:, :, 2].min()
    assert tops == pytest.approx(-5.0)  # a drone can still hit the house
    assert len(hit.corners) == len(rest.mesh.triangles)


def test_a_spawn_without_height_is_on_the_lowest_floor_with_headroom(tmp_path):
    file = Glb().lawn()
    low = block((6, 0.2, 6))
    file.node(name="shelf", translation=[0, 1.0, 0], mesh=file.mesh(file.primitive(low.vertices, low.faces.ravel())))
    path = file.write(tmp_path / "m.glb")
    assert gltf.load(path, (0, 0)).spawn_ned[2] == pytest.approx(-1.2, abs=1e-4)
    assert gltf.load(path, (0, 0, 0.0)).spawn_ned[2] == pytest.approx(0.0, abs=1e-4)
    assert gltf.load(path, (9, 9)).spawn_ned[2] == pytest.approx(0.0, abs=1e-4)


def test_ground_with_reversed_winding_is_still_ground(tmp_path):
    file = Glb()
    file.node(mesh=file.mesh(file.primitive(order=SQUARE[::-1])))
    scene = gltf.load(file.write(tmp_path / "m.glb"), (0, 0))
    assert [one.kind for one in scene.instances] == ["ground"]


def test_custom_properties_set_kind_and_solidity(tmp_path):
    file = Glb().lawn()
    extras = {"dronecats_kind": "bench", "dronecats_solid": 0}
    file.node(name="Bank", mesh=file.mesh(file.primitive(FACES_UP + np.array([0, 1, 0]), [0, 1, 2])), extras=extras)
    odd = {"dronecats_kind": 3, "dronecats_solid": "no", "dronecats_id": -1, "dronecats_yaw": [1]}
    file.node(name="Oak tree.012", mesh=1, extras=odd)
    scene = gltf.load(file.write(tmp_path / "m.glb"), (0, 0))
    assert (thing(scene, "Bank").kind, thing(scene, "Bank").solid) == ("bench", False)
    assert (thing(scene, "Oak tree.012").kind, thing(scene, "Oak tree.012").solid) == ("oak-tree", True)


@pytest.mark.parametrize(
    ("spawn", "reason"), [((500, 0), "^spawn 500, 0 "), (None, r"m\.glb' .*\bspawn\b"), ((19.0, 0.0), "spawn 19, 0:")]
)
def test_a_spawn_must_be_on_the_map_and_over_ground(tmp_path, spawn, reason):
    file = Glb()
    wall = np.array([(-20, 0, -20), (20, 0, -20), (20, 9, -20), (-20, 9, -20)], np.float32)
    file.node(mesh=file.mesh(file.primitive(LAWN[[0, 1, 2, 3]] * [1, 1, 0.5]), file.primitive(wall)))
    with pytest.raises(UsageError, match=reason):
        gltf.load(file.write(tmp_path / "m.glb"), spawn)
