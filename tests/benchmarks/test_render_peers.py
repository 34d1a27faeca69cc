"""The benchmark of other renderers: they get our scene, and one that draws another scene is not timed."""

import json
import math

import numpy as np
import pytest

from benchmarks import render_peers as peers
from benchmarks.render import export
from episodes.camera.renderer import Renderer
from episodes.maps.scene import Material
from foundation.camera import CameraModel
from tests.benchmarks.peer_environments import make_environments
from tests.episodes.camera.renderer.scenes import box_mesh, instance, looking, scene_of

CAMERA = CameraModel(1280, 720)
RED = Material("red", (0.5, 0.0, 0.0), np.full((4, 4, 3), 188, np.uint8))


@pytest.fixture
def exported(tmp_path):
    """A box of 2 × 1 × 4 m, 10 m north and 3 m east, and another that shares its mesh."""
    mesh = box_mesh(2.0, 1.0, 4.0, RED)
    scene = scene_of([instance(1, mesh, (10.0, 3.0, -1.0)), instance(2, mesh, (20.0, -4.0, 0.0))])
    poses = [looking((0.0, 0.0, -2.0)), looking((0.0, 0.0, -2.0), 180.0)]
    export(scene, poses, CAMERA, tmp_path)
    return tmp_path, json.loads((tmp_path / "scene.json").read_text(encoding="utf-8")), scene, poses


def corners_of(folder, piece):
    """Return the (T, 3, 3) corners of a piece, placed in the world: north, west, up."""
    rows = [line.split() for line in (folder / piece["file"]).read_text().splitlines()]
    v = np.array([[float(x) for x in r[1:]] for r in rows if r[0] == "v"])
    faces = np.array([[int(c.split("/")[0]) - 1 for c in r[1:]] for r in rows if r[0] == "f"])
    c, s = math.cos(piece["yaw"]), math.sin(piece["yaw"])
    return (v @ np.array([(c, s, 0.0), (-s, c, 0.0), (0.0, 0.0, 1.0)]) + piece["position"])[faces]


def test_exported_triangles_have_our_positions_and_face_outwards(exported):
    folder, document, scene, _ = exported
    assert document["triangles"] == sum(len(i.mesh.triangles) for i in scene.instances) == 24
    assert len({piece["file"] for piece in document["pieces"]}) == 1
    corners = corners_of(folder, document["pieces"][0])
    assert corners.reshape(-1, 3).min(axis=0) == pytest.approx((9.0, -3.5, 1.0))
    assert corners.reshape(-1, 3).max(axis=0) == pytest.approx((11.0, -2.5, 5.0))
    outwards = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert ((outwards * (corners.mean(axis=1) - (10.0, -3.0, 3.0))).sum(axis=1) > 0.0).all()


def test_a_texture_becomes_its_mean_colour(exported):
    red, green, blue = exported[1]["pieces"][0]["color"]
    assert red**2.2 == pytest.approx(0.5 * (188 / 255) ** 2.2, rel=1e-3)
    assert green == blue == 0.0


def test_the_exported_view_projects_the_box_to_our_pixels(exported):
    """A pinhole camera with the exported axes and field of view projects the corners to the border of our ids."""
    folder, document, scene, poses = exported
    view = document["views"][0]
    away = corners_of(folder, document["pieces"][0]).reshape(-1, 3) - view["eye"]
    focal = 360.0 / math.tan(math.radians(document["vfov_deg"]) / 2.0)
    x = 640 + focal * (away @ view["right"]) / (away @ view["forward"])
    y = 360 - focal * (away @ view["up"]) / (away @ view["forward"])
    ids = Renderer(scene, CAMERA, shadow_cells=64).render(poses[0]).ids
    rows, columns = np.nonzero(ids == 1)
    assert (columns.min(), columns.max() + 1) == pytest.approx((x.min(), x.max()), abs=1.0)
    assert (rows.min(), rows.max() + 1) == pytest.approx((y.min(), y.max()), abs=1.0)
    assert document["covered"][1] == 0.0
    assert document["covered"][0] == pytest.approx((ids > 0).mean(), abs=0.005)


def test_a_peer_that_draws_another_scene_is_not_timed():
    scene = {"covered": [0.5, 0.6], "views": [{}, {}]}
    drawn = []
    figures = peers.timed(lambda view, size: drawn.append((view, size)), lambda view: (0.51, 0.59)[view], scene)
    assert set(figures) == {"ms_1280x720", "ms_640x360", "cpu_ms_1280x720", "cpu_ms_640x360"}
    assert {view for view, _ in drawn} == {0, 1}
    with pytest.raises(RuntimeError, match=r"0\.000 of view 1"):
        peers.timed(lambda view, size: None, lambda view: (0.51, 0.0)[view], scene)


def test_absent_or_broken_peers_get_a_note_and_the_others_get_ratios(tmp_path, monkeypatch):
    kept = tmp_path / "exported"
    kept.mkdir()
    answer = {"ms_1280x720": 500.0, "ms_640x360": 90.0}
    monkeypatch.setattr(peers, "PEERS", dict.fromkeys(("works", "breaks", "absent")))
    scripts = {
        "works": f"import sys; open(sys.argv[3] + '/picture.npy', 'w')\nprint({json.dumps(json.dumps(answer))})",
        "breaks": "raise ImportError('no libOSMesa')",
    }
    make_environments(tmp_path, scripts)
    comparison = peers.compare(tmp_path, kept, lambda: {"ms_1280x720": 100.0, "ms_640x360": 30.0})
    assert comparison["absent"].keys() == {"note"}
    assert "no libOSMesa" in comparison["breaks"]["note"]
    assert comparison["works"]["over_ours_ms_1280x720"] == 5.0
    assert comparison["works"]["over_ours_ms_640x360"] == 3.0
    assert (tmp_path / "works.npy").exists()
