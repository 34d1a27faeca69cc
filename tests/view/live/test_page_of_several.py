"""The page of a benchmark's folder: its list of flights, the shown flight, and the end of the last one."""

import json
import os
import time
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.page_client import CAMERA, PageClient
from dronecats.view.live.folder import EpisodeList
from dronecats.view.live.viewer_process import NEWEST, LivePage, WantedView
from dronecats.view.scene.page import LoopbackServer
from foundation.run_folder import layout

PATIENCE_S = 30.0


def begun(folder: Path, record: str, at_s: int) -> Path:
    """Create the episode folder of a flight that began at the file time `at_s`."""
    folder.mkdir(parents=True)
    for name in (layout.DECISIONS, layout.TRUTH):
        (folder / name).touch()
    (folder / layout.EPISODE).write_text(record)
    os.utime(folder / layout.EPISODE, (at_s, at_s))
    return folder


def judged(folder: Path) -> None:
    (folder / layout.VERDICT).write_text(json.dumps({"success": True}))


@pytest.fixture
def bench(tmp_path, world):
    record = world.record.to_json()
    for k, name in enumerate(("run-a/one", "run-a/two", "run-b/one")):
        begun(tmp_path / "bench" / name, record, 1_000 + k)
    begun(tmp_path / "bench" / "run-a" / layout.UNFINISHED / "one-1", record, 9_999)
    return tmp_path / "bench"


def test_flights_are_listed_newest_first_without_unfinished_ones(bench):
    judged(bench / "run-b/one")
    episodes = EpisodeList(bench).look()
    assert [(episode.name, episode.over) for episode in episodes] == [
        ("run-b/one", True),
        ("run-a/two", False),
        ("run-a/one", False),
    ]


def test_an_episode_that_is_flown_again_in_its_folder_is_a_new_flight(bench, world):
    judged(bench / "run-b/one")
    episodes = EpisodeList(bench)
    assert episodes.look()[0].over
    (bench / "run-b/one").rename(bench / "run-b" / layout.UNFINISHED)
    begun(bench / "run-b/one", world.record.to_json(), 2_000)
    newest = episodes.look()[0]
    assert (newest.name, newest.over, newest.begun_ns) == ("run-b/one", False, 2_000_000_000_000)


def test_a_run_or_an_episode_folder_can_be_listed(bench):
    assert [one.name for one in EpisodeList(bench / "run-a").look()] == ["two", "one"]
    assert [one.name for one in EpisodeList(bench / "run-a/two").look()] == ["two"]


def test_a_missing_or_incomplete_folder_has_no_flight(tmp_path):
    assert EpisodeList(tmp_path / "nowhere").look() == []
    (tmp_path / "run" / "made").mkdir(parents=True)
    (tmp_path / "run" / "made" / layout.DECISIONS).touch()
    assert EpisodeList(tmp_path / "run").look() == []


def test_the_newest_flight_is_shown_until_the_user_chooses_another(bench):
    server = LoopbackServer("test", 0)
    page, episodes = LivePage(server, bench), EpisodeList(bench)
    client = PageClient(server.url)
    try:
        page.listed(episodes.look())
        page.turn()
        assert page._folder == bench / "run-b/one"
        server.gui.set_panel_label("first")
        (choice,) = [m for m in client.until(lambda m: "first" in m.values(), PATIENCE_S) if m.get("value") == NEWEST]
        judged(bench / "run-b/one")
        page.listed(episodes.look())
        assert page._folder == bench / "run-a/two"  # the newest one in the air
        server.gui.set_panel_label("mark")
        sent = client.until(lambda m: "mark" in m.values(), PATIENCE_S)
        assert not [m for m in sent if m.get("name") == "/world/map"]  # the map is the same, and is not sent again
        client.send({"type": "GuiUpdateMessage", "uuid": choice["uuid"], "updates": {"value": "run-b/one"}})
        due_s = time.monotonic() + PATIENCE_S
        while page._choice.value != "run-b/one":  # another thread processes it
            assert time.monotonic() < due_s
            client.receive(0.05)
        page.listed(episodes.look())
        assert page._folder == bench / "run-b/one"  # although it is over
        page.turn()
    finally:
        client.close()
        server.stop()


def placed(client):
    """Wait for the camera position that the page sets in this browser, and return it."""
    kind = "SetCameraPositionMessage"
    sent = client.until(lambda m: m["type"] == kind and not m["initial"], PATIENCE_S)
    return next(m["position"] for m in sent if m["type"] == kind and not m["initial"])


def test_a_new_flight_moves_the_camera_and_keeps_the_users_options(bench, world):
    """This also holds for a browser that connects before the first flight begins."""
    there = replace(world.record, starts=(replace(world.record.starts[0], position_ned=(4.0, 3.0, -2.0), yaw_deg=0.0),))
    (bench / "run-a/two" / layout.EPISODE).write_text(there.to_json())
    os.utime(bench / "run-a/two" / layout.EPISODE, (1_001, 1_001))
    server = LoopbackServer("test", 0)
    page, episodes = LivePage(server, bench), EpisodeList(bench)
    client = PageClient(server.url)
    try:
        server.gui.set_panel_label("come")
        client.until(lambda m: "come" in m.values(), PATIENCE_S)  # nothing flies yet
        page.listed(episodes.look())
        assert page._shown is not None
        page.turn()
        first = placed(client)
        page._shown._judge(True)
        page._shown._follow(0)
        judged(bench / "run-b/one")
        page.listed(episodes.look())
        page.turn()
        assert page._folder == bench / "run-a/two"
        second = placed(client)
        assert second == pytest.approx((3.0 - 3.0, 2.0 + 4.5, 9.0 - 4.0))  # left of the start, above, behind
        assert second != pytest.approx(first)
        assert page._shown.wanted == WantedView(judge=True, followed=0)
        assert (page._shown._panels._follow.value, page._shown._panels._judge.value) == ("drone 1", True)
        client.send({**CAMERA, "position": (50.0, 5.0, 5.0)})
        due_s = time.monotonic() + PATIENCE_S
        while [each.camera.position[0] for each in server.get_clients().values()] != [50.0]:  # another thread does it
            assert time.monotonic() < due_s
            client.receive(0.05)
        page.turn()
        (browser,) = server.get_clients().values()
        assert browser.camera.position == pytest.approx((50.0, 5.0, 5.0))  # the user's own view stays
    finally:
        client.close()
        server.stop()
