"""Objects of the campus: faces point outwards, feet reach the ground, sizes are realistic."""

import numpy as np
import pytest
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

from episodes.maps import assets
from episodes.maps.assets import buildings, service_vehicles
from episodes.maps.campus_plan import HALLS
from episodes.maps.scene import Mesh
from foundation.errors import UsageError

DRIVEN = {"delivery_robot": service_vehicles.delivery_robot, "service_cart": service_vehicles.service_cart}
RAYS = 4000
# kind → length along its forward axis, width, height (m), as in products on the market
SIZES = {
    "bench": (0.7, 2.6, 1.0),
    "bike-rack": (2.4, 4.5, 2.4),
    "bin": (0.7, 1.3, 1.4),
    "bollard": (0.26, 0.26, 1.05),
    "clock-tower": (5.2, 5.2, 26.8),
    "fountain": (5.1, 5.1, 2.4),
    "kiosk": (3.6, 3.7, 3.8),
    "lamp": (1.1, 1.7, 5.1),
    "notice-board": (0.85, 2.8, 2.5),
    "picnic-table": (3.1, 3.1, 2.6),
    "planter": (2.0, 2.0, 1.7),
    "statue": (2.1, 2.1, 4.4),
    "vending-machine": (0.9, 1.24, 2.07),
}


def facing_share(mesh: Mesh, seed: int = 1) -> float:
    """Return the share of outside rays that hit a triangle on its front."""
    rng = np.random.default_rng(seed)
    corners = mesh.vertices[mesh.triangles].astype(np.float64)
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    reach = float(np.linalg.norm(high - low))
    way = rng.normal(size=(RAYS, 3))
    way[:, 2] = np.abs(way[:, 2]) * 0.6  # from above or level: no camera looks from below the ground
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    start = rng.uniform(low, high, (RAYS, 3)) - way * reach
    scene = EmbreeScene()
    TriangleMesh(
        scene, corners.reshape(-1, 3).astype(np.float32), np.arange(3 * len(corners), dtype=np.int32).reshape(-1, 3)
    )
    hit = scene.run(start.astype(np.float32), way.astype(np.float32), output=1)["primID"]
    met: NDArray[np.int64] = np.flatnonzero(hit >= 0)
    assert len(met) > RAYS / 50
    t = corners[hit[met]]
    normal = np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0])
    return float((np.einsum("ij,ij->i", normal, way[met]) < 0.0).mean())


def test_fixtures_have_realistic_sizes_grounded_feet_and_outward_faces() -> None:
    for kind in sorted(assets.FIXTURES):
        mesh = assets.FIXTURES[kind]()
        size = np.ptp(mesh.vertices, axis=0)
        assert size == pytest.approx(np.array(SIZES[kind]), abs=0.12 + 0.02 * max(SIZES[kind])), kind
        assert 0.0 <= mesh.vertices[:, 2].max() <= 0.45, kind  # feet end on the ground or a little below it
        assert facing_share(mesh.without_foliage()) > 0.97, kind
        assert np.allclose(np.linalg.norm(mesh.normals, axis=1), 1.0, atol=1e-3), kind


@pytest.mark.parametrize("name", sorted(DRIVEN))
def test_driven_fixtures_have_wheels_on_the_ground_and_show_their_paint(name: str) -> None:
    mesh, other = DRIVEN[name]("white"), DRIVEN[name]("orange")
    assert mesh.vertices[:, 2].max() == pytest.approx(0.0, abs=1e-6)  # wheels on the ground
    assert np.array_equal(mesh.vertices, other.vertices)
    assert {m.name for m in mesh.materials} ^ {m.name for m in other.materials} == {"paint-white", "paint-orange"}
    assert facing_share(mesh) > 0.97
    painted = np.array([m.name == "paint-white" for m in mesh.materials])[mesh.material]
    t = mesh.vertices[mesh.triangles].astype(np.float64)
    area = np.linalg.norm(np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]), axis=1)
    assert area[painted].sum() > 0.3 * area.sum()  # enough to identify its colour
    with pytest.raises(UsageError, match="orange"):
        DRIVEN[name]("orang")


@pytest.mark.parametrize("plan", [plan for plan, *_ in HALLS], ids=lambda plan: plan.name)
def test_halls_match_their_plan(plan: buildings.HallPlan) -> None:
    mesh = buildings.hall(plan)
    forward, back, side = buildings.reach(plan)
    assert mesh.vertices[:, 0].max() <= forward
    assert -mesh.vertices[:, 0].min() <= back + 1.0  # a roof's edge overhangs
    assert np.abs(mesh.vertices[:, 1]).max() <= side + 1.0
    assert 3 <= plan.storeys <= 5
    assert -mesh.vertices[:, 2].min() >= plan.top
    assert facing_share(mesh) > 0.99
    assert any(m.name == f"words-{plan.name}" for m in mesh.materials)


@pytest.mark.parametrize("plan", [plan for plan, *_ in HALLS], ids=lambda plan: plan.name)
def test_nothing_blocks_the_doors_of_a_hall(plan: buildings.HallPlan) -> None:
    """A ray from 3 m in front of a door hits the door first."""
    mesh = buildings.hall(plan)
    corners = mesh.vertices[mesh.triangles].astype(np.float32)
    scene = EmbreeScene()
    TriangleMesh(
        scene, np.ascontiguousarray(corners.reshape(-1, 3)), np.arange(3 * len(corners), dtype=np.int32).reshape(-1, 3)
    )
    places = [(y, z) for y in (-1.9, -1.2, -0.5, 0.5, 1.2, 1.9) for z in (0.2, 1.0, 2.2)]
    start = np.array([(plan.depth / 2 + 3.0, y, -buildings.FLOOR_M - z) for y, z in places], np.float32)
    way = np.tile(np.array((-1.0, 0.0, 0.0), np.float32), (len(start), 1))
    hit = scene.run(start, way, output=1)["primID"]
    assert {mesh.materials[mesh.material[k]].name for k in hit} == {"doors"}
