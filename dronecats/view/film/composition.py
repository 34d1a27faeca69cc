"""Composes a film's pictures: chase views on the left, the pilots' frames and the map on the right, a caption below."""

import math
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from dronecats.judge.verdict import qualifies
from dronecats.report.recorded.flight import RecordedFlight
from dronecats.view.film.chase import FilmStage, chase, chase_lens, obstacles_of
from dronecats.view.film.lettering import (
    BACKGROUND,
    GREEN,
    GREY,
    MAGENTA,
    PALE,
    RED,
    WHITE,
    YELLOW,
    Ink,
    Picture,
    color_of,
    fitted,
    plate,
    width_px,
    write,
)
from episodes.camera.renderer.renderer import Renderer
from foundation.camera import CameraModel, CameraPose
from foundation.frames import Vec3, quat_from_euler, quat_yaw
from foundation.protocol import POINT_SPAN, RADIUS_M
from foundation.run_folder.rows import Decision, drone_label

REFERENCE_PX = 720  # height at which text has its nominal size
GAP = 4  # px between the panes, at REFERENCE_PX
COLOR_OF = {"success": GREEN, "failure": RED}
NONE_YET, NOT_KEPT, NOT_DRAWN = "no picture yet", "no picture was recorded", "flown without rendering"


@dataclass(frozen=True, slots=True)
class Pane:
    """A rectangle of the picture, px."""

    left: int
    top: int
    width: int
    height: int


@dataclass(frozen=True, slots=True)
class Panes:
    chase: tuple[Pane, ...]  # one per drone
    onboard: tuple[Pane, ...]  # one per drone
    map: Pane
    bar: Pane  # for the caption
    unit: float  # scale of text and gaps: height / REFERENCE_PX


def panes(width: int, height: int, drones: int) -> Panes:
    """Return the layout of a picture of this size (px) with this number of drones."""
    unit = height / REFERENCE_PX
    gap = max(1, round(GAP * unit))
    column, low = round(0.3125 * width), round(0.165 * height)
    high = height - low - gap
    seen = round(column * 9 / 16)
    chase_area = Pane(0, 0, width - column - gap, high)
    seen_area = Pane(width - column, 0, column, seen)
    return Panes(
        chase=_grid(chase_area, drones, gap),
        onboard=_grid(seen_area, drones, gap),
        map=Pane(width - column, seen + gap, column, high - seen - gap),
        bar=Pane(0, height - low, width, low),
        unit=unit,
    )


def _grid(area: Pane, count: int, gap: int) -> tuple[Pane, ...]:
    """Return `count` panes that divide an area into a grid, with about as many rows as columns."""
    columns = math.ceil(math.sqrt(count))
    rows = math.ceil(count / columns)
    width, height = (area.width - gap * (columns - 1)) // columns, (area.height - gap * (rows - 1)) // rows
    return tuple(
        Pane(area.left + (k % columns) * (width + gap), area.top + (k // columns) * (height + gap), width, height)
        for k in range(count)
    )


class Composition:
    """Draws the pictures of a film of one flight."""

    def __init__(self, flight: RecordedFlight, width: int, height: int, drone: int | None = None) -> None:
        """`drone`: the only drone to follow; None: all drones, each in its own pane."""
        self._flight, self._size = flight, (width, height)
        self._followed = flight.drones if drone is None else (drone,)
        self.panes = panes(width, height, len(self._followed))
        first = self.panes.chase[0]
        self._stage = FilmStage(flight, chase_lens(first.width, first.height))
        obstacles = obstacles_of(flight)
        self._paths = {k: chase(flight.tracks[k], flight.end_s, obstacles) for k in self._followed}
        self._map = MapPane(flight, self.panes.map.width, self.panes.map.height, self.panes.unit)
        self._kept: tuple[float, Picture] | None = None  # time and picture of the last call, without the caption bar

    def at(self, t: float, speed: float = 1.0, over: bool = False) -> Picture:
        """Return the picture at a time, (height, width, 3) RGB. `over`: the flight has ended; show its verdict."""
        if self._kept is None or self._kept[0] != t:
            self._kept = t, self._views(t)
        picture = self._kept[1].copy()
        bar, unit = self.panes.bar, self.panes.unit
        _put(picture, bar, caption_bar(self._flight, t, speed, over, bar.width, bar.height, unit))
        return picture

    def _views(self, t: float) -> Picture:
        width, height = self._size
        picture = np.full((height, width, 3), BACKGROUND, np.uint8)
        for drone, view, seen in zip(self._followed, self.panes.chase, self.panes.onboard, strict=True):
            drawn = self._stage.picture(self._paths[drone].at(t), t)
            if len(self._flight.drones) > 1:
                self._name(drawn, drone, t)
            _put(picture, view, drawn)
            _put(picture, seen, pilot_view(self._flight, drone, t, seen.width, seen.height, self.panes.unit))
        _put(picture, self.panes.map, self._map.at(t))
        return picture

    def _name(self, view: Picture, drone: int, t: float) -> None:
        """Write the drone's name and action on its chase view."""
        small = max(9, round(15 * self.panes.unit))
        plate(view, 0, 0, view.shape[1], round(1.6 * small))
        text, color = action_words(self._flight, drone, t)
        left, top = round(0.5 * small), round(0.15 * small)
        left += write(view, drone_label(drone), (left, top), small, color_of(drone), True) + small
        write(view, text, (left, top), small, color)

    def close(self) -> None:
        self._stage.close()


def _put(picture: Picture, pane: Pane, content: Picture) -> None:
    picture[pane.top : pane.top + pane.height, pane.left : pane.left + pane.width] = content


def caption_bar(
    flight: RecordedFlight, t: float, speed: float, over: bool, width: int, height: int, unit: float
) -> Picture:
    """Return the caption bar, (height, width, 3) RGB. `over`: show the verdict."""
    picture = np.full((height, width, 3), BACKGROUND, np.uint8)
    large, middle, small = (max(9, round(px * unit)) for px in (23, 21, 14))
    left, right, y = round(14 * unit), width - round(14 * unit), round(9 * unit)
    clock = f"{t:5.1f} s" + ("" if speed == 1.0 else f"   {speed:g}×")
    write(picture, clock, (right, y), middle, WHITE, True, right=True)
    room = right - left - width_px(f"{'8' * 9}{clock[7:]}", middle, True)
    lines = fitted(f"“{flight.instruction}”", large, room, 2, True) if flight.instruction else []
    for line in lines:
        write(picture, line, (left, y), large, WHITE, True)
        y += round(1.22 * large)
    if len(flight.drones) == 1 and height - y > 1.2 * middle + 1.5 * small:
        text, color = action_words(flight, flight.drones[0], t)
        write(picture, text, (left, y + round(2 * unit)), middle, color)
    low = height - round(1.55 * small)
    title = f"{flight.id}   flown by {flight.run.pilot_title}"
    write(picture, title, (left, low), small, GREY)
    if any(track.level for track in flight.tracks.values()):
        write(picture, "drawn level, because no attitude was recorded", (round(0.55 * width), low), small, GREY)
    if over or is_decided(flight, t):
        words, color = verdict_words(flight)
        beside = left + width_px(title, small) < right - width_px(words, middle, True) - middle
        above = height - round(2.1 * middle) if beside else low - round(1.4 * middle)
        write(picture, words, (right, above), middle, color, True, right=True)
    return picture


def action_words(flight: RecordedFlight, drone: int, t: float) -> tuple[str, Ink]:
    """Return a short text on a drone's action at a time, and its colour."""
    decision, flying = (flight.latest_decision(drone, t, time) for time in ("t_frame", "t_decided"))
    if decision is None:
        return "", PALE
    if decision is not flying and t < decision.t_decided:
        return f"step {decision.step}   waiting for the pilot, {t - decision.t_frame:.1f} s", PALE
    good = qualifies(decision, flight.logs, flight.delta_m, flight.cap_s)
    color = {True: GREEN, False: RED, None: YELLOW}[good]
    rejected = f" · not within {flight.delta_m:g} m and in view" if good is False else ""
    return f"step {decision.step}   {decision.action_or_reason()}{rejected}", color


def is_decided(flight: RecordedFlight, t: float) -> bool:
    """Return whether the declaration that decides the verdict was made at or before a time."""
    deciding = flight.verdict.deciding
    return deciding is not None and t >= deciding.t


def verdict_words(flight: RecordedFlight) -> tuple[str, Ink]:
    """Return a short text on the verdict and its colour. The verdict is computed from the logs."""
    verdict = flight.verdict
    away = f" · {verdict.ne_m:.2f} m from the target" if verdict.ne_m is not None else ""
    return f"{str(verdict.outcome).upper()}{away}", COLOR_OF.get(str(verdict.outcome), PALE)


def pilot_view(flight: RecordedFlight, drone: int, t: float, width: int, height: int, unit: float) -> Picture:
    """Return the newest recorded frame of a drone at a time, (height, width, 3) RGB; `unit`: the scale of text.

    After the reply, a ring marks the point that the pilot chose. If the frame is not taken yet, not recorded, or not
    rendered, a note replaces it.
    """
    small = max(9, round(14 * unit))
    decision = flight.latest_decision(drone, t, "t_frame")
    path = flight.picture_path(decision) if decision is not None else None
    picture = _read(path, width, height) if path is not None and flight.run.is_rendered else None
    if picture is None or decision is None:
        picture = np.full((height, width, 3), BACKGROUND, np.uint8)
        note = NOT_DRAWN if not flight.run.is_rendered else NONE_YET if decision is None else NOT_KEPT
        write(picture, note, (round(0.06 * width), height // 2 - small), small, GREY)
    else:
        picture = picture.copy()
    if decision is not None and (point := chosen(decision)) is not None and t >= decision.t_decided:
        ring(picture, point)
    fleet = len(flight.drones) > 1
    taken = f" at {decision.t_frame:.1f} s" if decision is not None else ""
    label = f"{drone_label(drone)}{taken}" if fleet else f"what the pilot saw{taken}"
    high = round(1.5 * small)
    plate(picture, 0, height - high, width, high)
    write(
        picture,
        label,
        (round(0.4 * small), height - high + round(0.1 * small)),
        small,
        color_of(drone) if fleet else WHITE,
    )
    return picture


def chosen(decision: Decision) -> tuple[float, float] | None:
    """Return the point of a `go` action, (x, y) as shares of the frame's width and height; None for other actions."""
    return None if decision.go is None else (decision.go.x / POINT_SPAN, decision.go.y / POINT_SPAN)


def ring(picture: Picture, point: tuple[float, float]) -> None:
    """Draw a ring around a point, given as shares of width and height."""
    height, width = picture.shape[:2]
    middle = (round(16 * (point[0] * width - 0.5)), round(16 * (point[1] * height - 0.5)))
    radius = max(5.0, 0.05 * width)
    thick = max(1, round(0.007 * width))
    for color, more in (((0, 0, 0), thick + 1), (YELLOW, 0)):
        cv2.circle(picture, middle, round(16 * radius), color, thick + more, cv2.LINE_AA, 4)


@lru_cache(8)
def _read(path: Path, width: int, height: int) -> Picture | None:
    read = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if read is None:  # the file is incomplete
        return None
    fitted = cv2.resize(read, (width, height), interpolation=cv2.INTER_AREA)
    return np.ascontiguousarray(fitted[..., ::-1], np.uint8)


LENS_DEG = 14.0  # narrow field of view from high above, so that roofs are not displaced from their houses
MARGIN_M = 9.0  # m, least distance between a trail or target and the edge of the map
LEAST_M = 13.0  # m, least half width and half height of the map
SAMPLES_S = 0.2  # s between two points of a trail
VIEW_M = 9.0  # m, length of the drawn field of view
SHIFT = 4  # fractional bits of pixel coordinates in OpenCV's drawing functions
JUDGE_NOTE = f"target with {RADIUS_M:g} m radius (judge)"

Array = NDArray[np.float64]


class MapPane:
    """Draws the map of a flight from above, with trails, fields of view and the target. Pilots do not see this map."""

    def __init__(self, flight: RecordedFlight, width: int, height: int, unit: float) -> None:
        """`unit`: the scale of text."""
        self._flight, self._size, self._small = flight, (width, height), max(9, round(14 * unit))
        self._times = np.arange(0.0, flight.end_s + SAMPLES_S, SAMPLES_S)
        self._trails = {drone: track.positions(self._times) for drone, track in flight.tracks.items()}
        targets = [flight.world.target_centre(float(t)) for t in self._times[::5]]
        places = np.concatenate([*self._trails.values(), np.array(targets)])[:, :2]
        low, high = places.min(axis=0), places.max(axis=0)
        self._middle = (low + high) / 2
        half_high = max((high[0] - low[0]) / 2 + MARGIN_M, LEAST_M)
        half_wide = max((high[1] - low[1]) / 2 + MARGIN_M, LEAST_M)
        self.per_px = max(2 * half_high / height, 2 * half_wide / width)  # m per pixel
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
            places = np.vstack([self._trails[drone][self._times < t], [pose.position_ned]])
            for color, thick in (((0, 0, 0), 4), (color_of(drone), 2)):
                cv2.polylines(picture, [self._px(places)], False, color, self._thick(thick), cv2.LINE_AA, SHIFT)
            self._drone(picture, pose.position_ned, quat_yaw(pose.attitude), color_of(drone))
        return picture

    def px(self, place: Vec3) -> tuple[float, float]:
        """Return the pixel (x, y) of a position (m, NED)."""
        width, height = self._size
        return (width / 2 + (place[1] - float(self._middle[1])) / self.per_px,
                height / 2 - (place[0] - float(self._middle[0])) / self.per_px)  # fmt: skip

    def _px(self, places: Array) -> NDArray[np.int32]:
        width, height = self._size
        x = width / 2 + (places[:, 1] - self._middle[1]) / self.per_px
        y = height / 2 - (places[:, 0] - self._middle[0]) / self.per_px
        return np.asarray(np.rint(np.column_stack([x, y]) * 2**SHIFT), np.int32)[:, None]

    def _from_above(self) -> Picture:
        """Return a picture of all static objects from above."""
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
        return np.asarray(0.72 * picture, np.uint8)  # darker, for contrast with the marks

    def _field_of_view(self, picture: Picture, place: Vec3, yaw: float, color: Ink) -> None:
        half = math.radians(self._flight.camera.hfov_deg / 2)
        rim = [yaw + half * share for share in np.linspace(-1.0, 1.0, 13)]
        corners = [place, *((place[0] + VIEW_M * math.cos(a), place[1] + VIEW_M * math.sin(a), 0.0) for a in rim)]
        shape = self._px(np.array(corners))
        over = picture.copy()
        cv2.fillPoly(over, [shape], color, cv2.LINE_AA, SHIFT)
        cv2.addWeighted(over, 0.32, picture, 0.68, 0.0, picture)

    def _target(self, picture: Picture, centre: Vec3) -> None:
        """Mark the target and the success radius around it. The pilot's pictures do not show these marks."""
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
        write(picture, JUDGE_NOTE, (round(0.4 * small), height - high + round(0.1 * small)), small, MAGENTA)
        metres = next(m for m in (50.0, 20.0, 10.0, 5.0, 2.0) if m <= 0.25 * width * self.per_px or m == 2.0)
        right, y = width - round(0.6 * small), height - round(0.4 * small)
        cv2.line(picture, (right - round(metres / self.per_px), y), (right, y), WHITE, max(1, small // 7))
        write(picture, f"{metres:g} m", (right, height - high), small, WHITE, right=True)
        write(picture, "N ↑", (width - round(0.6 * small), round(0.3 * small)), small, WHITE, True, right=True)

    def _thick(self, of_720: int) -> int:
        return max(1, round(of_720 * self._small / 14))
