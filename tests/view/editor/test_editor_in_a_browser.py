"""The editor in a real browser: clicks, drags and text reach the record, the checks and the file."""

import math
import re
import socket
import urllib.parse
import urllib.request

import pytest

from dronecats.view.editor.editor import Editor
from dronecats.view.scene import display
from episodes.records import catalogue

pytestmark = pytest.mark.slow
PATIENCE_S = 120.0  # a software renderer on a busy machine


@pytest.fixture
def editor(yard, tmp_path, port):
    made = Editor(yard, tmp_path / "records", port)
    yield made
    made.close()


@pytest.fixture
def page(editor, browser):
    browser.get(editor.url)
    until(browser, lambda: "Write the record" in text(browser) and "checks passed" in text(browser))
    return browser


def until(browser, condition):
    from selenium.common.exceptions import StaleElementReferenceException
    from selenium.webdriver.support.ui import WebDriverWait

    wait = WebDriverWait(browser, PATIENCE_S, poll_frequency=0.1, ignored_exceptions=[StaleElementReferenceException])
    return wait.until(lambda _: condition())


def text(browser) -> str:
    from selenium.webdriver.common.by import By

    return str(browser.find_element(By.TAG_NAME, "body").text)


def field(browser, label):
    """Return the input beside a label."""
    from selenium.webdriver.common.by import By

    script = """
    const label = [...document.querySelectorAll('label, div')].find(
        (e) => e.childElementCount === 0 && e.textContent.trim() === arguments[0]);
    for (let e = label; e; e = e.parentElement) {
        const found = e.querySelector('input:not([type=hidden]), textarea');
        if (found) return found;
    }"""
    assert By.TAG_NAME
    return until(browser, lambda: browser.execute_script(script, label))


def press(browser, label) -> None:
    from selenium.webdriver.common.by import By

    path = f"//button[normalize-space()='{label}'] | //*[@role='tab'][normalize-space()='{label}']"
    until(browser, lambda: next((b for b in browser.find_elements(By.XPATH, path) if b.is_displayed()), None)).click()


def choose(browser, label, option) -> None:
    """Open the drop-down list beside a label and select an option."""
    from selenium.webdriver.common.by import By

    box = field(browser, label)
    browser.execute_script("arguments[0].click(); arguments[0].focus()", box)
    path = f"//*[@role='option'][normalize-space()='{option}']"
    entry = until(browser, lambda: next((e for e in browser.find_elements(By.XPATH, path) if e.is_displayed()), None))
    browser.execute_script("arguments[0].click()", entry)


def write(browser, label, words) -> None:
    from selenium.webdriver.common.keys import Keys

    box = field(browser, label)
    box.send_keys(Keys.CONTROL, "a")
    box.send_keys(words)


def on_screen(editor, browser, place_ned) -> tuple[int, int]:
    """Return the pixel at which the first browser shows a position, relative to the centre of the canvas."""
    client = next(iter(editor._server.get_clients().values()))
    canvas = browser.execute_script(
        "const r = [...document.querySelectorAll('canvas')].map((c) => c.getBoundingClientRect())"
        ".sort((a, b) => b.width * b.height - a.width * a.height)[0]; return [r.width, r.height]"
    )
    import numpy as np

    w, x, y, z = client.camera.wxyz
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    seen = turn.T @ (np.array(display.place_of(place_ned)) - client.camera.position)
    focal = canvas[1] / 2 / math.tan(client.camera.fov / 2)
    return round(focal * seen[0] / seen[2]), round(focal * seen[1] / seen[2])


def the_canvas(browser):
    from selenium.webdriver.common.by import By

    return max(browser.find_elements(By.TAG_NAME, "canvas"), key=lambda c: c.size["width"] * c.size["height"])


def click_at(editor, browser, place_ned) -> None:
    from selenium.webdriver.common.action_chains import ActionChains

    dx, dy = on_screen(editor, browser, place_ned)
    ActionChains(browser).move_to_element_with_offset(the_canvas(browser), dx, dy).click().perform()


def test_a_user_creates_an_episode(editor, page, tmp_path):
    """The test sets asset, paint, target, text and file, with undo. It checks the page and the record each time."""
    record = editor.session.record
    assert record.target.asset == "suv"
    choose(page, "Asset", "van")
    until(page, lambda: editor.session.record.target.asset == "van")
    choose(page, "Paint", "orange")
    until(page, lambda: editor.session.record.target.paint == "orange")
    press(page, "Episode")
    until(page, lambda: field(page, "Instruction").get_attribute("value") == "go to the orange van")

    choose(page, "A click on the map", "Place the target")
    click_at(editor, page, (12.0, -2.0, 0.0))
    until(page, lambda: math.dist(editor.session.record.target.position_ned, (12.0, -2.0, 0.0)) < 0.5)
    assert editor.session.record.target.position_ned[2] == 0.0
    until(page, lambda: f"{editor.session.record.start_distance_m:.2f} m" in text(page))

    press(page, "Undo")
    until(page, lambda: editor.session.record.target.position_ned[0] == record.target.position_ned[0])
    press(page, "Redo")
    until(page, lambda: editor.session.record.target.position_ned[0] != record.target.position_ned[0])

    write(page, "Instruction", "fly to that <b>orange</b> van")
    until(page, lambda: editor.session.record.instruction == "fly to that <b>orange</b> van")
    write(page, "Id", "my-van")
    until(page, lambda: editor.session.record.id == "my-van")
    assert editor.idle(PATIENCE_S)
    press(page, "Write the record")
    until(page, lambda: (tmp_path / "records" / "my-van.json").is_file())
    until(page, lambda: "Written:" in text(page))
    assert catalogue.load(tmp_path / "records" / "my-van.json") == editor.session.record
    assert "that <b>orange</b> van" in text(page)  # shown as text

    press(page, "Write the record")
    until(page, lambda: "exists already" in text(page))
    press(page, "Replace the file")
    until(page, lambda: "Written:" in text(page))
    severe = [line["message"] for line in page.get_log("browser") if line["level"] == "SEVERE"]
    assert not [line for line in severe if "favicon" not in line]


def test_dragging_the_target_into_the_shed_fails_a_check_until_undo(editor, page):
    """The mouse drags the gizmo. The shed is at the destination."""
    from selenium.webdriver.common.action_chains import ActionChains

    assert editor.idle(PATIENCE_S)
    until(page, lambda: re.search(r"\d+ of \d+ checks passed", text(page)))
    before = editor.session.record.target.position_ned
    dx, dy = on_screen(editor, page, (before[0] - 1.0, before[1] + 1.0, before[2]))  # the square between the arrows
    ex, ey = on_screen(editor, page, (6.0 - 1.0, 9.0 + 1.0, before[2]))
    hand = ActionChains(page, duration=400).move_to_element_with_offset(the_canvas(page), dx, dy).click_and_hold()
    for k in range(1, 9):
        hand.move_to_element_with_offset(the_canvas(page), dx + (ex - dx) * k // 8, dy + (ey - dy) * k // 8)
    hand.release().perform()
    until(page, lambda: editor.session.record.target.position_ned != before)
    # the messages of the drag may still come, so wait for the last place and for its checks
    until(page, lambda: math.dist(editor.session.record.target.position_ned[:2], (6.0, 9.0)) < 0.5)
    until(page, lambda: editor.idle(0.0) and not passed(editor, "the obstacle at the target's place"))
    until(page, lambda: "required: nothing" in text(page))
    press(page, "Undo")
    until(page, lambda: editor.session.record.target.position_ned == before)
    until(page, lambda: "required: nothing" not in text(page))


def passed(editor, rule) -> bool:
    """Return whether a check of the record has passed."""
    return bool({finding.rule: finding for finding in editor.findings}[rule].passed)


def test_a_click_adds_a_waypoint_to_the_path(editor, page):
    press(page, "Episode")
    choose(page, "Cell", "tracking")
    until(page, lambda: editor.session.record.target.path is not None)
    choose(page, "A click on the map", "Add a point to the path")
    count = len(editor.session.draft.knots)
    click_at(editor, page, (14.0, -6.0, 0.0))
    until(page, lambda: len(editor.session.draft.knots) == count + 1)
    assert math.dist(editor.session.draft.knots[-1], (14.0, -6.0)) < 0.5
    assert editor.session.record.instruction == "follow the cyan SUV"


def test_the_page_is_served_to_this_machine_only(editor):
    port = urllib.parse.urlsplit(editor.url).port
    assert urllib.request.urlopen(editor.url).status == 200
    outside = {str(info[4][0]) for info in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET)} - {
        "127.0.0.1"
    }
    for address in outside:
        if address.startswith("127."):
            continue
        with pytest.raises(OSError), socket.create_connection((address, port), timeout=2.0):
            pass
    assert editor._server.request_share_url() is None
