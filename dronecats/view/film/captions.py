"""What is said below the pictures: the instruction, what was decided, how fast time goes, and the verdict."""

import numpy as np

from dronecats.flight.picture.flight_picture import describe
from dronecats.judge.measured import qualifies
from dronecats.view.film.flown import FilmedFlight
from dronecats.view.film.words import (
    BACKGROUND,
    GREEN,
    GREY,
    PALE,
    RED,
    WHITE,
    YELLOW,
    Ink,
    Picture,
    fitted,
    width_px,
    write,
)

COLOR_OF = {"success": GREEN, "failure": RED}


def bar(flight: FilmedFlight, t: float, speed: float, over: bool, width: int, height: int, unit: float) -> Picture:
    """Return the bar below the pictures, (height, width, 3) RGB. `over`: the flight is, and its verdict is said."""
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
        text, color = action(flight, flight.drones[0], t)
        write(picture, text, (left, y + round(2 * unit)), middle, color)
    low = height - round(1.55 * small)
    who = f"{flight.episode.id}   flown by {flight.who}"
    write(picture, who, (left, low), small, GREY)
    if any(track.level for track in flight.tracks.values()):
        write(picture, "drawn level: no attitudes were kept", (round(0.55 * width), low), small, GREY)
    if over or decided(flight, t):
        said, color = verdict(flight)
        beside = left + width_px(who, small) < right - width_px(said, middle, True) - middle
        above = height - round(2.1 * middle) if beside else low - round(1.4 * middle)
        write(picture, said, (right, above), middle, color, True, right=True)
    return picture


def action(flight: FilmedFlight, drone: int, t: float) -> tuple[str, Ink]:
    """Return what a drone is about at a time, in a few words, and their colour."""
    asked, flown = flight.looked_at(drone, t), flight.flown_by(drone, t)
    if asked is None:
        return "", PALE
    if asked is not flown and t < asked.t_decided:
        return f"step {asked.step}   the pilot is asked, {t - asked.t_frame:.1f} s", PALE
    episode = flight.episode
    good = qualifies(asked, episode.logs, episode.delta_m, episode.cap_s)
    color = {True: GREEN, False: RED, None: YELLOW}[good]
    rejected = f" · not within {episode.delta_m:g} m and in view" if good is False else ""
    return f"step {asked.step}   {describe(asked)}{rejected}", color


def decided(flight: FilmedFlight, t: float) -> bool:
    """Return whether the declaration that decides has been made by then."""
    deciding = flight.episode.verdict.deciding
    return deciding is not None and t >= deciding.t


def verdict(flight: FilmedFlight) -> tuple[str, Ink]:
    """Return the verdict in a few words, derived from the logs anew, and their colour."""
    found = flight.episode.verdict
    away = f" · {found.ne_m:.2f} m from the target" if found.ne_m is not None else ""
    return f"{str(found.outcome).upper()}{away}", COLOR_OF.get(str(found.outcome), PALE)
