"""The world of a flight drawn again, from where nobody looked: behind a drone, above it, or through its own camera."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

from dronecats.report.recorded.flight import RecordedFlight
from dronecats.view.film.chase import ChaseWay, FilmStage, chase, chase_lens, standing
from dronecats.view.film.lettering import Picture
from episodes.world.fleet import DronePose
from foundation.camera import CameraModel, CameraPose
from foundation.errors import UsageError
from foundation.frames import quat_from_euler, rotate
from foundation.threads import Latest

WIDTH_PX, HEIGHT_PX = 640, 360
ABOVE_M = 9.0  # of the drone, from where it is seen from above
NO_WORLD = "the world of this flight is not known here: nothing can be drawn again"


class AgainView(Enum):
    """From where."""

    CHASE = "from behind"
    TOP = "from above"
    ONBOARD = "through its camera"


@dataclass(frozen=True, slots=True)
class ViewWish:
    """A picture that somebody wants."""

    flight: int  # which of those that are laid over one another
    drone: int
    view: AgainView
    t_s: float  # s since the episode began


class FlightViews:
    """Draws one flight from anywhere. For one thread; what a view needs is made when it is first wanted."""

    def __init__(self, flight: RecordedFlight, size: tuple[int, int] = (WIDTH_PX, HEIGHT_PX)) -> None:
        self._flight, self._size = flight, size
        self._stages: dict[bool, FilmStage] = {}  # by whether it is through the drone's own camera
        self._ways: dict[int, ChaseWay] = {}

    def picture(self, drone: int, view: AgainView, t_s: float) -> Picture:
        """Return what is seen from there at a time, (H, W, 3) RGB."""
        return self.stage(view).picture(self.eye(drone, view, t_s), t_s)

    def stage(self, view: AgainView) -> FilmStage:
        """Return what draws a view."""
        own = view is AgainView.ONBOARD
        if own not in self._stages:
            width, height = self._size
            camera = self._flight.camera
            lens = CameraModel(width, height, camera.hfov_deg, camera.offset_frd) if own else chase_lens(width, height)
            self._stages[own] = FilmStage(self._flight, lens)
        return self._stages[own]

    def eye(self, drone: int, view: AgainView, t_s: float) -> CameraPose:
        """Return where the camera of a view is."""
        pose = self._flight.tracks[drone].at(t_s)
        if view is AgainView.CHASE:
            return self._way(drone).at(t_s)
        return above(pose) if view is AgainView.TOP else aboard(pose, self._flight.camera)

    def close(self) -> None:
        """Let the renderers go."""
        for stage in self._stages.values():
            stage.close()
        self._stages = {}

    def _way(self, drone: int) -> ChaseWay:
        if drone not in self._ways:
            flight = self._flight
            self._ways[drone] = chase(flight.tracks[drone], flight.end_s, standing(flight))
        return self._ways[drone]


class AgainViews:
    """Draws the newest wish in the background, and hands the picture on; older ones are forgotten."""

    def __init__(self, flights: list[RecordedFlight | None], shown: Callable[[ViewWish, Picture | str], None]) -> None:
        """`flights`: None where the world is not known. `shown` gets the picture, or why there is none."""
        self._flights, self._shown = flights, shown
        self._views: dict[int, FlightViews] = {}
        self._latest = Latest(self._draw, "replay-views")

    def wish(self, wish: ViewWish) -> None:
        """Have a picture drawn."""
        self._latest.put(wish)

    def idle(self, timeout_s: float) -> bool:
        """Wait until the newest wish is drawn; return whether that came to pass within the time."""
        return self._latest.idle(timeout_s)

    def close(self) -> None:
        """End the thread and let the renderers go."""
        self._latest.close()
        for views in self._views.values():
            views.close()

    def _draw(self, wish: ViewWish) -> None:
        flight = self._flights[wish.flight]
        if flight is None:
            self._shown(wish, NO_WORLD)
            return
        try:
            views = self._views.setdefault(wish.flight, FlightViews(flight))
            self._shown(wish, views.picture(wish.drone, wish.view, wish.t_s))
        except (UsageError, ImportError) as error:
            self._shown(wish, str(error))


def above(pose: DronePose) -> CameraPose:
    """Return the place above a drone from where one looks straight down, north up."""
    north, east, down = pose.position_ned
    return CameraPose((north, east, down - ABOVE_M), quat_from_euler(0.0, -math.pi / 2, 0.0))


def aboard(pose: DronePose, camera: CameraModel) -> CameraPose:
    """Return the place of a drone's own camera."""
    place, lever = pose.position_ned, rotate(pose.attitude, camera.offset_frd)
    return CameraPose((place[0] + lever[0], place[1] + lever[1], place[2] + lever[2]), pose.attitude)
