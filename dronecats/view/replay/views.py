"""Redraws a flight from behind a drone, from above the drone, or through the drone's camera."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

from dronecats.report.recorded.flight import RecordedFlight
from dronecats.view.film.chase import ChasePath, FilmStage, chase, chase_lens, obstacles_of
from dronecats.view.film.lettering import Picture
from foundation.camera import CameraModel, CameraPose, camera_pose
from foundation.errors import UsageError
from foundation.frames import quat_from_euler
from foundation.threads import NewestItemWorker

WIDTH_PX, HEIGHT_PX = 640, 360
ABOVE_M = 9.0  # height of the camera above the drone, for the view from above
NO_WORLD = "no view can be drawn, because the world of this flight is unknown"


class RedrawnView(Enum):
    CHASE = "from behind"
    TOP = "from above"
    ONBOARD = "through the camera"


@dataclass(frozen=True, slots=True)
class ViewRequest:
    flight: int  # index of the flight on the page
    drone: int
    view: RedrawnView
    t_s: float  # s since the episode began


class FlightViews:
    """Draws the views of one flight. Not thread-safe. Renderers and paths are created at their first use."""

    def __init__(self, flight: RecordedFlight, size: tuple[int, int] = (WIDTH_PX, HEIGHT_PX)) -> None:
        self._flight, self._size = flight, size
        self._stages: dict[bool, FilmStage] = {}  # key: whether the view is through the drone's camera
        self._paths: dict[int, ChasePath] = {}

    def picture(self, drone: int, view: RedrawnView, t_s: float) -> Picture:
        """Return the picture of a view at a time, (H, W, 3) RGB."""
        return self.stage(view).picture(self.eye(drone, view, t_s), t_s)

    def stage(self, view: RedrawnView) -> FilmStage:
        """Return the renderer for a view, created at its first use."""
        own = view is RedrawnView.ONBOARD
        if own not in self._stages:
            width, height = self._size
            camera = self._flight.camera
            lens = CameraModel(width, height, camera.hfov_deg, camera.offset_frd) if own else chase_lens(width, height)
            self._stages[own] = FilmStage(self._flight, lens)
        return self._stages[own]

    def eye(self, drone: int, view: RedrawnView, t_s: float) -> CameraPose:
        """Return the camera pose of a view."""
        pose = self._flight.tracks[drone].at(t_s)
        if view is RedrawnView.CHASE:
            return self._path(drone).at(t_s)
        if view is RedrawnView.TOP:  # straight down, with north at the top
            north, east, down = pose.position_ned
            return CameraPose((north, east, down - ABOVE_M), quat_from_euler(0.0, -math.pi / 2, 0.0))
        return camera_pose(pose.position_ned, pose.attitude, self._flight.camera_at(drone, t_s))

    def close(self) -> None:
        for stage in self._stages.values():
            stage.close()
        self._stages = {}

    def _path(self, drone: int) -> ChasePath:
        if drone not in self._paths:
            flight = self._flight
            self._paths[drone] = chase(flight.tracks[drone], flight.end_s, obstacles_of(flight))
        return self._paths[drone]


class ViewRenderer(NewestItemWorker[ViewRequest]):
    """Draws requests in the background. A newer request replaces a request that still waits."""

    def __init__(
        self, flights: list[RecordedFlight | None], shown: Callable[[ViewRequest, Picture | str], None]
    ) -> None:
        """`flights`: None for a flight in an unknown world. `shown` gets a picture, or the reason why there is none."""
        self._flights, self._shown = flights, shown
        self._views: dict[int, FlightViews] = {}
        super().__init__(self._draw, "replay-views")

    def close(self) -> None:
        """End the thread, and release the renderers."""
        super().close()
        for views in self._views.values():
            views.close()

    def _draw(self, request: ViewRequest) -> None:
        flight = self._flights[request.flight]
        if flight is None:
            self._shown(request, NO_WORLD)
            return
        try:
            views = self._views.setdefault(request.flight, FlightViews(flight))
            self._shown(request, views.picture(request.drone, request.view, request.t_s))
        except (UsageError, ImportError) as error:
            self._shown(request, str(error))
