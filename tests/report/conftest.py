"""Fixtures: a browser that opens files without a network, the runs of a page, and the page."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from dronecats.report.page.index import write_page
from dronecats.report.results.collection import collect
from tests.report.paged_runs import EPISODES, MODEL, TABLE
from tests.support.run_folders import run_folder

PATIENCE_S = 60.0  # allows for a busy machine


class Reader:
    """Reads a page in a browser."""

    def __init__(self, driver: Any) -> None:
        self.driver = driver

    def open(self, page: Path, hash_: str = "") -> None:
        """Load a page anew at an address within it."""
        self.driver.get("about:blank")
        self.driver.get(f"{page.as_uri()}{hash_}")
        self.until(lambda: self.script("return document.documentElement.dataset.ready !== undefined"))

    def script(self, text: str, *values: Any) -> Any:
        """Return what a script returns."""
        return self.driver.execute_script(text, *values)

    def until(self, condition: Callable[[], Any]) -> Any:
        """Return the condition's first true value. Raises AssertionError with the page's state after PATIENCE_S."""
        from selenium.common.exceptions import TimeoutException
        from selenium.webdriver.support.ui import WebDriverWait

        try:
            return WebDriverWait(self.driver, PATIENCE_S, poll_frequency=0.05).until(lambda _: condition())
        except TimeoutException:
            raise AssertionError(f"not within {PATIENCE_S:.0f} s; the page: {self.state()}") from None

    def state(self) -> dict[str, Any]:
        """Return the page's state for error messages: address, focus, open details, text and console."""
        script = """return {focus: document.activeElement.outerHTML.slice(0, 200), has_focus: document.hasFocus(),
                            open: [...document.querySelectorAll("[open]")].map((element) => element.className),
                            text: document.querySelector("main").innerText}"""
        return {"hash": self.hash, **self.script(script), "console": self.errors()}

    def all(self, css: str) -> list[Any]:
        """Return all elements that a CSS selector matches."""
        elements: list[Any] = self.driver.find_elements("css selector", css)
        return elements

    def one(self, css: str) -> Any:
        """Return the first displayed element, as soon as there is one."""
        return self.until(lambda: next((element for element in self.all(css) if element.is_displayed()), None))

    def click(self, words: str, within: str = "main") -> None:
        """Click a link or a button by its words."""
        path = f"//{within}//a[normalize-space()='{words}'] | //{within}//button[normalize-space()='{words}']"
        self.until(lambda: next(iter(self.driver.find_elements("xpath", path)), None)).click()

    def press(self, *keys: str) -> None:
        """Press keys, wherever the focus is."""
        from selenium.webdriver.common.action_chains import ActionChains

        for key in keys:
            ActionChains(self.driver).send_keys(key).perform()

    def text(self, css: str = "main") -> str:
        """Return the text of the first displayed element, once there is one. Uses one script, as pages re-render."""
        seen = """const some = [...document.querySelectorAll(arguments[0])];
                  const found = some.find((each) => each.getClientRects().length);
                  return found ? [found.innerText] : null"""
        return str(self.until(lambda: self.script(seen, css))[0])

    @property
    def hash(self) -> str:
        """The address within the page."""
        return str(self.script("return decodeURIComponent(location.hash)"))

    def errors(self) -> list[str]:
        """Return the console's messages since the last call."""
        return [f"{entry['level']}: {entry['message']}" for entry in self.driver.get_log("browser")]

    def requested(self) -> list[str]:
        """Return every address requested since the last call."""
        messages = [json.loads(message["message"])["message"] for message in self.driver.get_log("performance")]
        return [
            message["params"]["request"]["url"]
            for message in messages
            if message["method"] == "Network.requestWillBeSent"
        ]


@pytest.fixture
def reader(driver):
    """Return a reader with a default window and no theme."""
    made = Reader(driver)
    driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})
    made.errors()
    made.requested()
    yield made
    driver.get("about:blank")


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """A model's run, a second flight of it, a built-in pilot's run without images, and a fleet's run."""
    folder = tmp_path_factory.mktemp("bench")
    run_folder(folder / "qwen", EPISODES, model=MODEL)
    run_folder(folder / "qwen-again", EPISODES, model=MODEL, seed=1, steps=9, period_s=1.3)
    run_folder(folder / "oracle", EPISODES, pilot="oracle", pictures=False)
    run_folder(folder / "fleet", {"yard-commanding-01": "go to the right one"}, model=MODEL, seed=2, drones=4)
    return folder


@pytest.fixture(scope="module")
def page(runs, tmp_path_factory):
    return write_page(collect([runs]), [TABLE], tmp_path_factory.mktemp("report"))
