"""The live page: the list of flights, the flight that is shown, and the child process that serves them."""

import math
import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import viser

from dronecats.view.live.config import ViewerConfig
from dronecats.view.live.folder import EpisodeList, WatchedEpisode, flown_world, lens_in, newest_flown
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
LISTED = 200  # flights that can be chosen from
WAITING = '<div style="font-size:13px;padding:4px 10px">waiting for a flight …</div>'


class Follower(Protocol):
    """Whatever tells what a flight has come to."""

    def turn(self) -> Moment:
        """Return the moment of now."""
        ...


@dataclass(frozen=True, slots=True)
class WantedView:
    """What somebody has chosen on the page, and keeps from one flight to the next."""

    judge: bool = False  # the judge's view
    followed: int | None = None  # the drone that the view goes with


class LiveFlight:
    """One flight on the page."""

    def __init__(
        self,
        server: viser.ViserServer,
        follower: Follower,
        world: World | None,
        drones: int,
        camera: CameraModel | None = None,
        trails: Mapping[int, Sequence[Vec3]] | None = None,
        wanted: WantedView | None = None,
        piloted: bool = True,
    ) -> None:
        """`trails`: where each drone has been before somebody looked, m NED, once the follower has taken a turn.

        `wanted`: what was chosen on the page before; `piloted`: whether there is anybody who is shown pictures.
        """
        self._follower, self._trails = follower, trails
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
        """Show the moment that the flight has come to."""
        moment = self._follower.turn()
        for drone, places in (self._trails or {}).items():
            self._scene.show_trail(drone, places)
        self._trails = None
        self._scene.show(moment)
        self._bring(moment)
        self._panels.show(moment)

    def remove(self) -> None:
        """Take it off the page."""
        self._panels.remove()
        self._scene.remove()

    def _bring(self, moment: Moment) -> None:
        """Have browsers that come to the flight look at the first drone, or at where it is to start."""
        for drone in moment.drones:
            if drone.position_ned is not None:
                self._scene.bring(drone.position_ned, quat_yaw(drone.attitude))
                return
        if self._start is not None:
            self._scene.bring(self._start.position_ned, math.radians(self._start.yaw_deg))

    def _judge(self, shown: bool) -> None:
        self.wanted = replace(self.wanted, judge=shown)
        self._scene.judge_shown = shown

    def _follow(self, drone: int | None) -> None:
        self.wanted = replace(self.wanted, followed=drone)
        self._scene.follow(drone)


class LivePage:
    """Shows one of several flights: the newest, until somebody chooses another."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._server = server
        self._shown: LiveFlight | None = None
        self._folder: Path | None = None  # of the flight that is shown
        self._world: object = None  # of what map the ground is
        self._told: object = None
        server.gui.main_panel.dock_right()
        self._waiting = server.gui.add_html(WAITING)
        self._choice: Any = server.gui.add_dropdown("Flight", (NEWEST,), initial_value=NEWEST, visible=False)
        self._list = server.gui.add_html("", visible=False)

    def listed(self, episodes: list[WatchedEpisode]) -> None:
        """Take the flights that there are, the newest first, and show the one that is chosen."""
        self._tell(episodes)
        wanted = self._wanted(episodes)
        if wanted is None or wanted.folder == self._folder:
            return
        kept = None
        if self._shown is not None:
            kept = self._shown.wanted
            self._shown.remove()
        ground = _ground(wanted.folder)
        if ground != self._world and self._server.scene.get_handle_by_name(WORLD) is not None:
            self._server.scene.remove_by_name(WORLD)
        self._world, self._folder = ground, wanted.folder
        self._waiting.visible = False
        self._shown = self._taken_up(wanted.folder, kept)

    def turn(self) -> None:
        """Bring the page up to now."""
        if self._shown is not None:
            self._shown.turn()

    def _taken_up(self, folder: Path, kept: WantedView | None) -> LiveFlight:
        """Return a flight where it is now. Building its world may take some seconds."""
        world = flown_world(folder)
        drones = len(world.record.starts) if world is not None else 1
        follower = FlightFollower(folder, world, drones)
        return LiveFlight(self._server, follower, world, drones, lens_in(folder), follower.trails, kept)

    def _wanted(self, episodes: list[WatchedEpisode]) -> WatchedEpisode | None:
        chosen = self._choice.value
        if chosen != NEWEST:
            return next((one for one in episodes if one.name == chosen), None)
        return newest_flown(episodes)

    def _tell(self, episodes: list[WatchedEpisode]) -> None:
        told = tuple((one.name, one.over) for one in episodes)
        if told == self._told or len(episodes) < 2:
            return
        self._told = told
        names = (NEWEST, *(one.name for one in sorted(episodes, key=lambda one: one.over)[:LISTED]))
        if self._choice.options != names:
            kept = self._choice.value
            self._choice.options = names
            self._choice.value = kept if kept in names else NEWEST
        over = sum(one.over for one in episodes)
        self._list.content = (
            '<div class="flights" style="font-size:11px;opacity:0.65;padding:0 10px">'
            f"{len(episodes) - over} in the air, {over} over</div>"
        )
        self._choice.visible = self._list.visible = True


def _ground(folder: Path) -> object:
    """Return what tells one map from another; a folder's own where none is told."""
    record = json_object(folder / layout.WORLD) or json_object(folder / layout.EPISODE) or {}
    return (record["map"], record.get("map_seed")) if "map" in record else folder


PERIOD_S = 0.04  # wall seconds from one update to the next while somebody looks …
IDLE_S = 0.25  # … and while nobody does
LISTED_S = 0.5  # from one look for flights to the next
NICE = 5  # whatever flies comes first


class FolderPage:
    """The flights of a folder."""

    def __init__(self, server: LoopbackServer, root: Path) -> None:
        self._episodes, self._page = EpisodeList(root), LivePage(server)
        self._due_s = 0.0

    def turn(self) -> None:
        """Bring the page up to now."""
        now_s = time.monotonic()
        if now_s >= self._due_s:
            self._page.listed(self._episodes.look())
            self._due_s = now_s + LISTED_S
        self._page.turn()


class FlightViewer:
    """Serves the page and brings it up to what has come, again and again."""

    def __init__(self, config: ViewerConfig) -> None:
        os.nice(NICE)
        label = f"DroneCATS · {config.title}" if config.title else "DroneCATS"
        self._server = LoopbackServer(label, config.port, config.hosts)
        self._config = config
        self._page: FolderPage | LiveFlight | None = None  # made in the first turn: a world may take seconds
        self._due_s = 0.0

    def ready(self) -> dict[str, Any]:
        return {"url": self._server.url}

    def do(self, command: str, arguments: dict[str, Any]) -> Any:
        """Nothing is asked of it."""

    def turn(self) -> None:
        time.sleep(max(0.0, self._due_s - time.monotonic()))
        self._due_s = time.monotonic() + (PERIOD_S if self._server.get_clients() else IDLE_S)
        if self._page is None:
            self._page = self._made()
        self._page.turn()

    def close(self) -> None:
        self._server.stop()

    def _made(self) -> FolderPage | LiveFlight:
        wires = self._config.wires
        if wires is None:
            return FolderPage(self._server, Path(self._config.root))
        world = World(catalogue.load(wires.episode))
        self._server.gui.main_panel.dock_right()
        return LiveFlight(self._server, WireFollower(wires, world), world, wires.drones, piloted=False)


def create(config: ViewerConfig) -> FlightViewer:
    """Return the page of a folder, or of a simulator's wires."""
    return FlightViewer(config)
