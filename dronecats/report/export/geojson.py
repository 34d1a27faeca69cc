"""One flight as GeoJSON (RFC 7946): a feature collection of longitude, latitude, altitude, in WGS84.

A line's times are in its property `t_s`, one per position, as s since the episode began.
"""

import json
from pathlib import Path
from typing import Any

from dronecats.report.export.flight import ExportedFlight
from dronecats.report.export.places import paths, points
from foundation.frames import Vec3


def write(flight: ExportedFlight, path: Path) -> int:
    """Write a flight; return how many places it has. Raises UsageError where nobody tells where on earth it was."""
    lines, dots = list(paths(flight)), list(points(flight))
    features = [
        _feature("LineString", [_position(each) for each in line.places] * (2 if len(line.places) == 1 else 1),
                 {"name": line.name, "judge": line.judges, "t_s": line.t_s})
        for line in lines
    ] + [
        _feature("Point", _position(dot.place),
                 {"name": dot.name, "judge": dot.judges, "t_s": dot.t_s, **dot.told})
        for dot in dots
    ]  # fmt: skip
    collection = {"type": "FeatureCollection", "features": features, "about": {**flight.about(), **flight.judged()}}
    path.write_text(json.dumps(collection, indent=1) + "\n", encoding="utf-8")
    return sum(len(line.places) for line in lines) + len(dots)


def _feature(kind: str, coordinates: Any, properties: dict[str, Any]) -> dict[str, Any]:
    return {"type": "Feature", "geometry": {"type": kind, "coordinates": coordinates}, "properties": properties}


def _position(place: Vec3) -> list[float]:
    """Return a place with degrees to a millimetre and metres likewise."""
    return [round(place[0], 8), round(place[1], 8), round(place[2], 3)]
