"""One flight as KML 2.2 (OGC 07-147r2), for Google Earth, QGIS and the like: places as longitude, latitude, altitude.

Altitudes are m above mean sea level (`absolute`). Times: `gx:Track` wants a calendar, and the episode's clock has none,
so that an episode begins at 1970-01-01T00:00:00Z.
"""

from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from xml.etree import ElementTree as ET

from dronecats.report.export.conventions import microseconds
from dronecats.report.export.flight import ExportedFlight
from dronecats.report.export.places import MapPath, MapPoint, paths, points

KML, GX = "http://www.opengis.net/kml/2.2", "http://www.google.com/kml/ext/2.2"
COLORS = {True: "ff2b9fff", False: "ffd08a3c"}  # aabbggrr, by whether it is the judge's


def write(flight: ExportedFlight, path: Path) -> int:
    """Write a flight; return how many places it has. Raises UsageError where nobody tells where on earth it was."""
    ET.register_namespace("", KML)
    ET.register_namespace("gx", GX)
    root = ET.Element(f"{{{KML}}}kml")
    document = _under(root, "Document")
    _under(document, "name", f"{flight.id}")
    _under(document, "description", flight.instruction)
    for judges, color in COLORS.items():
        style = _under(document, "Style", id=_style(judges))
        line = _under(style, "LineStyle")
        _under(line, "color", color)
        _under(line, "width", "3")
    _data(document, {**flight.about(), **flight.judged()})
    folders = {judges: _under(document, "Folder") for judges in (False, True)}
    for judges, folder in folders.items():
        _under(folder, "name", "judge" if judges else "flight")
    count = 0
    for one in paths(flight):
        _path(folders[one.judges], one)
        count += len(one.places)
    for point in points(flight):
        _point(folders[point.judges], point)
        count += 1
    ET.indent(root)
    ET.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)
    return count


def _path(folder: ET.Element, path: MapPath) -> None:
    placemark = _placemark(folder, path.name, path.judges)
    track = ET.SubElement(placemark, f"{{{GX}}}Track")
    _under(track, "altitudeMode", "absolute")
    for t_s in path.t_s:
        _under(track, "when", _when(t_s))
    for place in path.places:
        ET.SubElement(track, f"{{{GX}}}coord").text = " ".join(_numbers(place))


def _point(folder: ET.Element, point: MapPoint) -> None:
    placemark = _placemark(folder, point.name, point.judges, point.t_s)
    _data(placemark, {key: str(value) for key, value in point.told.items()})
    geometry = _under(placemark, "Point")
    _under(geometry, "altitudeMode", "absolute")
    _under(geometry, "coordinates", ",".join(_numbers(point.place)))


def _placemark(folder: ET.Element, name: str, judges: bool, t_s: float | None = None) -> ET.Element:
    """Return a new placemark, its parts in the order that the schema asks for."""
    placemark = _under(folder, "Placemark")
    _under(placemark, "name", name)
    if t_s is not None:
        _under(_under(placemark, "TimeStamp"), "when", _when(t_s))
    _under(placemark, "styleUrl", f"#{_style(judges)}")
    return placemark


def _style(judges: bool) -> str:
    return "judge" if judges else "flight"


def _data(parent: ET.Element, told: dict[str, str]) -> None:
    extended = _under(parent, "ExtendedData")
    for key, value in told.items():
        _under(_under(extended, "Data", name=key), "value", value)


def _numbers(place: tuple[float, float, float]) -> Iterator[str]:
    """Yield degrees to a centimetre's tenth and metres to a millimetre."""
    yield from (f"{place[0]:.8f}", f"{place[1]:.8f}", f"{place[2]:.3f}")


def _when(t_s: float) -> str:
    at = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(microseconds=microseconds(t_s))
    return at.isoformat(timespec="microseconds").replace("+00:00", "Z")


def _under(parent: ET.Element, tag: str, text: str | None = None, **attributes: str) -> ET.Element:
    element = ET.SubElement(parent, f"{{{KML}}}{tag}", attributes)
    element.text = None if text is None else _printable(text)
    return element


def _printable(text: str) -> str:
    """Return a text without what XML cannot hold."""
    return "".join(c if c in "\t\n\r" or (c >= " " and not "\ud800" <= c <= "\udfff" and c < "\ufffe") else "�"
                   for c in text)  # fmt: skip
