"""The replay page without a browser: its messages to a viewer, mostly of a fleet over a plain grid."""

import math
import re
import socket

import numpy as np
import pytest

from dronecats.view.replay.moments import flight_moments
from dronecats.view.replay.page import ReplayPage
from dronecats.view.replay.player import PlaybackClock
from dronecats.view.replay.views import NO_WORLD, RedrawnView
from dronecats.view.scene import display
from tests.support.ports import free_port
from tests.support.run_folders import run_folder
from tests.view.replay.sent import Sent

PATIENCE_S = 60.0


@pytest.fixture
def fleet(tmp_path):
    return flight_moments(run_folder(tmp_path / "fleet", {"nowhere-commanding-01": "go there"}, drones=3))


@pytest.fixture
def page(fleet):
    made = ReplayPage([fleet], free_port(socket.SOCK_STREAM))
    yield made
    made.close()


@pytest.fixture
def sent(page):
    made = Sent(page.url)
    yield made
    made.close()


def test_a_fleet_is_shown_on_a_plain_grid_with_the_missing_files(page, sent, fleet):
    page.order(PlaybackClock.scrubbed, 4.0)
    assert page.idle(PATIENCE_S)
    for drone in range(3):
        place = sent.newest("SetPositionMessage", f"/world/flight/drone-{drone}")["position"]
        assert math.dist(display.ned_of(place), (5.2, 2.0 * drone, -2.0)) < 1e-3
    text = sent.text()
    assert "flight.tlog" in text
    assert re.search(r"4\.0 s\b.*\b15\.6 s", text)
    assert "/world/map" in text


def test_a_trail_is_redrawn_after_a_jump_back(page, sent):
    """A piece of a trail has 64 points, one for each 0.1 s."""
    for t_s, pieces in ((10.0, 2), (4.0, 1), (10.0, 2)):
        page.order(PlaybackClock.scrubbed, t_s)
        assert page.idle(PATIENCE_S)
        assert len(shown(sent, "/world/flight/trail-0/")) == pieces


def test_after_any_jump_the_trail_leads_from_the_start_to_the_drone(page, fleet):
    """The drones fly straight ahead, so a trail that goes back or has a gap is longer or shorter than the way."""
    for t_s in (4.0, 4.5, 4.2, 10.0, 10.5, 2.0, 2.3):
        page.order(PlaybackClock.scrubbed, t_s)
        assert page.idle(PATIENCE_S)
        for drone in fleet.drones:
            start, end = (fleet.moment(t).drones[drone].position_ned for t in (0.0, t_s))
            lines = np.concatenate([piece.points for piece in page._scenes[0]._trails[drone].pieces._nodes.values()])
            assert lines[0, 0] == pytest.approx(display.place_of(start), abs=1e-4), t_s
            assert lines[-1, 1] == pytest.approx(display.place_of(end), abs=1e-4), t_s
            assert np.linalg.norm(lines[:, 1] - lines[:, 0], axis=1).sum() == pytest.approx(math.dist(start, end)), t_s


def shown(sent, node):
    """Return the names of the lines below a node that were added and not removed since."""
    names = set()
    for message in sent.update():
        if str(message.get("name", "")).startswith(node):
            if message["type"] == "LineSegmentsMessage":
                names.add(message["name"])
            elif message["type"] == "RemoveSceneNodeMessage":
                names.discard(message["name"])
    return names


def test_the_view_follows_the_chosen_drone(page, sent):
    page.choose(2)
    page.go_along()
    assert page.idle(PATIENCE_S)
    page.order(PlaybackClock.scrubbed, 4.0)
    assert page.idle(PATIENCE_S)
    assert (page.state.drone, page.state.along) == (2, True)
    assert any((each.get("updates") or {}).get("value") == "drone 3" for each in sent.update())  # in the panel
    x, y, z = sent.newest("SetPositionMessage", "/world")["position"]
    assert math.dist(display.ned_of((-x, -y, -z)), (5.2, 0.0, 0.0)) < 1e-3
    page.choose(7)  # no drone has that number, so the page takes the first one
    assert page.idle(PATIENCE_S)


def test_a_view_without_a_world_shows_the_reason(page, sent):
    page.next_view()
    assert page.idle(PATIENCE_S)
    assert page.state.view is RedrawnView.CHASE
    assert NO_WORLD in sent.text()
    for view in (RedrawnView.TOP, RedrawnView.ONBOARD, None):
        page.next_view()
        assert page.state.view is view


def test_judge_data_is_sent_only_on_demand(page, sent):
    page.order(PlaybackClock.scrubbed, 1e9)
    assert page.idle(PATIENCE_S)
    assert "verdict:" not in sent.text()
    assert "/judge/" not in sent.text()
    page.judge()
    assert page.idle(PATIENCE_S)
    assert "verdict:" in sent.text()
    assert "/judge/ring" in sent.text()


def test_the_target_is_shown_by_default_and_only_for_the_chosen_flight(flight, runs):
    """With both flights, the target would appear twice when one flight is over and the other continues."""
    page = ReplayPage([flight, flight_moments(runs / "other")], free_port(socket.SOCK_STREAM), at_s=3.0)
    sent = Sent(page.url)
    try:
        for number in (0, 1):
            page.choose(number)
            assert page.idle(PATIENCE_S)
            messages = [each for each in sent.update() if "/thing/" in str(each.get("name"))]
            shown = {each["name"] for each in messages} - {
                each["name"] for each in messages if each["type"] == "RemoveSceneNodeMessage"
            }
            (name,) = (each for each in shown if each.startswith(f"/world/{number + 1} "))
            assert len(shown) == 1
            place = display.ned_of(sent.newest("SetPositionMessage", name)["position"])
            assert place == pytest.approx(flight.world.target_pose(3.0)[0], abs=1e-3)
        assert "/judge/" not in sent.text()
    finally:
        sent.close()
        page.close()
