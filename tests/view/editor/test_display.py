"""The editor's display: pictures and checks of the newest draft, browser axes, and escaped text."""

import math
import re
import threading
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dronecats.view.editor import panels
from dronecats.view.editor.assessment import PREVIEW, Previews, findings
from dronecats.view.editor.draft import Drafting
from dronecats.view.scene import display
from episodes import maps
from episodes.authoring.check import rules
from episodes.authoring.check.finding import RuleFinding
from episodes.camera.renderer import Renderer
from episodes.maps import assets
from episodes.maps.scene import Mesh
from episodes.world.world import World
from foundation.camera import camera_pose
from foundation.threads import NewestItemWorker


@pytest.fixture
def drafting(yard):
    return Drafting(maps.build(yard))


@pytest.fixture
def draft(drafting, yard):
    return drafting.new(yard)


def test_the_preview_is_the_first_frame_of_the_flight(drafting, draft):
    previews = Previews()
    for record in (draft.record, drafting.move_target(draft, 9.0, 3.0, 50.0).record):
        start = record.starts[0]
        pose = camera_pose(start.position_ned, (1.0, 0.0, 0.0, 0.0), PREVIEW)
        world = World(record)
        flight_renderer = Renderer(world.scene, PREVIEW, shadow_cells=2048)
        expected = flight_renderer.render(pose)
        flight_renderer.close()
        shown = previews.picture(record, 0)
        unlike = (np.abs(shown.astype(int) - expected.rgb) > 12).any(axis=2)
        assert (expected.ids == world.target_id).any()
        assert unlike.mean() < 0.01  # the preview's shadow map of movable things is coarser
    previews.close()


def test_a_drag_reuses_the_renderer_and_a_new_paint_rebuilds_it(drafting, draft):
    previews = Previews()
    first = previews.picture(draft.record, 0)
    renderer = previews._renderer
    moved = previews.picture(drafting.move_target(draft, 9.0, 3.0).record, 0)
    assert previews._renderer is renderer
    assert (first != moved).any()
    painted = previews.picture(drafting.choose(draft, "suv", "red").record, 0)
    assert previews._renderer is not renderer
    assert (first != painted).any()
    previews.close()


def test_every_drone_has_its_own_view(drafting, draft):
    fleet = drafting.cell(draft, "commanding").record
    previews = Previews()
    pictures = [previews.picture(fleet, k) for k in range(4)]
    previews.close()
    assert len({p.tobytes() for p in pictures}) == 4


def test_the_findings_equal_those_of_the_rule_check(draft):
    assert findings(draft.record) == rules.check(World(draft.record))


def test_an_invalid_record_is_one_failed_finding(draft):
    (finding,) = findings(replace(draft.record, id="Not An Id"))
    assert not finding.passed
    assert "id" in finding.measured
    (finding,) = findings(replace(draft.record, map="nowhere"))
    assert "map" in finding.measured


# ---- the worker for the newest draft


def test_the_worker_processes_only_the_newest_item():
    """Nine items arrive during the work on the first one. Of them, the worker processes only the last."""
    started, go_on, done = threading.Event(), threading.Event(), []

    def work(number: int) -> None:
        started.set()
        assert go_on.wait(30.0)
        done.append(number)

    latest = NewestItemWorker(work, "test")
    latest.put(0)
    assert started.wait(30.0)
    for number in range(1, 10):
        latest.put(number)
    go_on.set()
    assert latest.idle(30.0)
    assert done == [0, 9]
    latest.close()


def test_the_worker_continues_after_an_exception(monkeypatch):
    seen: list[Any] = []
    done: list[Any] = []
    monkeypatch.setattr(threading, "excepthook", seen.append)

    def work(number: int) -> None:
        if number == 0:
            raise ValueError("once")
        done.append(number)

    latest = NewestItemWorker(work, "test")
    latest.put(0)
    assert latest.idle(30.0)
    latest.put(1)
    assert latest.idle(30.0)
    latest.close()
    assert [type(args.exc_value) for args in seen] == [ValueError]
    assert done == [1]


# ---- the browser's axes


@given(st.tuples(*[st.floats(-1e3, 1e3)] * 3), st.floats(-math.pi + 1e-6, math.pi - 1e-6))
def test_positions_and_yaws_survive_the_conversion_to_browser_axes(place, yaw):
    assert display.ned_of(display.place_of(place)) == place
    assert display.yaw_of(display.wxyz_of(yaw)) == pytest.approx(yaw, abs=1e-9)


def test_browser_axes_are_east_up_and_south():
    assert display.place_of((1.0, 2.0, 3.0)) == (2.0, -3.0, -1.0)
    w, x, y, z = display.wxyz_of(math.radians(90.0))  # facing east: ahead, −z, becomes +x
    ahead = (-2 * (x * z + w * y), -2 * (y * z - w * x), -(1 - 2 * (x * x + y * y)))
    assert ahead == pytest.approx((1.0, 0.0, 0.0))


def test_the_map_mesh_is_complete_and_has_at_most_one_piece_per_material(drafting, tmp_path):
    import trimesh

    path = tmp_path / "map.glb"
    path.write_bytes(display.map_glb(drafting.scene))
    sent = trimesh.load_scene(path)
    looks = {id(m) for one in drafting.scene.instances for m in one.mesh.materials}
    assert len(sent.geometry) <= len(looks)
    assert sum(len(g.faces) for g in sent.geometry.values()) == sum(
        len(one.mesh.triangles) for one in drafting.scene.instances
    )
    assert sent.bounds[1][1] == pytest.approx(3.0)  # the shed's roof, up


def test_mesh_pieces_share_no_vertices(tmp_path):
    """viser recomputes the normals of each piece. With shared vertices it would overwrite those of another piece."""
    import trimesh

    mesh: Mesh = assets.build("suv", "cyan")
    path = tmp_path / "suv.glb"
    path.write_bytes(display.mesh_glb(mesh))
    sent = trimesh.load_scene(path)
    assert sum(len(g.vertices) for g in sent.geometry.values()) < 1.3 * len(mesh.vertices)
    assert sum(len(g.faces) for g in sent.geometry.values()) == len(mesh.triangles)


def test_a_click_picks_the_thing_or_the_ground_under_it(drafting):
    picker = display.Picker(drafting.scene)
    met = picker.pick((9.0, 9.0, -20.0), (0.0, 0.0, 1.0))
    assert met is not None
    place, thing = met
    assert thing.name == "shed"
    assert place == pytest.approx((9.0, 9.0, -3.0), abs=1e-4)
    met = picker.pick((0.0, 0.0, -5.0), (3.0, 0.0, 5.0))
    assert met is not None
    place, thing = met
    assert thing.kind == "ground"
    assert place == pytest.approx((3.0, 0.0, 0.0), abs=1e-4)
    assert picker.pick((0.0, 0.0, -5.0), (0.0, 0.0, -1.0)) is None


# ---- markup


@given(st.text(min_size=1, max_size=60), st.text(max_size=60), st.booleans(), st.booleans())
def test_text_is_escaped_in_html(rule, measured, passed, fresh):
    html = panels.checks_html([RuleFinding(rule, passed, measured, f"</div><script>{measured}")], fresh)
    assert "<script" not in html
    assert set(re.findall(r"</?([a-z]+)", html)) <= {"div", "span", "b"}


def test_failed_checks_come_first():
    one, two = RuleFinding("the first", True, "1", "1"), RuleFinding("the second", False, "2", "3")
    html = panels.checks_html([one, two], True)
    assert html.index("Second") < html.index("First")
    assert re.search(r"\b1 of 2\b", html)
    assert 'data-failed="1"' in html
