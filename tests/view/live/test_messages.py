"""The messages to a browser: each value once, judge data only on demand, and escaped text."""

import itertools
import json
import math
import re
import time
from dataclasses import replace
from typing import Any

import pytest

from benchmarks.page_client import PageClient
from dronecats.view.editor.draft import Drafting
from dronecats.view.live import panels as markup
from dronecats.view.live.moment import DroneMoment, JudgeMoment, Moment
from dronecats.view.live.panels import FlightPanels
from dronecats.view.live.scene import FlightScene
from dronecats.view.scene import display
from dronecats.view.scene.page import LoopbackServer
from episodes import maps
from episodes.records.record import Path3D
from episodes.world.world import World
from foundation.run_folder.rows import Decision
from tests.view.live.conftest import moment, picture

PATIENCE_S = 30.0


class Page:
    """A server with one flight's scene and panels, and a client of it."""

    def __init__(self, world, drones: int = 1) -> None:
        self.server = LoopbackServer("test", 0)
        self.scene = FlightScene(self.server, world.scene if world else None, drones=drones)
        self.panels = FlightPanels(self.server, drones, on_judge=self._judge, on_follow=self.scene.follow)
        self.client = PageClient(self.server.url)
        self._count = itertools.count()

    def _judge(self, shown: bool) -> None:
        self.scene.judge_shown = shown

    def show(self, one: Moment) -> None:
        self.scene.show(one)
        self.panels.show(one)

    def sent(self) -> list[dict[str, Any]]:
        """Return all messages since the last call."""
        mark = f"mark {next(self._count)}"
        self.server.gui.set_panel_label(mark)
        messages = self.client.until(lambda message: mark in message.values(), PATIENCE_S)
        return [message for message in messages if mark not in message.values()]

    def close(self) -> None:
        self.client.close()
        self.server.stop()


@pytest.fixture
def page(world):
    made = Page(world)
    yield made
    made.close()


def of(messages, kind: str) -> list[dict[str, Any]]:
    return [message for message in messages if message["type"] == kind]


def tick(page: Page, messages) -> None:
    """Toggle the judge's checkbox as a browser does, and wait until the page has received it."""
    (box,) = of(messages, "GuiCheckboxMessage")
    wanted, due_s = not page.panels.judge_shown, time.monotonic() + PATIENCE_S
    page.client.send({"type": "GuiUpdateMessage", "uuid": box["uuid"], "updates": {"value": wanted}})
    while page.panels.judge_shown != wanted:  # another thread processes it
        assert time.monotonic() < due_s
        page.sent()


def test_judge_data_is_sent_only_on_demand(page, world):
    one = moment(world)
    target = display.place_of(one.judge.target_ned or (0.0, 0.0, 0.0))
    page.show(one)
    before = page.sent()
    assert any(str(m.get("name", "")).endswith("/drone-0") for m in before)  # the page shows a flight
    sent_text = json.dumps(before, default=str)
    for word in ("judge/", "6.54", "verdict", "(judge)"):
        assert word not in sent_text
    assert not any("target" in str(m.get("name")) for m in before)
    tick(page, before)
    page.show(one)
    after = page.sent()
    sent_text = json.dumps(after, default=str)
    for word in ("/judge/ring", "6.54", "verdict: success", "(judge)"):
        assert word in sent_text
    assert any(near(m["position"], target, 2.5) for m in of(after, "SetPositionMessage"))
    tick(page, before)
    page.show(one)
    gone = {m["name"] for m in of(page.sent(), "RemoveSceneNodeMessage")}
    assert {name.rpartition("/")[2] for name in gone} == {"ring", "name"}  # the target itself stays
    late = PageClient(page.server.url)  # a later viewer does not get another viewer's judge messages
    page.server.gui.set_panel_label("late")
    sent_text = json.dumps(late.until(lambda m: "late" in m.values(), PATIENCE_S), default=str)
    late.close()
    assert "/judge/ring" not in sent_text
    assert "6.54" not in sent_text


def test_target_and_look_alikes_are_shown_by_default_and_move(yard):
    """The drone sees its target from the beginning, so the page shows it. The page does not mark it."""
    still = World(Drafting(maps.build(yard)).new(yard).record)
    lane = Path3D(waypoints_ned=((4.0, -6.0, 0.0), (4.0, 14.0, 0.0)), speed_mps=0.5)
    target = replace(still.record.target, position_ned=None, yaw_deg=None, path=lane)
    look_alike = replace(still.record.target, paint="red", position_ned=(-6.0, 3.0, 0.0), yaw_deg=90.0)
    world = World(replace(still.record, target=target, candidates=(look_alike,)))
    page = Page(world)
    try:
        places = []
        for t_s in (0.0, 10.0):
            page.show(moment(world, t_s))
            sent = page.sent()
            places.append({m["name"]: m["position"] for m in of(sent, "SetPositionMessage") if "/thing/" in m["name"]})
        before, after = places
        assert sorted(display.ned_of(p) for p in before.values()) == [
            pytest.approx((-6.0, 3.0, 0.0)),
            pytest.approx(world.target_pose(0.0)[0]),
        ]
        ((name, place),) = after.items()  # things at rest are not sent again
        assert name in before
        assert display.ned_of(place) == pytest.approx((4.0, -1.0, 0.0))
    finally:
        page.close()


def near(place, other, far: float = 0.5) -> bool:
    return math.dist(place, other) < far


def test_an_unchanged_moment_is_sent_once(page, world):
    page.show(moment(world))
    assert page.sent()
    page.show(moment(world))
    assert page.sent() == []


def test_a_moving_drone_needs_at_most_three_messages(page, world):
    page.show(moment(world, 1.0))
    page.sent()
    page.show(moment(world, 1.05))
    kinds = [m["type"] for m in page.sent()]
    assert kinds.count("SetPositionMessage") == 2  # the drone, and its setpoint's arrow
    assert len(kinds) <= 3
    assert not any("Image" in kind or "Glb" in kind for kind in kinds)


def test_the_drone_has_the_pose_of_the_moment(page, world):
    page.show(moment(world, 1.0))
    page.show(moment(world, 3.0, attitude=(0.8, 0.2, -0.4, 0.4)))
    sent = page.sent()
    (place,) = [m for m in of(sent, "SetPositionMessage") if m["name"] == "/world/flight/drone-0"][-1:]
    (turn,) = [m for m in of(sent, "SetOrientationMessage") if m["name"] == "/world/flight/drone-0"][-1:]
    assert place["position"] == pytest.approx((2.0, 2.0, -4.0))  # east, up, south
    assert turn["wxyz"] == pytest.approx((0.8, -0.4, -0.4, -0.2))


def test_a_followed_drone_keeps_its_place_in_the_view(page, world):
    page.show(moment(world, 1.0))
    page.scene.follow(0)
    page.show(moment(world, 1.0))
    page.show(moment(world, 4.0))
    assert page.scene.offset == pytest.approx((0.0, 0.0, 3.0))  # the drone moves 3 m north, the world 3 m south
    page.scene.follow(None)
    page.show(moment(world, 9.0))
    assert page.scene.offset == pytest.approx((0.0, 0.0, 3.0))  # the view does not move


def test_four_drones_have_four_pictures_and_four_bodies(world):
    page = Page(world, 4)
    page.show(moment(world, drones=4))
    sent = page.sent()
    names = {m["name"] for m in sent if "name" in m}
    assert {f"/world/flight/drone-{k}/camera" for k in range(4)} <= names
    html = "".join(str(m["updates"].get("content", "")) for m in of(sent, "GuiUpdateMessage"))
    sent_text = html + json.dumps(of(sent, "GuiHtmlMessage"), default=str)
    assert {f'data-drone="{k}"' in sent_text or f'data-drone=\\"{k}\\"' in sent_text for k in range(4)} == {True}
    page.close()


def test_a_page_without_a_pilot_has_no_pictures_and_no_replies(world):
    server = LoopbackServer("test", 0)
    client = PageClient(server.url)
    try:
        panels = FlightPanels(server, 1, piloted=False)
        panels.show(moment(world))
        server.gui.set_panel_label("mark")
        sent = json.dumps(client.until(lambda m: "mark" in m.values(), PATIENCE_S), default=str)
        assert "OFFBOARD" in sent
        assert "data:image/jpeg" not in sent
        assert "&lt;b&gt;go" not in sent  # the reply
        panels.remove()
    finally:
        client.close()
        server.stop()


def test_an_obstacle_on_the_ray_is_marked(page, world):
    """The shed of the small map is 9 m north and 9 m east. The ray to the north meets its wall at 6 m."""
    page.show(moment(world, lens_ned=(0.0, 9.0, -1.5), chosen_ned=(20.0, 9.0, -1.5)))
    met = [m for m in of(page.sent(), "SetPositionMessage") if m["name"].endswith("/met-0")]
    assert display.ned_of(met[-1]["position"]) == pytest.approx((6.0, 9.0, -1.5), abs=1e-3)
    page.show(moment(world, lens_ned=(0.0, 9.0, -1.5), chosen_ned=(5.0, 9.0, -1.5)))
    assert any(m["name"].endswith("/met-0") for m in of(page.sent(), "RemoveSceneNodeMessage"))


def test_a_page_without_a_world_shows_a_grid(world):
    page = Page(None)
    page.show(replace(moment(world), judge=JudgeMoment()))
    assert any(m["type"] == "GridMessage" for m in page.sent())
    page.close()


def test_two_flights_share_a_map(page, world):
    other = FlightScene(page.server, world.scene, name="other")
    page.show(moment(world))
    other.show(moment(world, 2.0))
    sent = page.sent()
    assert sum(m.get("name") == "/world/map" for m in sent if m["type"].startswith("Glb")) == 1
    assert {"/world/flight/drone-0", "/world/other/drone-0"} <= {m.get("name") for m in sent}
    other.remove()
    gone = {m["name"] for m in of(page.sent(), "RemoveSceneNodeMessage")}
    assert any(name.startswith("/world/other") for name in gone)
    assert not any(name.startswith("/world/flight") for name in gone)


def test_a_growing_trail_sends_only_its_new_part(page, world):
    for k in range(400):
        page.scene.show(moment(world, 0.2 * k))
    page.sent()
    before = page.client.bytes
    page.scene.show(moment(world, 0.2 * 401))
    grown = [m["name"] for m in page.sent() if "/trail-" in m.get("name", "")]
    assert len(grown) == 1
    assert page.client.bytes - before < 4_000  # the complete trail would be 10 kB


# ---- text


def test_text_is_escaped_in_html(world):
    (drone,) = moment(world).drones
    assert drone.decision is not None
    evil = '</pre><script>alert(1)</script><img src=x onerror="x">'
    decision = replace(drone.decision, reply=evil, action=None, error=evil)
    html = "".join(
        [
            markup.decision_html(replace(drone, decision=decision, prompt=evil)),
            markup.messages_html([replace(drone, messages=(evil,))]),
            markup.numbers_html([replace(drone, mode=evil)]),
            markup.numbers_html([replace(drone, mode=evil)] * 2),
            markup.decisions_html([replace(drone, decision=decision, prompt=evil)] * 2),
            markup.state_html(replace(moment(world), state=evil, instruction=evil)),
            markup.judge_html(JudgeMoment(messages=(evil,))),
            markup.frame_html(drone, evil),
        ]
    )
    assert "<script" not in html
    assert "onerror=&quot;" in html
    ours = {"div", "span", "b", "pre", "details", "summary", "img", "svg", "circle", "table", "tr", "th", "td"}
    assert set(re.findall(r"</?([a-z]+)", html)) <= ours


def test_a_reply_for_several_drones_is_shown_once(world):
    fleet = moment(world, drones=4).drones
    assert markup.decisions_html(fleet).count('class="reply"') == 1
    assert markup.decisions_html(fleet).count('class="action"') == 4
    alone = [replace(one, decision=replace(one.decision, step=one.drone)) for one in fleet if one.decision]
    assert markup.decisions_html(alone).count('class="reply"') == 4


def test_a_newer_picture_is_shown_without_the_ring_of_the_last_one(world):
    (drone,) = moment(world).drones
    assert 'data-x="250"' in markup.frame_html(drone, "")
    html = markup.frame_html(replace(drone, picture=picture(4)), "")
    assert 'data-frame="4"' in html
    assert "ring" not in html


def test_actions_are_described_in_words():
    for action, parts in (
        ({"action": "go", "point": [1.0, 2.0], "depth_m": 3.5}, r"^go .*\(1, 2\).* 3\.5 m$"),
        ({"action": "rotate", "angle_deg": -30.0}, "^rotate 30° left"),
        ({"action": "think"}, "^think"),
        (None, "nothing said$"),
    ):
        decision = Decision(
            step=0, drone=0, frame_id=0, t_frame=0.0, t_decided=1.0, action=action, error="nothing said"
        )
        assert re.search(parts, decision.action_or_reason()), action


def test_a_drone_without_data_is_shown():
    empty = DroneMoment(0)
    assert "<img" not in markup.frame_html(empty, "")
    assert markup.decision_html(empty)
    markup.numbers_html([empty])
    assert markup.decisions_html([empty, empty]).count("data-drone") == 2
    markup.numbers_html([empty, empty])


def test_drone_numbers_start_at_one():
    fleet = [DroneMoment(drone, messages=("Armed",)) for drone in range(2)]
    shown = (markup.frames_html, markup.decisions_html, markup.numbers_html, markup.messages_html)
    for html in (show(fleet) for show in shown):
        assert re.findall(r"\bdrone (\d)", html) == ["1", "2"], html
