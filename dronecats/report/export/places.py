"""What of a flight belongs on a map: paths and points, as longitude, latitude and altitude."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from dronecats.report.export.conventions import lon_lat_alt
from dronecats.report.export.flight import ExportedDrone, ExportedFlight
from dronecats.report.export.naming import JUDGE, drone_name
from dronecats.report.export.tracks import FlownTrack
from foundation.errors import UsageError
from foundation.frames import Vec3

SPACING_S = 0.2  # s between two points of a path: as often as an autopilot tells where it is


@dataclass(frozen=True, slots=True)
class MapPath:
    """Where something was, over time."""

    name: str  # such as `drone_0`, or `judge/drone_0`
    judges: bool  # whether only the judge knew it
    t_s: tuple[float, ...]  # s since the episode began
    places: tuple[Vec3, ...]  # longitude °, latitude °, altitude m above mean sea level


@dataclass(frozen=True, slots=True)
class MapPoint:
    """Something that happened, or stood, somewhere."""

    name: str
    judges: bool
    t_s: float
    place: Vec3  # longitude °, latitude °, altitude m above mean sea level
    told: dict[str, Any]


def paths(flight: ExportedFlight) -> Iterator[MapPath]:
    """Yield the drones' own paths and the judge's, and that of a target that moves. Raises UsageError."""
    origin = _origin(flight)
    for drone in flight.drones:
        if drone.estimate is not None:
            yield _path(drone_name(drone.number), False, drone.estimate, origin)
        if drone.truth is not None:
            yield _path(f"{JUDGE}/{drone_name(drone.number)}", True, drone.truth, origin)
    if flight.target is not None and moves(flight.target):
        yield _path(f"{JUDGE}/target", True, flight.target, origin)


def points(flight: ExportedFlight) -> Iterator[MapPoint]:
    """Yield the target where it stood at first, each decision at its picture, each declaration. Raises UsageError."""
    origin = _origin(flight)
    if flight.target is not None:
        place = lon_lat_alt(origin, _at(flight.target, 0))
        yield MapPoint(f"{JUDGE}/target", True, float(flight.target.t_s[0]), place, {})
    for step in flight.steps:
        said = step.decision
        track = _known(flight.drones[said.drone])
        if track is None:
            continue
        place = lon_lat_alt(origin, _at(track, track.at(said.t_frame)))
        told = {"step": said.step, "drone": said.drone, "t_decided_s": said.t_decided, **(said.action or {})}
        judges = track is not flight.drones[said.drone].estimate
        yield MapPoint(f"step {said.step}: {said.kind or 'no action'}", judges, said.t_frame, place, told)
    for one in flight.declarations:
        truth = flight.drones[one.drone].truth
        if truth is not None:
            place = lon_lat_alt(origin, _at(truth, truth.at(one.t)))
            told = {"step": one.step, "drone": one.drone, "distance_m": one.distance_m, "visible": one.visible,
                    "qualifies": one.qualifies(flight.episode.delta_m)}  # fmt: skip
            yield MapPoint(f"{JUDGE}/declaration of step {one.step}", True, one.t, place, told)


def moves(track: FlownTrack) -> bool:
    """Return whether a track ever leaves its first place by more than a centimetre."""
    return bool((abs(track.position_ned - track.position_ned[0]) > 0.01).any())


def _known(drone: ExportedDrone) -> FlownTrack | None:
    return drone.estimate if drone.estimate is not None else drone.truth


def _path(name: str, judges: bool, track: FlownTrack, origin: Vec3) -> MapPath:
    kept: list[int] = []
    for index, t_s in enumerate(track.t_s):
        if not kept or index == len(track) - 1 or t_s - track.t_s[kept[-1]] >= SPACING_S - 1e-6:
            kept.append(index)
    places = tuple(lon_lat_alt(origin, _at(track, index)) for index in kept)
    return MapPath(name, judges, tuple(float(track.t_s[index]) for index in kept), places)


def _at(track: FlownTrack, index: int) -> Vec3:
    north, east, down = (float(value) for value in track.position_ned[index])
    return (north, east, down)


def _origin(flight: ExportedFlight) -> Vec3:
    if flight.origin is None:
        raise UsageError(f"{flight.episode.folder} does not tell where on earth it was flown: no map, and no tlog")
    return flight.origin
