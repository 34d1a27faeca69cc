"""Generates pictures of the documentation. `make pictures` flies the episodes and rewrites the pictures."""

import socket
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageColor

from dronecats.flight.picture import FLIGHT_COLORS
from dronecats.flight.spec.flight_spec import FlightSpec, Simulated
from dronecats.report.kit import palette
from dronecats.view.live.scene import CHOSEN
from dronecats.view.live.viewer_process import LiveFlight
from dronecats.view.replay.moments import flight_moments
from dronecats.view.replay.page import RUN_COLORS, ReplayPage
from dronecats.view.replay.views import RedrawnView
from dronecats.view.scene.page import LoopbackServer
from foundation.run_folder import layout
from tests.docs.pages import ROOT
from tests.support.browser import SOFTWARE, chromium
from tests.support.ports import free_port

FOLDER = ROOT / "docs" / "pictures"
FLIGHT = "residential-approaching-01"
REPLAY, REPLAY_S = "campus-approaching-04", 80.0
LIVE, LIVE_S = "residential-approaching-03", 12.0
REPORTED, REPORTED_STEP = "residential-tracking-01", 3
PALETTE = 256
PATIENCE_S = 120.0


@dataclass(frozen=True, slots=True)
class MadePicture:
    """A generated picture, and the required properties of its committed file."""

    name: str
    size: tuple[int, int]  # px, width and height
    colors: tuple[tuple[int, int, int], ...]  # sRGB, of the marks that its caption describes


def rgb_of(color: str) -> tuple[int, int, int]:
    """Parse a colour written as #rrggbb."""
    red, green, blue = ImageColor.getrgb(color)[:3]
    return red, green, blue


FLIGHT_PICTURE = MadePicture("flight.png", (1000, 1000), tuple(map(rgb_of, FLIGHT_COLORS)))
REPLAY_PICTURE = MadePicture("replay.jpg", (1200, 675), (*(palette.shade(color) for color in RUN_COLORS[:2]), CHOSEN))

LIVE_PICTURE = MadePicture("watching.jpg", (1400, 757), (CHOSEN,))
REPORT_PICTURE = MadePicture("report-step.jpg", (1100, 701), (CHOSEN,))
MADE = (FLIGHT_PICTURE, REPLAY_PICTURE, LIVE_PICTURE, REPORT_PICTURE)


def fly_episode(folder: Path, episode: str, pilot: str) -> Path:
    """Fly an episode in lockstep with rendered camera images and return its folder."""
    from dronecats.flight.run.fly import fly

    fly(FlightSpec(pilot=pilot, episode=episode, simulated=Simulated(speed=None)), folder / pilot, print)
    return folder / pilot / episode


def flight_picture(folder: Path) -> NDArray[np.uint8]:
    """Return the flight picture of a run folder, (H, W, 3) RGB, resized to the size of the committed file."""
    drawn: Any = cv2.imread(str(folder / layout.PICTURE))
    return np.asarray(cv2.resize(drawn, FLIGHT_PICTURE.size, interpolation=cv2.INTER_AREA)[..., ::-1], np.uint8)


def few_colors(picture: NDArray[np.uint8], marks: tuple[tuple[int, int, int], ...]) -> Any:
    """Reduce a picture to 256 colours that include those of the marks.

    A palette of only the most frequent colours turns the marks grey.
    """
    image = Image.fromarray(picture)
    frequent = image.quantize(PALETTE - len(marks), method=Image.Quantize.MEDIANCUT).getpalette() or []
    palette = Image.new("P", (1, 1))
    palette.putpalette([*frequent[: 3 * (PALETTE - len(marks))], *(part for mark in marks for part in mark)])
    return image.quantize(palette=palette, dither=Image.Dither.NONE)


@contextmanager
def shown(url: str, size: tuple[int, int]) -> Iterator[Any]:
    """Yield a browser (a Selenium driver) of this size that shows a page."""
    with tempfile.TemporaryDirectory() as profile, chromium(Path(profile), *SOFTWARE) as driver:
        metrics = {"width": size[0], "height": size[1], "deviceScaleFactor": 1, "mobile": False}
        driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
        driver.get(url)
        yield driver


def standing(driver: Any) -> NDArray[np.uint8]:
    """Return a screenshot, (H, W, 3) BGR, after six identical screenshots in a row."""
    from selenium.webdriver.support.ui import WebDriverWait

    seen: list[bytes] = []

    def is_still(_: Any) -> bool:
        # Remove notifications: one reports that this machine has no graphics card.
        driver.execute_script(
            "document.querySelectorAll('.mantine-Notification-root').forEach((each) => each.remove())"
        )
        seen.append(driver.get_screenshot_as_png())
        return len(seen) >= 6 and len(set(seen[-6:])) == 1

    WebDriverWait(driver, PATIENCE_S, poll_frequency=1.0).until(is_still)
    return np.asarray(cv2.imdecode(np.frombuffer(seen[-1], np.uint8), cv2.IMREAD_COLOR), np.uint8)


def replay_picture(folders: list[Path]) -> NDArray[np.uint8]:
    """Return the replay page of two overlaid flights, (H, W, 3) BGR."""
    page = ReplayPage([flight_moments(each) for each in folders], free_port(socket.SOCK_STREAM), at_s=REPLAY_S)
    try:
        with shown(page.url, REPLAY_PICTURE.size) as driver:
            while page.state.view is not RedrawnView.CHASE:
                page.next_view()
            page.idle(PATIENCE_S)
            return standing(driver)
    finally:
        page.close()


def live_picture(folder: Path) -> NDArray[np.uint8]:
    """Return the live page in the middle of a flight, (H, W, 3) BGR."""
    flight = flight_moments(folder)
    server = LoopbackServer("DroneCATS · vision", free_port(socket.SOCK_STREAM))
    try:
        server.gui.set_panel_label("DroneCATS · vision")
        server.gui.main_panel.dock_right()
        trails = {0: flight.way(0, LIVE_S, 0.1)}
        moment = flight.moment(LIVE_S)
        live = LiveFlight(server, lambda: moment, flight.world, 1, flight.recorded.camera, trails)
        live.turn()
        with shown(server.url, LIVE_PICTURE.size) as driver:
            standing(driver)
            live.turn()  # moves the camera of the newly connected browser to the drone
            return standing(driver)
    finally:
        server.stop()


def report_picture(run: Path, out: Path) -> NDArray[np.uint8]:
    """Write a report to `out` and return its page at one step of a flight, (H, W, 3) BGR."""
    from dronecats.cli.main import main

    assert main(["report", str(run), "--out", str(out)]) == 0
    url = f"{(out / 'index.html').as_uri()}#{run.name}/{REPORTED}/{REPORTED_STEP}"
    with shown(url, REPORT_PICTURE.size) as driver:
        return standing(driver)


def save_jpeg(picture: NDArray[np.uint8], path: Path) -> None:
    """Write a picture, (H, W, 3) BGR, without blurring its colours."""
    Image.fromarray(picture[..., ::-1]).save(path, quality=88, subsampling=0, optimize=True)


def write(folder: Path) -> None:
    """Fly the episodes and write all pictures into a folder."""
    with tempfile.TemporaryDirectory() as runs:
        picture = flight_picture(fly_episode(Path(runs) / "flight", FLIGHT, "vision"))
        few_colors(picture, FLIGHT_PICTURE.colors).save(folder / FLIGHT_PICTURE.name, optimize=True)
        replayed = replay_picture([fly_episode(Path(runs) / "replay", REPLAY, pilot) for pilot in ("vision", "oracle")])
        save_jpeg(replayed, folder / REPLAY_PICTURE.name)
        save_jpeg(live_picture(fly_episode(Path(runs) / "live", LIVE, "vision")), folder / LIVE_PICTURE.name)
        reported = fly_episode(Path(runs) / "reported", REPORTED, "vision").parent
        save_jpeg(report_picture(reported, Path(runs) / "report"), folder / REPORT_PICTURE.name)


if __name__ == "__main__":
    write(Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER)
