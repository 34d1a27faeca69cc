"""What the pilot saw and chose: the frames of the run folder as they are, with the point that was chosen ringed."""

from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np

from dronecats.view.film.flown import FilmedFlight
from dronecats.view.film.words import BACKGROUND, GREY, WHITE, YELLOW, Picture, color_of, plate, write
from foundation.protocol import GO, POINT_SPAN
from foundation.run_folder.rows import Decision, drone_label

NONE_YET, NOT_KEPT, NOT_DRAWN = "no picture yet", "no picture was kept", "flown without drawing pictures"


def pane(flight: FilmedFlight, drone: int, t: float, width: int, height: int, unit: float) -> Picture:
    """Return the newest frame of a drone at a time, (height, width, 3) RGB; `unit` px is what words are measured by.

    The ring is there from when the reply was. Nothing is drawn again: of a frame that the folder lacks this is said.
    """
    small = max(9, round(14 * unit))
    decision = flight.looked_at(drone, t)
    path = flight.frame(decision) if decision is not None else None
    picture = _read(path, width, height) if path is not None and flight.pictured else None
    if picture is None or decision is None:
        picture = np.full((height, width, 3), BACKGROUND, np.uint8)
        said = NOT_DRAWN if not flight.pictured else NONE_YET if decision is None else NOT_KEPT
        write(picture, said, (round(0.06 * width), height // 2 - small), small, GREY)
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
    """Return the point that a decision flies to, (x, y) as shares of width and height; None of other actions."""
    point = (decision.action or {}).get("point")
    if decision.kind != GO or not isinstance(point, list) or len(point) != 2:
        return None
    return float(point[0]) / POINT_SPAN, float(point[1]) / POINT_SPAN


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
    if read is None:  # the file was cut short
        return None
    fitted = cv2.resize(read, (width, height), interpolation=cv2.INTER_AREA)
    return np.ascontiguousarray(fitted[..., ::-1], np.uint8)
