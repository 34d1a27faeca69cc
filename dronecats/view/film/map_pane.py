"""The map from above: the way flown so far, where each camera looks, and the target as the judge knows it."""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from dronecats.report.recorded.flight import RecordedFlight
from dronecats.view.film.lettering import MAGENTA, WHITE, Ink, Picture, color_of, plate, width_px, write
from episodes.camera.renderer.renderer import Renderer
from foundation.camera import CameraModel, CameraPose
from foundation.frames import Vec3, quat_from_euler, quat_yaw
from foundation.protocol import RADIUS_M

LENS_DEG = 14.0  # a long lens from high above: roofs stay over their houses
MARGIN_M = 9.0
LEAST_M = 13.0  # half of the ground's smaller side
SAMPLES_S = 0.2  # of the trail
VIEW_M = 9.0  # how far the field of view is drawn
SHIFT = 4  # binary places of the pixels that lines are drawn with
JUDGES = "target, 5 m: the judge's"

Array = NDArray[np.float64]


class MapPane:
    """Draws one flight's map at one size."""

    def __init__(self, flight: RecordedFlight, width: int, height: int, unit: float) -> None:
        """`unit`: px by which words are measured."""
        self._flight, self._size, self._small = flight, (width, height), max(9, round(14 * unit))
        self._times = np.arange(0.0, flight.end_s + SAMPLES_S, SAMPLES_S)
        self._ways = {drone: track.positions(self._times) for drone, track in flight.tracks.items()}
        places = np.concatenate([*self._ways.values(), *(np.array([p]) for p in self._targets())])[:, :2]
        low, high = places.min(axis=0), places.max(axis=0)
        self._middle = (low + high) / 2
        half_high = max((high[0] - low[0]) / 2 + MARGIN_M, LEAST_M)
        half_wide = max((high[1] - low[1]) / 2 + MARGIN_M, LEAST_M)
        self.per_px = max(2 * half_high / height, 2 * half_wide / width)  # m
        self._ground = self._from_above()
        self._mark_scale(self._ground)

    def at(self, t: float) -> Picture:
        """Return the map at a time of the episode, (height, width, 3) RGB, north up."""
        picture = self._ground.copy()
        for drone, track in self._flight.tracks.items():
            self._field_of_view(picture, track.at(t).position_ned, quat_yaw(track.at(t).attitude), color_of(drone))
        self._target(picture, self._flight.world.target_centre(max(0.0, t)))
        for drone, track in self._flight.tracks.items():
            pose = track.at(t)
            flown = self._ways[drone][self._times < t]
            way = self._px(np.vstack([flown, [pose.position_ned]]))
            for color, thick in (((0, 0, 0), 4), (color_of(drone), 2)):
                cv2.polylines(picture, [way], False, color, self._thick(thick), cv2.LINE_AA, SHIFT)
            self._drone(picture, pose.position_ned, quat_yaw(pose.attitude), color_of(drone))
        return picture

    def px(self, place: Vec3) -> tuple[float, float]:
        """Return where a place is in the picture, (x, y) px."""
        width, height = self._size
        return (width / 2 + (place[1] - float(self._middle[1])) / self.per_px,
                height / 2 - (place[0] - float(self._middle[0])) / self.per_px)  # fmt: skip

    def _px(self, places: Array) -> NDArray[np.int32]:
        width, height = self._size
        x = width / 2 + (places[:, 1] - self._middle[1]) / self.per_px
        y = height / 2 - (places[:, 0] - self._middle[0]) / self.per_px
        return np.asarray(np.rint(np.column_stack([x, y]) * 2**SHIFT), np.int32)[:, None]

    def _targets(self) -> list[Vec3]:
        return [self._flight.world.target_centre(float(t)) for t in self._times[::5]]

    def _from_above(self) -> Picture:
        """Return the ground with all that stands on it and nothing that moves."""
        width, height = self._size
        world = self._flight.world
        camera = CameraModel(2 * width, 2 * height, LENS_DEG, (0.0, 0.0, 0.0))
        north, east = (float(v) for v in self._middle)
        above = 0.5 * width * self.per_px / math.tan(math.radians(LENS_DEG / 2))
        pose = CameraPose(
            (north, east, world.ground_down(north, east) - above), quat_from_euler(0.0, -math.pi / 2, 0.0)
        )
        renderer = Renderer(world.scene, camera, 1)
        try:
            view = renderer.picture(pose, {world.target_id: None} if world.target.movable else {})
        finally:
            renderer.close()
        picture = cv2.resize(view, self._size, interpolation=cv2.INTER_AREA)
        return np.asarray(0.72 * picture, np.uint8)  # darker, so that what is drawn on it stands out

    def _field_of_view(self, picture: Picture, place: Vec3, yaw: float, color: Ink) -> None:
        half = math.radians(self._flight.camera.hfov_deg / 2)
        rim = [yaw + half * share for share in np.linspace(-1.0, 1.0, 13)]
        corners = [place, *((place[0] + VIEW_M * math.cos(a), place[1] + VIEW_M * math.sin(a), 0.0) for a in rim)]
        shape = self._px(np.array(corners))
        over = picture.copy()
        cv2.fillPoly(over, [shape], color, cv2.LINE_AA, SHIFT)
        cv2.addWeighted(over, 0.32, picture, 0.68, 0.0, picture)

    def _target(self, picture: Picture, centre: Vec3) -> None:
        """Mark the target and the ring within which a declaration counts: what the judge knows and no pilot sees."""
        around = np.linspace(0.0, 2 * math.pi, 73)
        ring = np.column_stack(
            [centre[0] + RADIUS_M * np.cos(around), centre[1] + RADIUS_M * np.sin(around), 0 * around]
        )
        dashes = self._px(ring)
        for k in range(0, 72, 4):
            cv2.polylines(picture, [dashes[k : k + 3]], False, MAGENTA, self._thick(2), cv2.LINE_AA, SHIFT)
        x, y = self.px(centre)
        r = 0.42 * self._small
        diamond = np.array([(x, y - r), (x + r, y), (x, y + r), (x - r, y)])
        cv2.fillPoly(picture, [np.rint(diamond * 2**SHIFT).astype(np.int32)], MAGENTA, cv2.LINE_AA, SHIFT)

    def _drone(self, picture: Picture, place: Vec3, yaw: float, color: Ink) -> None:
        x, y = self.px(place)
        r = 0.62 * self._small
        arrow = [(r, 0.0), (-0.75 * r, 0.7 * r), (-0.35 * r, 0.0), (-0.75 * r, -0.7 * r)]  # ahead, right
        s, c = math.sin(yaw), math.cos(yaw)
        corners = np.array([(x + a * s + b * c, y - a * c + b * s) for a, b in arrow])
        shape = np.rint(corners * 2**SHIFT).astype(np.int32)
        cv2.fillPoly(picture, [shape], color, cv2.LINE_AA, SHIFT)
        cv2.polylines(picture, [shape], True, (0, 0, 0), 1, cv2.LINE_AA, SHIFT)

    def _mark_scale(self, picture: Picture) -> None:
        width, height = self._size
        small, high = self._small, round(1.5 * self._small)
        plate(picture, 0, height - high, width, high)
        write(picture, JUDGES, (round(0.4 * small), height - high + round(0.1 * small)), small, MAGENTA)
        metres = next(m for m in (50.0, 20.0, 10.0, 5.0, 2.0) if m <= 0.25 * width * self.per_px or m == 2.0)
        name = f"{metres:g} m"
        right, y = width - round(0.6 * small), height - round(0.4 * small)
        cv2.line(picture, (right - round(metres / self.per_px), y), (right, y), WHITE, max(1, small // 7))
        write(picture, name, (right - width_px(name, small), height - high), small, WHITE)
        write(picture, "N ↑", (width - round(0.6 * small), round(0.3 * small)), small, WHITE, True, right=True)

    def _thick(self, of_720: int) -> int:
        return max(1, round(of_720 * self._small / 14))
