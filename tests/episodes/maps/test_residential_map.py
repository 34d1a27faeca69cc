"""Assets and the map `residential`: sound meshes, ground on the height field, paints reserved for targets."""

import itertools
import math

import numpy as np
import pytest

from episodes import maps
from episodes.maps import assets
from episodes.maps import geometry as g
from episodes.maps.assets import materials
from episodes.maps.assets.vehicles import SHAPES
from episodes.maps.residential_plan import NEAR_M, plots
from episodes.maps.scene import Mesh, Scene
from episodes.records import catalogue
from episodes.world.visibility import Solids, surface_samples
from foundation.errors import UsageError

KEPT: dict[str, Scene] = {}


@pytest.fixture
def scene() -> Scene:
    return KEPT.setdefault("residential", maps.build("residential", 1))


def volume(mesh: Mesh) -> float:
    t = mesh.vertices[mesh.triangles].astype(np.float64)
    return float(np.einsum("ij,ij->i", t[:, 0], np.cross(t[:, 1], t[:, 2])).sum() / 6)


def check(mesh: Mesh) -> None:
    assert np.isfinite(mesh.vertices).all()
    assert np.isfinite(mesh.uv).all()
    assert np.allclose(np.linalg.norm(mesh.normals, axis=1), 1.0, atol=1e-3)
    assert mesh.triangles.min() >= 0
    assert mesh.triangles.max() < len(mesh.vertices)
    assert len(mesh.material) == len(mesh.triangles)
    assert mesh.material.max() < len(mesh.materials)


def test_cars_match_their_shape_and_paint() -> None:
    for kind in sorted(SHAPES):
        mesh, shape = assets.build(kind, "cyan", "4017"), SHAPES[kind]
        check(mesh)
        low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
        assert high[0] - low[0] == pytest.approx(shape.length, abs=0.08), kind
        assert -low[2] == pytest.approx(shape.roof, abs=0.12), kind
        assert high[2] == pytest.approx(0.0, abs=1e-6), kind  # wheels on the ground
        assert low[1] == pytest.approx(-high[1], abs=1e-4), kind  # symmetric left and right
        hull = shape.length * shape.width * (shape.belt - shape.clearance)
        assert volume(mesh) > 0.7 * hull, kind  # faces point outwards
        assert any(m.name == "paint-cyan" for m in mesh.materials), kind
        assert mesh is assets.build(kind, "cyan", "4017"), kind


def test_sedans_with_different_inscriptions_differ_only_in_the_plate_material() -> None:
    a, b = assets.build("sedan", "blue", "4017"), assets.build("sedan", "blue", "3218")
    assert np.array_equal(a.vertices[:, 0].max(), b.vertices[:, 0].max())
    named = {m.name for m in a.materials} ^ {m.name for m in b.materials}
    assert named == {"plate-4017", "plate-3218"}


def test_unknown_names_are_rejected_with_suggestions() -> None:
    with pytest.raises(UsageError, match="sedan"):
        assets.build("sedann", "blue")
    with pytest.raises(UsageError, match="cyan"):
        assets.build("sedan", "cyann")
    with pytest.raises(UsageError, match="residential"):
        maps.build("residental")


def test_primitives_enclose_their_volume() -> None:
    look = materials.RIM
    cases = [
        (g.box((0, 0, 0), (2, 3, 4), look), 24.0, 1e-9),
        (g.rod((0, 0, 0), (0, 2, 0), (0.5, 0.5), look, 64), math.pi * 0.25 * 2, 0.01),
        (g.ball((0, 0, 1), (1, 1, 1), look, 3), 4 / 3 * math.pi, 0.03),
        (g.lathe([(0, 0), (1, 0), (1, 2), (0, 2)], look, 64), 2 * math.pi, 0.02),
        (g.profile([(0, 0), (2, 0), (0, 1)], -1, 2, look), 3.0, 1e-9),
        (g.mirrored(g.prism([(0, 0), (1, 0), (0, 1)], 0, 2, look)), 1.0, 1e-9),
    ]
    for part, expected, tolerance in cases:
        assert volume(g.assemble([part])) == pytest.approx(expected, rel=tolerance)


def test_balls_have_smooth_normals_and_boxes_have_sharp_edges() -> None:
    ball = g.ball((0, 0, 0), (1, 1, 1), materials.RIM, 2)
    assert np.abs(ball.normals - ball.corners).max() < 0.12
    cube = g.soup(g.box((0, 0, 0), (1, 1, 1), materials.RIM).corners, materials.RIM)
    assert np.allclose(np.abs(cube.normals).max(axis=2), 1.0)


def test_surface_samples_are_distributed_by_area() -> None:
    mesh = g.assemble([g.box((0, 0, 0), (1, 1, 9), materials.RIM)])
    points, normals = surface_samples(mesh, 500)
    assert np.allclose(np.linalg.norm(normals, axis=1), 1.0)
    top = (points[:, 2] < -8.999).mean()
    assert top == pytest.approx(1 / 38, abs=0.01)


def test_map_is_sound_and_within_budget(scene: Scene) -> None:
    assert sum(len(i.mesh.triangles) for i in scene.instances) <= 250_000
    ids = [i.id for i in scene.instances]
    assert len(set(ids)) == len(ids)
    assert min(ids) >= 1
    for mesh in {id(i.mesh): i.mesh for i in scene.instances}.values():
        check(mesh)
    kinds = {i.kind for i in scene.instances}
    assert {"ground", "house", "tree", "hedge", "fence", "lamp", "mailbox", "sedan", "suv"} <= kinds
    near = [
        i for i in scene.instances if i.kind == "house" and abs(i.position_ned[0]) < 60 and abs(i.position_ned[1]) < 30
    ]
    assert 10 <= len(near) <= 14
    assert math.hypot(*scene.sun.toward_ned) == pytest.approx(1.0)
    assert scene.sun.toward_ned[2] < -0.5


def test_ground_mesh_matches_the_height_field(scene: Scene) -> None:
    ground = Solids(i for i in scene.instances if i.kind == "ground")
    rng = np.random.default_rng(3)
    for n, e in zip(rng.uniform(-65, 65, 150), rng.uniform(-40, 40, 150), strict=True):
        if abs(abs(e) - 4.125) < 0.4:
            continue  # the kerb's vertical face is between the nodes of both grids
        down = scene.terrain.at(float(n), float(e))
        assert ground.range_m((float(n), float(e), -50.0), (0.0, 0.0, 1.0)) - 50.0 == pytest.approx(down, abs=0.03)


def test_terrain_levels_match_the_paper(scene: Scene) -> None:
    assert scene.terrain.at(0.0, 0.0) == pytest.approx(0.05)
    assert scene.terrain.at(0.0, 12.0) == pytest.approx(-0.45)
    assert scene.terrain.at(60.0, 0.0) - scene.terrain.at(0.0, 0.0) < -0.2


def test_everything_stands_on_the_ground(scene: Scene) -> None:
    for one in scene.instances:
        if one.kind not in ("ground", "house", "wood"):
            n, e, d = one.position_ned
            assert d == pytest.approx(scene.terrain.at(n, e), abs=1e-9)


def test_parked_vehicles_have_only_neutral_paints(scene: Scene) -> None:
    cars = [i for i in scene.instances if i.kind in SHAPES]
    assert len(cars) >= 8
    for car in cars:
        worn = [m.name.removeprefix("paint-") for m in car.mesh.materials if m.name.startswith("paint-")]
        assert worn
        assert set(worn) <= set(materials.SHADES)


def test_number_plates_are_unique_and_differ_from_targets(scene: Scene) -> None:
    """The targets and candidates are those of all records."""
    worn = [m.name.removeprefix("plate-") for i in scene.instances for m in i.mesh.materials if "plate-" in m.name]
    assert len(set(worn)) == len(worn) == sum(i.kind in SHAPES for i in scene.instances)
    for record in map(catalogue.load, catalogue.ids()):
        for target in (record.target, *record.candidates):
            assert not target.inscription or not any(target.inscription in text for text in worn), record.id


def test_neighbouring_houses_look_different() -> None:
    for seed in (1, 2, 3):
        homes = plots(seed)
        for a, b in itertools.combinations(homes, 2):
            if a.street is b.street and abs(a.along - b.along) < NEAR_M:
                for field in ("wall", "bricks", "roof", "door"):
                    assert getattr(a.plan, field) != getattr(b.plan, field), (seed, a.number, b.number)


def test_consecutive_cars_look_different(scene: Scene) -> None:
    cars = [i for i in scene.instances if i.kind in SHAPES]
    assert {"sedan", "estate", "hatchback", "suv", "pickup", "van"} == {i.kind for i in cars}
    looks = [frozenset((m.name, m.color) for m in i.mesh.materials if "plate-" not in m.name) for i in cars]
    assert all(a != b for a, b in itertools.pairwise(looks))


def test_same_seed_same_map(scene: Scene) -> None:
    again, other = maps.build("residential", 1), maps.build("residential", 2)
    assert np.array_equal(again.terrain.down, scene.terrain.down)
    for a, b in zip(again.instances, scene.instances, strict=True):
        assert (a.name, a.position_ned, a.yaw) == (b.name, b.position_ned, b.yaw)
        assert np.array_equal(a.mesh.vertices, b.mesh.vertices)
    houses = [[len(i.mesh.triangles) for i in s.instances if i.kind == "house"] for s in (scene, other)]
    assert houses[0] != houses[1]
