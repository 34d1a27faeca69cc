"""The report page in a real browser, opened from disk without a network: the effects of clicks and keys."""

import re

import pytest

from tests.report.paged_runs import picture_is, point_of, ring_is_at
from tests.support.json_lines import rows
from tests.support.narrow_pages import PHONE, assert_rows_can_be_read_while_scrolling, sized


def test_the_page_opens_without_a_network_and_requests_nothing(reader, page):
    reader.open(page)
    reader.open(page, "#qwen/yard-approaching-01/2")
    picture_is(reader, "qwen/yard-approaching-01/000002.jpg")
    urls = [url for url in reader.requested() if not url.startswith(("about:", "data:", "chrome"))]
    assert urls
    assert all(url.startswith("file://") for url in urls)
    assert reader.errors() == []


def test_network_requests_are_blocked(reader, page):
    """The page's content security policy also applies if there is a network."""
    reader.open(page)
    reader.script("""const image = new Image(); image.src = "http://127.0.0.1:9/x.png"; document.body.append(image);
                     const script = document.createElement("script"); script.textContent = "window.hacked = 3";
                     document.body.append(script)""")
    messages: list[str] = []

    def has_both_messages() -> bool:
        messages.extend(reader.errors())
        return len(messages) > 1

    reader.until(has_both_messages)
    assert all("Content Security Policy" in message for message in messages)
    assert all(any(directive in message for message in messages) for directive in ("img-src", "script-src"))
    assert reader.script("return window.hacked") is None


def test_on_a_phone_row_heads_stay_visible_and_a_shadow_marks_hidden_columns(reader, page):
    sized(reader.driver, PHONE)
    reader.open(page)
    assert_rows_can_be_read_while_scrolling(reader.driver)


def test_clicks_lead_from_the_table_to_a_step_and_back(reader, page, runs):
    reader.open(page)
    top = reader.text("h1")
    reader.click("vllm/Qwen/Qwen3.5-9B")
    assert reader.hash.startswith("#of/")
    reader.click("approaching")
    reader.until(lambda: len(reader.all("main [data-row]")) == 4)  # two episodes, flown twice
    reader.click("yard-approaching-02")
    reader.until(lambda: "“go to the other one”" in reader.text())
    assert reader.hash.startswith("#qwen/yard-approaching-02")
    reader.all(".steps button.row")[2].click()
    picture_is(reader, "qwen/yard-approaching-02/000002.jpg")
    ring_is_at(reader, point_of(runs, "qwen/yard-approaching-02", 2))
    assert reader.hash == "#qwen/yard-approaching-02/2"
    facts = reader.text(".facts")
    for part in ("(512, 700) 6.5 m", "0.50 s", "1002", "14", '"action": "go"'):
        assert part in facts
    truth = next(row for row in rows(runs / "qwen/yard-approaching-02/truth.jsonl", "frame") if row["frame_id"] == 2)
    assert f"{truth['distance_m']:.2f} m" in reader.text(".judge")
    reader.click("approaching", within="header")
    reader.until(lambda: reader.all("main [data-row]"))
    reader.click("Report", within="header")
    reader.until(lambda: reader.text("h1") == top)
    assert reader.errors() == []


def test_keys_lead_from_the_table_to_a_step_and_back(reader, page):
    from selenium.webdriver.common.keys import Keys

    reader.open(page)
    top = reader.text("h1")
    reader.press("j", Keys.ENTER)
    reader.until(lambda: reader.hash.startswith("#of/"))
    reader.until(lambda: reader.script("return document.activeElement.id") == "main")
    reader.press(Keys.ARROW_DOWN, Keys.ARROW_DOWN, "j", "k", Keys.ENTER)
    reader.until(lambda: reader.hash == "#qwen/yard-approaching-01")
    picture_is(reader, "000000.jpg")
    for key, step in ((Keys.ARROW_RIGHT, 1), ("j", 2), ("k", 1), (Keys.ARROW_LEFT, 0), (Keys.END, 5), (Keys.HOME, 0),
                      (Keys.PAGE_DOWN, 5), (Keys.PAGE_UP, 0), ("j", 1)):  # fmt: skip
        reader.press(key)
        picture_is(reader, f"00000{step}.jpg")
        assert reader.hash == f"#qwen/yard-approaching-01/{step}"
    assert "30°" in reader.text(".action")
    assert not reader.all(".ring:not([hidden])")  # a turn has no point
    reader.press("]")
    reader.until(lambda: reader.hash == "#qwen/yard-approaching-02")
    reader.press("?")
    assert reader.script("return document.getElementById('help').open")
    reader.press(Keys.ESCAPE)
    reader.until(lambda: not reader.script("return document.getElementById('help').open"))
    reader.press("u")
    reader.until(lambda: reader.hash.endswith("/approaching"))
    reader.press("u", "u")
    reader.until(lambda: reader.text("h1") == top)
    assert reader.errors() == []


def test_the_slider_moves_picture_and_ring(reader, page, runs):
    reader.open(page, "#qwen/yard-approaching-01")
    for step, t in ((3, 7.95), (4, 12.9), (0, 2.6), (2, 5.3)):
        reader.script("""const time = document.getElementById("time"); time.value = arguments[0];
                         time.dispatchEvent(new Event("input"))""", t)  # fmt: skip
        picture_is(reader, f"00000{step}.jpg")
        ring_is_at(reader, point_of(runs, "qwen/yard-approaching-01", step))
        assert reader.hash == f"#qwen/yard-approaching-01/{step}"
        assert str(step) in reader.one("#time").get_attribute("aria-valuetext")


def test_the_map_shows_the_logged_positions(reader, page, runs):
    """North is up. The map shows the drone's trace, the target and a circle of 5 m around it, in metres."""
    reader.open(page, "#qwen/yard-approaching-01/5")
    poses = rows(runs / "qwen/yard-approaching-01/truth.jsonl", "pose")
    ring, points = reader.script("""const at = (css, ...names) => names.map(
            (name) => document.querySelector(css).getAttribute(name));
        return [at(".plan .radius", "cx", "cy", "r").map(Number), at(".plan .trace.all", "points")[0]]""")
    north, east, _ = poses[0]["target_ned"]
    assert ring == [east, -north, 5.0]
    places = [tuple(map(float, point.split(","))) for point in points.split()]
    expected = [(row["position_ned"][1], -row["position_ned"][0]) for row in poses]
    assert [x for place in places for x in place] == pytest.approx([x for place in expected for x in place], abs=0.006)
    middle = reader.script("""const box = (css) => document.querySelector(css).getBoundingClientRect();
        const [drone, target] = [box(".plan .drone"), box(".plan .target")]; return [drone.y, target.y]""")
    assert middle[0] > middle[1]  # the drone starts in the south


def test_an_address_opens_its_step_and_an_unknown_one_is_reported(reader, page):
    reader.open(page, "#qwen-again/yard-searching-01/7")
    picture_is(reader, "qwen-again/yard-searching-01/000007.jpg")
    assert "7" in reader.text(".facts h2")
    reader.open(page, "#nobody/nowhere/3")
    assert "nobody/nowhere" in reader.text()
    reader.open(page, "#of/nobody")
    assert "nobody" in reader.text()


def test_two_runs_are_shown_side_by_side(reader, page, runs):
    from selenium.webdriver.support.ui import Select

    reader.open(page, "#qwen/yard-approaching-01/2")
    offered = [option.text for option in Select(reader.one("#rival")).options]
    assert len(offered) == 3
    Select(reader.one("#rival")).select_by_value("qwen-again")
    reader.until(lambda: len(reader.all(".view")) == 2)
    assert reader.hash == "#qwen/yard-approaching-01/2/qwen-again"
    for view, (run, step) in enumerate((("qwen", 2), ("qwen-again", 4))):  # at the same time
        picture_is(reader, f"{run}/yard-approaching-01/00000{step}.jpg", view)
        ring_is_at(reader, point_of(runs, f"{run}/yard-approaching-01", step), view)
    assert len(reader.all(".facts")) == 2
    assert len(reader.all(".plan .trace.all")) == 2
    reader.press("j")
    for view, name in enumerate(("qwen/yard-approaching-01/000003.jpg", "qwen-again/yard-approaching-01/000006.jpg")):
        picture_is(reader, name, view)
    Select(reader.one("#rival")).select_by_value("")
    reader.until(lambda: len(reader.all(".view")) == 1)
    assert reader.hash == "#qwen/yard-approaching-01/3"
    assert reader.errors() == []


def test_a_fleet_is_shown_with_four_pictures_and_four_traces(reader, page, runs):
    reader.open(page, "#fleet/yard-commanding-01/2")
    assert len(reader.all(".view")) == len(reader.all(".plan .trace.all")) == len(reader.all(".chart .curve")) == 4
    for drone in range(4):
        name = f"{8 + drone:06}{f'_d{drone}' if drone else ''}.jpg"
        picture_is(reader, name, drone)
        ring_is_at(reader, point_of(runs, "fleet/yard-commanding-01", 2, drone), drone)
    for key in "31":
        reader.press(key)
        reader.until(lambda key=key: re.search(rf"\b2\b.*\b{key}$", reader.text(".facts h2")))
    reader.click("Drone 4")
    reader.until(lambda: re.search(r"\b2\b.*\b4$", reader.text(".facts h2")))
    assert reader.errors() == []


def test_a_run_without_pictures_still_shows_its_view_and_ring(reader, page, runs):
    reader.open(page, "#oracle/yard-approaching-01/2")
    assert reader.text(".view")
    ring_is_at(reader, point_of(runs, "oracle/yard-approaching-01", 2))
    assert reader.errors() == []


def test_an_unfolded_prompt_shows_the_text_of_each_step(reader, page):
    reader.open(page, "#qwen/yard-approaching-01/2")
    assert not reader.one("details.prompt").get_attribute("open")
    reader.one("details.prompt summary").click()
    assert "Command: go to the cyan car" in reader.text("details.prompt pre")
    assert "1. GO x=320 y=288 depth=6.5m" in reader.text("details.prompt pre")
    reader.press("j")
    reader.until(lambda: "3. GO x=655 y=504" in reader.text("details.prompt pre"))


def test_a_prompt_unfolded_just_before_the_next_step_stays_unfolded(reader, page):
    """The key press arrives before the browser's event for the unfolding."""
    reader.open(page, "#qwen/yard-approaching-01/2")
    reader.script("""document.querySelector("details.prompt summary").click();
                     document.body.dispatchEvent(new KeyboardEvent("keydown", {key: "j", bubbles: true}))""")
    assert reader.hash.endswith("/3")
    assert reader.script("return document.querySelector('details.prompt').open")
