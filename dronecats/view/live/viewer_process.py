"""The live page: the list of flights, the shown flight, and the child process that serves the page."""

import math
import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter
from pathlib import Path
from typing import Any

import viser

from dronecats.view.live.config import ViewerConfig
from dronecats.view.live.folder import EpisodeList, WatchedEpisode, load_camera, load_world
from dronecats.view.live.follow import FlightFollower
from dronecats.view.live.moment import Moment
from dronecats.view.live.panels import FlightPanels
from dronecats.view.live.scene import WORLD, FlightScene
from dronecats.view.live.wire_state import WireFollower
from dronecats.view.scene.page import LoopbackServer
from episodes.records import catalogue
from episodes.world.world import World
from foundation.camera import CameraModel
from foundation.frames import Vec3, quat_yaw
from foundation.run_folder import layout
from foundation.run_folder.reading import json_object

NEWEST = "the newest"
LISTED = 200  # the list of choices has at most this many flights
WAITING = '<div style="font-size:13px;padding:4px 10px">waiting for a flight …</div>'


@dataclass(frozen=True, slots=True)
class WantedView:
    """The choices of a user, which are kept for the next flight."""

    judge: bool = False  # the judge's view
    followed: int | None = None  # the drone that the view follows


class LiveFlight:
    """One flight on the page."""

    def __init__(
        self,
        server: viser.ViserServer,
        next_moment: Callable[[], Moment],
        world: World | None,
        drones: int,
        camera: CameraModel | None = None,
        trails: Mapping[int, Sequence[Vec3]] | None = None,
        wanted: WantedView | None = None,
        piloted: bool = True,
    ) -> None:
        """`next_moment` returns the current moment.

        `trails`: earlier positions of each drone (m, NED); the first call of `next_moment` fills them. `wanted`: the
        user's choices so far; `piloted`: whether a pilot gets pictures.
        """
        self._next_moment, self._trails = next_moment, trails
        self._start = world.record.starts[0] if world else None
        self._scene = FlightScene(server, world.scene if world else None, drones=drones, camera=camera)
        self._panels = FlightPanels(server, drones, piloted=piloted, on_judge=self._judge, on_follow=self._follow)
        self.wanted = wanted or WantedView()
        if self.wanted.followed is not None and self.wanted.followed >= drones:
            self.wanted = replace(self.wanted, followed=None)
        self._panels.show_wanted(self.wanted.judge, self.wanted.followed)
        self._scene.judge_shown = self.wanted.judge
        self._scene.follow(self.wanted.followed)

    def turn(self) -> None:
        moment = self._next_moment()
        for drone, places in (self._trails or {}).items():
            self._scene.show_trail(drone, places)
        self._trails = None
        self._scene.show(moment)
        self._bring(moment)
        self._panels.show(moment)

    def remove(self) -> None:
        self._panels.remove()
        self._scene.remove()

    def _bring(self, moment: Moment) -> None:
        """Move the view of new browsers to the first drone with a known position, else to the first drone's start."""
        for drone in moment.drones:
            if drone.position_ned is not None:
                self._scene.move_new_views(drone.position_ned, quat_yaw(drone.attitude))
                return
        if self._start is not None:
            self._scene.move_new_views(self._start.position_ned, math.radians(self._start.yaw_deg))

    def _judge(self, shown: bool) -> None:
        self.wanted = replace(self.wanted, judge=shown)
        self._scene.judge_shown = shown

    def _follow(self, drone: int | None) -> None:
        self.wanted = replace(self.wanted, followed=drone)
        self._scene.follow(drone)


class LivePage:
    """Shows one of the flights of a folder: the newest that is not over, until a user chooses another."""

    def __init__(self, server: viser.ViserServer, root: Path) -> None:
        self._server = server
        self._episodes, self._due_s = EpisodeList(root), 0.0
        self._shown: LiveFlight | None = None
        self._folder: Path | None = None  # the folder of the shown flight
        self._begun_ns = 0  # when this flight was prepared; a later flight may use the same folder
        self._ground: object = None  # identifies the shown map
        server.gui.main_panel.dock_right()
        self._waiting = server.gui.add_html(WAITING)
        self._choice: Any = server.gui.add_dropdown("Flight", (NEWEST,), initial_value=NEWEST, visible=False)
        self._list = server.gui.add_html("", visible=False)

    def listed(self, episodes: list[WatchedEpisode]) -> None:
        """Update the list of flights (newest first), and open the chosen flight."""
        self._show_list(episodes)
        wanted = self._wanted(episodes)
        if wanted is None or (wanted.folder, wanted.begun_ns) == (self._folder, self._begun_ns):
            return
        kept = None
        if self._shown is not None:
            kept = self._shown.wanted
            self._shown.remove()
        ground = _ground(wanted.folder)
        if ground != self._ground and self._server.scene.get_handle_by_name(WORLD) is not None:
            self._server.scene.remove_by_name(WORLD)
        self._ground, self._folder, self._begun_ns = ground, wanted.folder, wanted.begun_ns
        self._waiting.visible = False
        self._shown = self._open(wanted.folder, kept)

    def turn(self) -> None:
        """Update the list of flights if it is due, and show the current moment."""
        now_s = time.monotonic()
        if now_s >= self._due_s:
            self.listed(self._episodes.look())
            self._due_s = now_s + LISTED_S
        if self._shown is not None:
            self._shown.turn()

    def _open(self, folder: Path, kept: WantedView | None) -> LiveFlight:
        """Open a flight. Building its world may take seconds."""
        world = load_world(folder)
        drones = len(world.record.starts) if world is not None else 1
        follower = FlightFollower(folder, world, drones)
        return LiveFlight(self._server, follower.turn, world, drones, load_camera(folder), follower.trails, kept)

    def _wanted(self, episodes: list[WatchedEpisode]) -> WatchedEpisode | None:
        chosen = self._choice.value
        if chosen != NEWEST:
            return next((episode for episode in episodes if episode.name == chosen), None)
        return next((episode for episode in episodes if not episode.over), None)

    def _show_list(self, episodes: list[WatchedEpisode]) -> None:
        if len(episodes) < 2:
            return
        names = (NEWEST, *(episode.name for episode in sorted(episodes, key=attrgetter("over"))[:LISTED]))
        if self._choice.options != names:
            kept = self._choice.value
            self._choice.options = names
            self._choice.value = kept if kept in names else NEWEST
        over = sum(episode.over for episode in episodes)
        self._list.content = (
            '<div class="flights" style="font-size:11px;opacity:0.65;padding:0 10px">'
            f"{len(episodes) - over} in the air, {over} finished</div>"
        )
        self._choice.visible = self._list.visible = True


def _ground(folder: Path) -> object:
    """Return a value that identifies a flight's map: (map, seed), or the folder if the map is unknown."""
    record = json_object(folder / layout.WORLD) or json_object(folder / layout.EPISODE) or {}
    return (record["map"], record.get("map_seed")) if "map" in record else folder


PERIOD_S = 0.04  # wall s between updates while a browser is connected
IDLE_S = 0.25  # wall s between updates without a browser
LISTED_S = 0.5  # wall s between updates of the list of flights
NICE = 5  # niceness of this process, so that the flight's processes have priority


class FlightViewer:
    """The child process that serves a page. It only reads, so the flight continues if this process hangs or dies."""

    def __init__(self, config: ViewerConfig) -> None:
        os.nice(NICE)
        label = f"DroneCATS · {config.title}" if config.title else "DroneCATS"
        self._server = LoopbackServer(label, config.port, config.hosts)
        self._config = config
        self._page: LivePage | LiveFlight | None = None  # created in the first turn: this may take seconds
        self._due_s = 0.0

    def ready(self) -> dict[str, Any]:
        return {"url": self._server.url}

    def do(self, command: str, arguments: dict[str, Any]) -> Any:
        """Do nothing: the viewer has no commands."""

    def turn(self) -> None:
        time.sleep(max(0.0, self._due_s - time.monotonic()))
        self._due_s = time.monotonic() + (PERIOD_S if self._server.get_clients() else IDLE_S)
        if self._page is None:
            self._page = self._open()
        self._page.turn()

    def close(self) -> None:
        self._server.stop()

    def _open(self) -> LivePage | LiveFlight:
        wires = self._config.wires
        if wires is None:
            return LivePage(self._server, Path(self._config.root))
        world = World(catalogue.load(wires.episode), conditions=wires.conditions)
        self._server.gui.main_panel.dock_right()
        return LiveFlight(self._server, WireFollower(wires, world).turn, world, wires.drones, piloted=False)
