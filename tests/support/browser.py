"""A pytest plugin: headless Chromium browsers, one of each kind per session."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from tests import needs

FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)
# draws without a graphics card
SOFTWARE = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--window-size=1300,800")
# no host name resolves; other requests go to a proxy that does not run
NO_NETWORK = ("--host-resolver-rules=MAP * ~NOTFOUND", "--proxy-server=127.0.0.1:9")


@contextmanager
def chromium(profile: Path, *flags: str) -> Iterator[Any]:
    """Yield a driver of a headless Chromium with its own profile. Without a Chromium, the test is skipped."""
    binary = needs.chromium()
    if binary is None:
        pytest.skip(needs.reason("browser"))
    from selenium import webdriver

    options = webdriver.ChromeOptions()
    options.binary_location = binary
    for flag in (*FLAGS, *flags, f"--user-data-dir={profile}"):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    made = webdriver.Chrome(options=options, service=webdriver.ChromeService(shutil.which("chromedriver")))
    try:
        yield made
    finally:
        made.quit()


@pytest.fixture(scope="session")
def drawing_chromium(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """Return a headless Chromium that draws in software."""
    with chromium(tmp_path_factory.mktemp("profile"), *SOFTWARE) as made:
        yield made


@pytest.fixture(scope="module")
def browser(drawing_chromium: Any) -> Iterator[Any]:
    """Yield the drawing browser and leave its page afterwards. An open page keeps drawing and uses a CPU core."""
    yield drawing_chromium
    drawing_chromium.get("about:blank")
    drawing_chromium.get_log("browser")  # drops the page's messages about its stopped server


@pytest.fixture(scope="session")
def driver(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """Return a headless Chromium without a network."""
    flags = (*NO_NETWORK, "--disable-gpu", "--window-size=1300,900")
    with chromium(tmp_path_factory.mktemp("profile"), *flags) as made:
        yield made
