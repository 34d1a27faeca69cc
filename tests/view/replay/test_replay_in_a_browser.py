"""The replay page in a real browser: keys, positions, several flights, the judge's view and redrawn views."""

import math
import re
import socket
from types import SimpleNamespace

import pytest

from dronecats.view.replay import player
from dronecats.view.replay.moments import OccurrenceKind, flight_moments
from dronecats.view.replay.page import ReplayPage
from dronecats.view.replay.player import SPEEDS, PlaybackClock
from dronecats.view.replay.views import RedrawnView
from dronecats.view.scene import display
from foundation.run_folder import layout
from tests.support.json_lines import rows
from tests.support.ports import free_port
from tests.support.run_folders import run_folder
from tests.view.replay.sent import Sent

pytestmark = pytest.mark.slow
PATIENCE_S = 120.0  # a software renderer on a busy machine
JUDGES = ("target (judge)", "/judge/", "known to the judge only", "verdict:", "to the target")


@pytest.fixture(scope="module")
def flights(flight, runs):
    return [flight, flight_moments(runs / "other")]


@pytest.fixture
def opened(browser):
    """A function that opens a page of flights in the browser. The fixture closes the page after the test."""
    made: list[ReplayPage | Sent] = []

    def serve(flights, **options):
        page = ReplayPage(flights, free_port(socket.SOCK_STREAM), **options)
        made.append(page)
        sent = Sent(page.url)
        made.append(sent)
        browser.get_log("browser")  # drops the log of earlier pages
        browser.get(page.url)
        until(
            browser,
            lambda: "Additional view" in text(browser) and str(flights[0].recorded.instruction) in text(browser),
        )
        return page, sent

    yield serve
    browser.get("about:blank")
    for one in reversed(made):
        one.close()


def until(browser, condition):
    from selenium.common.exceptions import StaleElementReferenceException
    from selenium.webdriver.support.ui import WebDriverWait

    wait = WebDriverWait(browser, PATIENCE_S, poll_frequency=0.05, ignored_exceptions=[StaleElementReferenceException])
    return wait.until(lambda _: condition())


def text(browser) -> str:
    from selenium.webdriver.common.by import By

    return str(browser.find_element(By.TAG_NAME, "body").text)


def press(browser, *keys) -> None:
    """Press the last key while the others are held."""
    from selenium.webdriver.common.action_chains import ActionChains

    hands = ActionChains(browser)
    for key in keys[:-1]:
        hands.key_down(key)
    hands.send_keys(keys[-1])
    for key in keys[:-1]:
        hands.key_up(key)
    hands.perform()


def shown_at(browser, page, t_s):
    """Wait until the clock is at a time and the page shows it."""
    until(browser, lambda: page.t_s == pytest.approx(t_s) and page.idle(0.0) and f"{t_s:.1f} s of" in text(browser))


@pytest.fixture
def plain(tmp_path):
    """The folder of a made-up episode without a world. A browser draws its plain grid quickly."""
    return run_folder(tmp_path / "plain", {"nowhere-approaching-01": "go there"}) / "nowhere-approaching-01"


def test_keys_control_time_speed_playback_and_help(browser, opened, plain, monkeypatch):
    from selenium.webdriver.common.keys import Keys

    wall = SimpleNamespace(now_s=100.0)
    wall.monotonic = lambda: wall.now_s
    monkeypatch.setattr(player, "time", wall)
    flight = flight_moments(plain)
    page, _ = opened([flight])
    decided = [one.t_s for one in flight.of(OccurrenceKind.DECISION)]
    assert len(decided) > 1
    shown_at(browser, page, 0.0)
    press(browser, Keys.ARROW_RIGHT)
    shown_at(browser, page, decided[0])
    press(browser, Keys.ARROW_RIGHT)
    shown_at(browser, page, decided[1])
    press(browser, Keys.ARROW_LEFT)
    shown_at(browser, page, decided[0])
    press(browser, Keys.SHIFT, Keys.ARROW_RIGHT)
    shown_at(browser, page, decided[0] + 0.1)
    press(browser, Keys.SHIFT, Keys.ARROW_LEFT)
    shown_at(browser, page, decided[0])
    press(browser, Keys.END)
    shown_at(browser, page, flight.end_s)
    press(browser, Keys.ARROW_RIGHT)  # there is no later decision
    press(browser, Keys.HOME)
    shown_at(browser, page, 0.0)
    for key, speed in (("+", 2.0), ("=", 5.0), ("-", 2.0), ("-", 1.0)):
        press(browser, key)
        until(browser, lambda speed=speed: page.clock.speed == speed and f"· {speed:g}×" in text(browser))
    press(browser, " ")
    until(browser, lambda: page.clock.playing)
    wall.now_s += 0.7
    until(browser, lambda: "▶ " in text(browser) and "0.7 s of" in text(browser))
    press(browser, " ")
    until(browser, lambda: not page.clock.playing)
    assert page.t_s == pytest.approx(0.7)
    assert page.t_s < flight.end_s
    press(browser, Keys.SHIFT, "?")
    until(browser, lambda: "next declaration" in text(browser))
    press(browser, "?")
    until(browser, lambda: "next declaration" not in text(browser))
    assert page.clock.speed in SPEEDS


def test_d_and_f_jump_to_declarations_and_faults(browser, opened, plain, rewrite):
    from selenium.webdriver.common.keys import Keys

    steps = [row["step"] for row in rows(plain / layout.DECISIONS)]

    def another(row):
        if row["step"] == steps[0]:
            return {**row, "action": None, "error": "there is no JSON in it", "reply": "<b>hm</b>"}
        return {**row, "action": {"action": "finished"}} if row["step"] == steps[-1] else row

    rewrite(plain / layout.DECISIONS, another)
    flight = flight_moments(plain)
    (declared,), (fault,) = flight.of(OccurrenceKind.DECLARATION), flight.of(OccurrenceKind.FAULT)
    page, _ = opened([flight])
    press(browser, "d")
    shown_at(browser, page, declared.t_s)
    press(browser, Keys.SHIFT, "f")
    shown_at(browser, page, fault.t_s)
    until(browser, lambda: "there is no JSON in it" in text(browser) and "<b>hm</b>" in text(browser))
    press(browser, Keys.HOME)
    press(browser, "f")
    shown_at(browser, page, fault.t_s)
    press(browser, Keys.END)
    press(browser, Keys.SHIFT, "d")
    shown_at(browser, page, declared.t_s)


def test_the_drone_is_shown_at_the_positions_of_truth_jsonl(browser, opened, flight, folder):
    page, sent = opened([flight])
    poses = rows(folder / layout.TRUTH, "pose")
    for row in poses[1:10:3]:
        page.order(PlaybackClock.scrubbed, row["t"])
        shown_at(browser, page, row["t"])
        until(browser, lambda row=row: away(sent, "/world/flight/drone-0", row["position_ned"]) < 0.02)


def away(sent, node, place):
    """Return the distance between a node of the page and a position, m."""
    position = sent.newest("SetPositionMessage", node)["position"]
    return math.dist(display.ned_of(tuple(position)), place)


def test_two_flights_are_shown_together_and_digits_choose_one(browser, opened, flights, runs):
    page, sent = opened(flights)
    assert re.search(r"1 paper\b.*oracle", text(browser))
    assert re.search(r"2 other\b.*oracle.*seed 3", text(browser))
    row = rows(runs / "paper" / flights[0].recorded.id / layout.TRUTH, "pose")[9]
    page.order(PlaybackClock.scrubbed, row["t"])
    shown_at(browser, page, row["t"])
    until(browser, lambda: away(sent, "/world/1 paper/drone-0", row["position_ned"]) < 0.02)
    other = flights[1].pose(0, row["t"]).position_ned
    until(browser, lambda: away(sent, "/world/2 other/drone-0", other) < 0.001)
    assert flights[0].pose(0, row["t"]) != flights[1].pose(0, row["t"])
    assert page.state.flight == 0
    press(browser, "2")
    until(browser, lambda: page.state.flight == 1 and page.idle(0.0))
    press(browser, "1")
    until(browser, lambda: page.state.flight == 0 and page.idle(0.0))


def test_judge_data_is_sent_only_on_demand(browser, opened, flight):
    from selenium.webdriver.common.keys import Keys

    page, sent = opened([flight])
    press(browser, Keys.END)
    shown_at(browser, page, flight.end_s)
    press(browser, "v")
    assert page.idle(PATIENCE_S)
    sent_text = sent.text()
    assert "/world/flight/drone-0" in sent_text
    assert [word for word in JUDGES if word in sent_text] == []
    press(browser, "j")
    until(browser, lambda: "known to the judge only" in text(browser) and "verdict:" in text(browser))
    assert [word for word in JUDGES if word in sent.text()] == list(JUDGES)
    ring = sent.newest("SetPositionMessage", "/world/flight/judge/name")["position"]
    target = rows(flight.recorded.folder / layout.TRUTH, "pose")[-1]["target_ned"]
    assert math.dist(display.ned_of(tuple(ring))[:2], target[:2]) < 0.5
    press(browser, "j")
    until(browser, lambda: "known to the judge only" not in text(browser))


def test_v_cycles_through_the_redrawn_views(browser, opened, flight):
    page, _ = opened([flight], at_s=3.0)
    shown = []
    for view in RedrawnView:
        press(browser, "v")
        until(browser, lambda view=view: page.state.view is view and f"{view.value} at 3.0 s" in text(browser))
        shown.append(until(browser, lambda: picture(browser)))
    assert len(set(shown)) == 3
    page.order(PlaybackClock.stepped, 0.5)
    until(browser, lambda: f"{view.value} at 3.5 s" in text(browser) and picture(browser) not in (None, shown[-1]))
    press(browser, "v")
    until(browser, lambda: page.state.view is None and picture(browser) is None)


def picture(browser):
    """Return the URL of the picture of the shown view; None without one."""
    from selenium.webdriver.common.by import By

    images = [image for image in browser.find_elements(By.CSS_SELECTOR, "img[src^=blob]") if image.is_displayed()]
    return images[0].get_attribute("src") if images else None


def test_g_follows_a_drone_and_buttons_and_lists_act_like_keys(browser, opened, flight):
    from selenium.webdriver.common.by import By

    page, sent = opened([flight])
    press(browser, "g")
    until(browser, lambda: page.state.along and page.idle(0.0))
    press_button(browser, "▶|")
    shown_at(browser, page, flight.end_s)
    moved = sent.newest("SetPositionMessage", "/world")["position"]
    distance_m = math.dist(flight.pose(0, 0.0).position_ned, flight.pose(0, flight.end_s).position_ned)
    assert math.hypot(*moved) == pytest.approx(distance_m, abs=0.05)
    press_button(browser, "-0.1")
    shown_at(browser, page, flight.end_s - 0.1)
    box = until(browser, lambda: next((e for e in browser.find_elements(By.TAG_NAME, "input")
                                       if (e.get_attribute("value") or "").endswith(" to jump to")), None))  # fmt: skip
    browser.execute_script("arguments[0].click(); arguments[0].focus()", box)
    first = flight.of(OccurrenceKind.DECISION)[0]
    path = f"//*[@role='option'][contains(., '1. {first.t_s:.1f} s')]"
    entry = until(browser, lambda: next((e for e in browser.find_elements(By.XPATH, path) if e.is_displayed()), None))
    browser.execute_script("arguments[0].click()", entry)
    shown_at(browser, page, first.t_s)
    severe = [line["message"] for line in browser.get_log("browser") if line["level"] == "SEVERE"]
    assert not [line for line in severe if "favicon" not in line]


def press_button(browser, label):
    from selenium.webdriver.common.by import By

    path = f"//button[normalize-space()='{label}']"
    until(browser, lambda: next((b for b in browser.find_elements(By.XPATH, path) if b.is_displayed()), None)).click()
