"""Writes the paths and points of one flight as KML 2.2 (OGC 07-147r2) and as GeoJSON (RFC 7946), both in WGS84.

Altitudes are m above mean sea level (`absolute`). In KML, every episode begins at 1970-01-01T00:00:00Z, because
`gx:Track` requires dates and the logs have no dates. In GeoJSON, the property `t_s` of a line has the time of each
position, in s since the episode began.
"""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

from dronecats.report.export.conventions import JUDGE, about, judged, lon_lat_alt, microseconds, named_tracks
from dronecats.report.recorded.flight import RecordedFlight
from dronecats.report.recorded.tracks import FlightTrack
from foundation.errors import UsageError
from foundation.frames import Vec3

SPACING_S = 0.2  # s, least time between two points of a path; the period of the autopilot's telemetry
KML, GX = "http://www.opengis.net/kml/2.2", "http://www.google.com/kml/ext/2.2"
COLORS = {
    True: "ff2b9fff",
    False: "ffd08a3c",
}  # whether only the judge has a path or point → its colour, KML's aabbggrr


@dataclass(frozen=True, slots=True)
class MapPath:
    """The path of a drone or a target over time."""

    name: str  # for example `drone_0` or `judge/drone_0`
    judges_only: bool  # whether only the judge has this data
    t_s: tuple[float, ...]  # s since the episode began
    places: tuple[Vec3, ...]  # longitude °, latitude °, altitude m above mean sea level


@dataclass(frozen=True, slots=True)
class MapPoint:
    """An event or object at a place."""

    name: str
    judges_only: bool  # whether only the judge has this data
    t_s: float  # s since the episode began
    place: Vec3  # longitude °, latitude °, altitude m above mean sea level
    properties: dict[str, Any]


def paths(flight: RecordedFlight) -> Iterator[MapPath]:
    """Yield the estimated and true paths of the drones, and the path of a moving target.

    Raises UsageError if the origin is unknown.
    """
    origin = _origin(flight)
    for drone in flight.drone_tracks:
        for name, track in named_tracks(drone):
            yield _path(name, track, origin)
    if flight.target_track is not None and flight.target_track.moves():
        yield _path(f"{JUDGE}/target", flight.target_track, origin)


def points(flight: RecordedFlight) -> Iterator[MapPoint]:
    """Yield a point for the target's first position, and one for the drone's position at each picture and declaration.

    Raises UsageError if the origin is unknown.
    """
    origin = _origin(flight)
    if flight.target_track is not None:
        place = lon_lat_alt(origin, _at(flight.target_track, 0))
        yield MapPoint(f"{JUDGE}/target", True, float(flight.target_track.t_s[0]), place, {})
    for step in flight.steps:
        decision = step.decision
        estimate = flight.drone_tracks[decision.drone].estimate
        track = estimate if estimate is not None else flight.drone_tracks[decision.drone].truth
        if track is None:
            continue
        place = lon_lat_alt(origin, _at(track, track.newest(decision.t_frame)))
        properties = {
            "step": decision.step,
            "drone": decision.drone,
            "t_decided_s": decision.t_decided,
            **(decision.action or {}),
        }
        name = f"step {decision.step}: {decision.kind or 'no action'}"
        yield MapPoint(name, estimate is None, decision.t_frame, place, properties)
    for declaration in flight.all_declarations:
        truth = flight.drone_tracks[declaration.drone].truth
        if truth is not None:
            place = lon_lat_alt(origin, _at(truth, truth.newest(declaration.t)))
            properties = {name: getattr(declaration, name) for name in ("step", "drone", "distance_m", "visible")}
            properties["qualifies"] = declaration.qualifies(flight.delta_m)
            yield MapPoint(f"{JUDGE}/declaration of step {declaration.step}", True, declaration.t, place, properties)


def _path(name: str, track: FlightTrack, origin: Vec3) -> MapPath:
    kept: list[int] = []
    for index, t_s in enumerate(track.t_s):
        if not kept or index == len(track) - 1 or t_s - track.t_s[kept[-1]] >= SPACING_S - 1e-6:
            kept.append(index)
    places = tuple(lon_lat_alt(origin, _at(track, index)) for index in kept)
    return MapPath(name, name.startswith(JUDGE), tuple(float(track.t_s[index]) for index in kept), places)


def _at(track: FlightTrack, index: int) -> Vec3:
    north, east, down = (float(value) for value in track.position_ned[index])
    return (north, east, down)


def _origin(flight: RecordedFlight) -> Vec3:
    if flight.origin is None:
        raise UsageError(f"{flight.folder} has no place on Earth: it has no map and no flight.tlog")
    return flight.origin


def write_kml(flight: RecordedFlight, path: Path) -> int:
    """Write a flight as KML; return its number of positions. Raises UsageError if the origin is unknown."""
    ET.register_namespace("", KML)
    ET.register_namespace("gx", GX)
    root = ET.Element(f"{{{KML}}}kml")
    document = _under(root, "Document")
    _under(document, "name", f"{flight.id}")
    _under(document, "description", flight.instruction)
    for judges_only, color in COLORS.items():
        style = _under(document, "Style", id=_style(judges_only))
        line = _under(style, "LineStyle")
        _under(line, "color", color)
        _under(line, "width", "3")
    _data(document, {**about(flight), **judged(flight)})
    folders = {judges_only: _under(document, "Folder") for judges_only in (False, True)}
    for judges_only, folder in folders.items():
        _under(folder, "name", "judge" if judges_only else "flight")
    count = 0
    for drawn_path in paths(flight):
        _add_path(folders[drawn_path.judges_only], drawn_path)
        count += len(drawn_path.places)
    for point in points(flight):
        _add_point(folders[point.judges_only], point)
        count += 1
    ET.indent(root)
    ET.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)
    return count


def _add_path(folder: ET.Element, path: MapPath) -> None:
    placemark = _placemark(folder, path.name, path.judges_only)
    track = ET.SubElement(placemark, f"{{{GX}}}Track")
    _under(track, "altitudeMode", "absolute")
    for t_s in path.t_s:
        _under(track, "when", _when(t_s))
    for place in path.places:
        ET.SubElement(track, f"{{{GX}}}coord").text = " ".join(_numbers(place))


def _add_point(folder: ET.Element, point: MapPoint) -> None:
    placemark = _placemark(folder, point.name, point.judges_only, point.t_s)
    _data(placemark, {key: str(value) for key, value in point.properties.items()})
    geometry = _under(placemark, "Point")
    _under(geometry, "altitudeMode", "absolute")
    _under(geometry, "coordinates", ",".join(_numbers(point.place)))


def _placemark(folder: ET.Element, name: str, judges_only: bool, t_s: float | None = None) -> ET.Element:
    """Return a new placemark with its elements in the order of the KML schema."""
    placemark = _under(folder, "Placemark")
    _under(placemark, "name", name)
    if t_s is not None:
        _under(_under(placemark, "TimeStamp"), "when", _when(t_s))
    _under(placemark, "styleUrl", f"#{_style(judges_only)}")
    return placemark


def _style(judges_only: bool) -> str:
    return "judge" if judges_only else "flight"


def _data(parent: ET.Element, fields: dict[str, str]) -> None:
    extended = _under(parent, "ExtendedData")
    for key, value in fields.items():
        _under(_under(extended, "Data", name=key), "value", value)


def _numbers(place: tuple[float, float, float]) -> Iterator[str]:
    """Yield longitude and latitude (°) and altitude (m) with a resolution of about a millimetre."""
    yield from (f"{place[0]:.8f}", f"{place[1]:.8f}", f"{place[2]:.3f}")


def _when(t_s: float) -> str:
    at = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(microseconds=microseconds(t_s))
    return at.isoformat(timespec="microseconds").replace("+00:00", "Z")


def _under(parent: ET.Element, tag: str, text: str | None = None, **attributes: str) -> ET.Element:
    element = ET.SubElement(parent, f"{{{KML}}}{tag}", attributes)
    element.text = None if text is None else _printable(text)
    return element


def _printable(text: str) -> str:
    """Return a text with � instead of characters that XML forbids."""
    return "".join(c if c in "\t\n\r" or (c >= " " and not "\ud800" <= c <= "\udfff" and c < "\ufffe") else "�"
                   for c in text)  # fmt: skip


def write_geojson(flight: RecordedFlight, path: Path) -> int:
    """Write a flight as GeoJSON; return its number of positions. Raises UsageError if the origin is unknown."""
    lines, dots = list(paths(flight)), list(points(flight))
    features = [
        _feature("LineString", [_position(place) for place in line.places] * (2 if len(line.places) == 1 else 1),
                 {"name": line.name, "judge": line.judges_only, "t_s": line.t_s})
        for line in lines
    ] + [
        _feature("Point", _position(dot.place),
                 {"name": dot.name, "judge": dot.judges_only, "t_s": dot.t_s, **dot.properties})
        for dot in dots
    ]  # fmt: skip
    collection = {"type": "FeatureCollection", "features": features, "about": {**about(flight), **judged(flight)}}
    path.write_text(json.dumps(collection, indent=1) + "\n", encoding="utf-8")
    return sum(len(line.places) for line in lines) + len(dots)


def _feature(kind: str, coordinates: Any, properties: dict[str, Any]) -> dict[str, Any]:
    return {"type": "Feature", "geometry": {"type": kind, "coordinates": coordinates}, "properties": properties}


def _position(place: Vec3) -> list[float]:
    """Return longitude and latitude (°) and altitude (m), rounded to about a millimetre."""
    return [round(place[0], 8), round(place[1], 8), round(place[2], 3)]
