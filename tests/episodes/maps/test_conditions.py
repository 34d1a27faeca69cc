"""Light and season: shadows match the sun's position, and only the appearance changes."""

import math
from dataclasses import replace

import numpy as np
import pytest

from episodes import maps
from episodes.camera.renderer import Renderer
from episodes.camera.renderer.sky import daylight
from episodes.maps.conditions import HUES, direction, in_conditions, with_lights
from episodes.maps.scene import Material
from foundation.camera import CameraModel, CameraPose
from foundation.conditions import SceneConditions
from foundation.frames import quat_from_euler
from tests.episodes.camera.renderer.scenes import box_mesh, ground_mesh, instance, quad_mesh, scene_of

CAMERA = CameraModel(200, 200, 90.0, (0.0, 0.0, 0.0))
HEIGHT_M = 4.0  # height of a post at the origin, 1 m wide
POST = scene_of(
    [instance(1, ground_mesh(60.0), (0.0, 0.0, 0.0), "ground"), instance(2, box_mesh(1, 1, HEIGHT_M), (0.0, 0.0, 0.0))]
)
OVERCAST, DUSK, AUTUMN = SceneConditions(sky="overcast"), SceneConditions(sky="dusk"), SceneConditions(season="autumn")


def picture(scene, pose, camera=CAMERA):
    renderer = Renderer(scene, camera, 1, shadow_cells=1024)
    try:
        return renderer.picture(pose).astype(float)
    finally:
        renderer.close()


def from_above(scene, *places):
    """Return the brightness of the ground at (north, east) places, seen from 20 m above. One metre is 5 px."""
    seen = picture(scene, CameraPose((0.0, 0.0, -20.0), quat_from_euler(0.0, -math.pi / 2, 0.0))).mean(axis=2)
    return [seen[round(100 - 5 * north), round(100 + 5 * east)] for north, east in places]


@pytest.mark.parametrize(("azimuth", "elevation"), [(90.0, 30.0), (200.0, 45.0), (315.0, 60.0)])
def test_shadow_length_and_direction_match_the_sun(azimuth, elevation):
    scene = in_conditions(POST, SceneConditions(sun_azimuth_deg=azimuth, sun_elevation_deg=elevation))
    length, away = HEIGHT_M / math.tan(math.radians(elevation)), math.radians(azimuth + 180.0)

    def along(distance):
        return distance * math.cos(away), distance * math.sin(away)

    open_ground, shaded, beyond, sunny = from_above(scene, (15.0, 15.0), along(length - 0.4), along(length + 1.5),
                                                    along(-3.0))  # fmt: skip
    assert shaded < 0.8 * open_ground
    assert beyond == pytest.approx(open_ground, rel=0.05)
    assert sunny == pytest.approx(open_ground, rel=0.05)


def test_setting_one_sun_angle_keeps_the_other():
    sun = replace(POST.sun, toward_ned=direction(120.0, 50.0))
    scene = replace(POST, sun=sun)
    assert in_conditions(scene, SceneConditions(sun_elevation_deg=20.0)).sun.toward_ned == pytest.approx(
        direction(120.0, 20.0)
    )
    assert in_conditions(scene, SceneConditions(sun_azimuth_deg=10.0)).sun.toward_ned == pytest.approx(
        direction(10.0, 50.0)
    )


def test_a_low_sun_is_redder():
    high, low = (
        daylight(in_conditions(POST, SceneConditions(sun_azimuth_deg=180.0, sun_elevation_deg=h)).sun).sun
        for h in (40, 5)
    )
    assert low[0] / low[2] > 1.2 * high[0] / high[2]


def test_overcast_sky_weakens_shadows_and_hides_the_sun():
    shade = (-0.2 - HEIGHT_M / 2, 0.0)
    low = replace(POST, sun=replace(POST.sun, toward_ned=direction(0.0, 45.0)))
    for conditions, least, most in ((SceneConditions(), 0.0, 0.75), (OVERCAST, 0.85, 1.0)):
        open_ground, shaded = from_above(in_conditions(low, conditions), (15.0, 15.0), shade)
        assert least < shaded / open_ground < most, conditions
    red, _, blue = sky(in_conditions(low, OVERCAST), 90.0, 60.0)
    assert blue < 1.2 * red
    toward, away = (sky(in_conditions(low, OVERCAST), azimuth, 45.0).mean() for azimuth in (0.0, 180.0))
    assert toward == pytest.approx(away, rel=0.2)
    assert sky(low, 0.0, 45.0).min() > 250.0  # the sun in a clear sky


def sky(scene, azimuth, elevation):
    """Return the (r, g, b) value, 0 … 255, of the sky at an azimuth and an elevation (degrees)."""
    turn = quat_from_euler(0.0, math.radians(elevation), math.radians(azimuth))
    return picture(scene, CameraPose((25.0, 25.0, -8.0), turn))[100, 100]


def test_at_dusk_the_sky_is_redder_in_the_west_than_in_the_east():
    scene = in_conditions(POST, DUSK)
    assert daylight(scene.sun).sun == (0.0, 0.0, 0.0)
    west, east, above = (sky(scene, a, h) for a, h in ((300.0, 2.0), (120.0, 2.0), (0.0, 85.0)))
    assert west[0] / west[2] > 1.2 * east[0] / east[2]
    assert above[2] > above[0]
    (dark,), (bright,) = (from_above(world, (15.0, 15.0)) for world in (scene, POST))
    assert dark < 0.6 * bright


def test_about_half_of_the_windows_are_lit_and_each_window_is_uniform():
    window, wall = Material("window", (0.05, 0.06, 0.07)), Material("brick", (0.4, 0.2, 0.1))
    panes = [
        quad_mesh([(0, e, -d - 1), (0, e + 1, -d - 1), (0, e + 1, -d), (0, e, -d)], window)
        for e in np.arange(0.0, 120.0, 3.0) for d in (1.0, 4.0, 7.0)
    ]  # fmt: skip
    house = instance(1, merged([*panes, box_mesh(4, 4, 4, wall)]), (0.0, 0.0, 0.0))
    (lit,) = with_lights([house])
    shines = np.array([m.emission > 0.0 for m in lit.mesh.materials])[lit.mesh.material]
    assert not shines[2 * len(panes) :].any()  # the wall
    by_pane = shines[: 2 * len(panes)].reshape(-1, 2)
    assert (by_pane[:, 0] == by_pane[:, 1]).all()
    assert 0.4 < by_pane[:, 0].mean() < 0.7


def test_wall_panels_have_no_emission_at_dusk():
    for built in map(maps.build, maps.shipped()):
        for thing in in_conditions(built, DUSK).instances:
            for looks in thing.mesh.materials:
                assert looks.emission == 0.0 or "panels" not in looks.name


def merged(meshes):
    """Return the meshes as one mesh. Each keeps its first material."""
    first, vertices, triangles = meshes[0], 0, []
    for mesh in meshes:
        triangles.append(mesh.triangles + vertices)
        vertices += len(mesh.vertices)
    return replace(
        first,
        **{name: np.concatenate([getattr(m, name) for m in meshes]) for name in ("vertices", "normals", "uv")},
        triangles=np.concatenate(triangles),
        material=np.concatenate([np.full(len(m.triangles), k, np.int32) for k, m in enumerate(meshes)]),
        materials=tuple(m.materials[0] for m in meshes),
    )


@pytest.mark.parametrize("name", maps.shipped())
def test_conditions_do_not_change_geometry(name):
    built = maps.build(name)
    assert in_conditions(built, SceneConditions()) is built
    for conditions in (DUSK, AUTUMN, OVERCAST):
        scene = in_conditions(built, conditions)
        assert scene is in_conditions(built, conditions)
        for before, after in zip(built.instances, scene.instances, strict=True):
            assert (before.id, before.position_ned, before.turned) == (after.id, after.position_ned, after.turned)
            assert before.mesh.vertices is after.mesh.vertices
            assert before.mesh.triangles is after.mesh.triangles


def test_autumn_changes_the_colour_of_leaves_but_not_of_evergreens():
    built = maps.build("residential")
    scene = in_conditions(built, AUTUMN)
    hues, kept = set(), set()
    brightness: dict[str, set[float]] = {}
    for before, after in zip(built.instances, scene.instances, strict=True):
        for old, new in zip(before.mesh.materials, after.mesh.materials, strict=True):
            if old.name.startswith(("leaves", "thicket")) and not old.name.endswith(("pine", "spruce", "box")):
                if old.name.startswith("leaves"):
                    hues.add(new.color)
                brightness.setdefault(old.name.split("-")[0], set()).add(sum(new.color))
            elif not old.name.startswith(("grass", "lawn", "meadow")):
                assert new is old
                kept.add(old.name)
    assert 1 < len(hues) <= len(HUES)
    assert any(r > 1.5 * g for r, g, _ in hues)
    assert max(brightness["thicket"]) < 0.7 * max(brightness["leaves"])
    assert "leaves-spruce" in kept
