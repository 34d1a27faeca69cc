"""User maps are stored under a name, listed, rendered, solid and flown like shipped maps."""

import json
import math

import numpy as np
import pytest

from dronecats.cli.main import main
from episodes import maps
from episodes.camera.renderer import Renderer
from episodes.maps import gltf, user
from episodes.records import record
from episodes.world.obstacles import obstacles
from episodes.world.world import World
from foundation.camera import CameraModel, CameraPose
from foundation.errors import UsageError
from tests.episodes.maps.gltf.files import Glb, block
from tests.support.flight import fly_simulated


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv(user.FOLDER, str(tmp_path / "maps"))
    return tmp_path / "maps"


@pytest.fixture
def yard(tmp_path):
    """Return the path of a .glb that trimesh writes: a yard with a shed and a wall, without extras."""
    import trimesh

    scene = trimesh.Scene()
    slab = block((80, 1, 80), (110, 120, 90))
    slab.apply_translation((0, -1, 0))
    shed = block((4, 3, 6), (150, 60, 40))
    wall = block((12, 2, 0.4), (200, 200, 190))
    scene.add_geometry(slab, node_name="slab")
    scene.add_geometry(shed, node_name="Shed.001", transform=trimesh.transformations.translation_matrix((9, 0, -9)))
    turned = trimesh.transformations.rotation_matrix(math.radians(30), (0, 1, 0))
    turned[:3, 3] = (-8, 0, -14)
    scene.add_geometry(wall, node_name="wall", transform=turned)
    path = tmp_path / "yard.glb"
    path.write_bytes(scene.export(file_type="glb"))
    return path


def a_record(name: str) -> record.EpisodeRecord:
    """Return an episode on the map `name`, with a red SUV 16.5 m from the start."""
    target, start = (17.0, 1.0, 0.0), (0.5, 0.0, -1.5)
    return record.EpisodeRecord(
        version=record.VERSION,
        id="yard-approaching-01",
        map=name,
        map_seed=1,
        cell="approaching",
        instruction="go to the red SUV",
        target=record.TargetRecord("suv", "red", None, target, 40.0),
        starts=(record.StartPose(start, 0.0),),
        start_distance_m=16.5,
        bearing_deg=3.5,
        visible_at_start=True,
        seed=1,
    )


def test_an_imported_map_is_listed_shown_and_replaceable(folder, yard, capsys):
    assert main(["maps", "import", str(yard), "--name", "my-yard", "--spawn", "0,0"]) == 0
    assert "2 m north, east, down" not in capsys.readouterr().out
    assert maps.names() == [*maps.shipped(), "my-yard"]
    assert main(["maps", "list", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["maps"]
    assert {"name": "my-yard", "origin": "yours"} in rows
    assert {"name": "residential", "origin": "shipped"} in rows
    assert main(["maps", "show", "my-yard", "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["kinds"] == {"ground": 1, "shed": 1, "slab": 1, "wall": 1}
    assert facts["triangles"] == 36
    assert facts["north_m"] == [-40.0, 40.0]
    assert facts["spawn_ned"] == [0.0, 0.0, 0.0]
    assert main(["maps", "import", str(yard), "--name", "my-yard", "--spawn", "0,0"]) == 2
    assert "--replace" in capsys.readouterr().err
    assert main(["maps", "import", str(yard), "--name", "my-yard", "--spawn", "5,5", "--replace"]) == 0
    assert maps.build("my-yard").spawn_ned[:2] == (5.0, 5.0)


def test_an_exported_map_can_be_imported_under_another_name(folder, tmp_path, capsys):
    out = tmp_path / "street.glb"
    assert main(["maps", "export", "residential", "--seed", "2", "--out", str(out)]) == 0
    assert main(["maps", "import", str(out), "--name", "my-street"]) == 0  # the spawn is in the file
    ours, theirs = maps.build("residential", 2), maps.build("my-street")
    assert theirs.name == "my-street"
    assert len(ours.instances) == len(theirs.instances)
    assert np.array_equal(ours.terrain.down, theirs.terrain.down)


def test_invalid_map_names_are_rejected_and_write_nothing(folder, yard):
    for name in ("", ".", "..", "../evil", "a/b", "A", "über", "-a", "a-", "x" * 41, "a.glb", "a\0b"):
        with pytest.raises(UsageError, match="map"):
            user.add(yard, name, (0.0, 0.0))
        with pytest.raises(UsageError):
            maps.build(name)
        text = a_record("residential").to_json().replace('"map": "residential"', f'"map": {json.dumps(name)}')
        with pytest.raises(UsageError, match="'map'"):
            record.parse(text, "episode.json")
        assert not folder.exists(), name


def test_names_of_shipped_maps_are_rejected(folder, yard):
    with pytest.raises(UsageError, match="residential"):
        user.add(yard, "residential", (0.0, 0.0), maps.shipped())


def test_an_invalid_file_is_not_stored(folder, tmp_path, capsys):
    bad = tmp_path / "bad.glb"
    bad.write_bytes(b"glTF" + b"\0" * 40)
    assert main(["maps", "import", str(bad), "--name", "bad", "--spawn", "0,0"]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert user.names() == []


def test_a_spawn_that_is_not_two_or_three_numbers_is_rejected(folder, yard, capsys):
    for spawn in ("1", "a,b", "1,2,3,4", "nan,0", "1,inf"):
        with pytest.raises(SystemExit) as stopped:
            main(["maps", "import", str(yard), "--name", "yard", "--spawn", spawn])
        assert stopped.value.code == 2, spawn


def test_a_user_map_can_be_measured_rendered_and_collided_with(folder, yard):
    user.add(yard, "yard", (0.0, 0.0))
    parsed = record.parse(a_record("yard").to_json(), "episode.json")
    world = World(parsed)
    camera = CameraModel(width=640, height=360)
    seen = world.measure(0.0, (0.5, 0.0, -1.5), (1.0, 0.0, 0.0, 0.0), camera)
    assert seen.visible
    assert seen.distance_m == pytest.approx(16.5, abs=0.3)
    view = Renderer(world.scene, camera, shadow_cells=256).render(CameraPose((1.0, 0.0, -1.4), (1.0, 0.0, 0.0, 0.0)))
    assert (view.ids == world.target_id).mean() > 0.004
    names = {obstacles(world.scene).names[k] for k in np.unique(obstacles(world.scene).owner)}
    assert {"Shed.001", "wall", "target"} <= names
    assert world.ground_down(3.0, 3.0) == pytest.approx(0.0, abs=1e-6)
    assert world.clearance_m((9.0, 3.0, -1.0)) == pytest.approx(1.0, abs=0.01)  # to the ground


def test_a_map_of_only_a_ground_mesh_is_stored_exactly(folder, tmp_path):
    path = Glb().lawn().write(tmp_path / "lawn.glb")
    scene = user.add(path, "lawn", (0.0, 0.0))
    again = maps.build("lawn", 7)
    assert gltf.writer.to_bytes(scene) == gltf.writer.to_bytes(again)


@pytest.mark.slow
def test_the_oracle_succeeds_on_a_user_map(folder, yard, tmp_path, capsys):
    assert main(["maps", "import", str(yard), "--name", "yard", "--spawn", "0,0"]) == 0
    episode = tmp_path / "yard-approaching-01.json"
    episode.write_text(a_record("yard").to_json(), encoding="utf-8")
    arguments = ["--pilot", "oracle", "--latency", "fixed:0.5", "--speed", "max"]
    result, flight_folder = fly_simulated(capsys, tmp_path / "run", "--episode", str(episode), *arguments)
    assert result["success"]
    assert result["ne_m"] <= 5.0
    assert json.loads((flight_folder / "episode.json").read_text())["map"] == "yard"


def test_a_negative_map_seed_is_rejected(capsys):
    assert main(["maps", "show", "blocks", "--seed", "-1"]) == 2
    assert "-1" in capsys.readouterr().err
