"""Reads KML and GeoJSON with GDAL. The positions agree with those that the simulator sent on the truth bus."""

import json
from typing import Any

import numpy as np
import pyogrio
import pytest

from dronecats.report.export.maps import paths, points, write_geojson, write_kml
from foundation.mavlink import dialect
from tests.support.logged_messages import logged_messages

METRES = np.array([0.6889 * 111195.0, 111195.0, 1.0])  # length of a degree of longitude and of latitude at 46.46°


def sent(flight, drone):
    """Return (t s, longitude °, latitude °, altitude m) from the truth bus during the episode."""
    kind = dialect.MAVLINK_MSG_ID_HIL_STATE_QUATERNION
    rows = [
        ((m.time_usec - flight.t0_us) / 1e6, m.lon / 1e7, m.lat / 1e7, m.alt / 1e3)
        for m in logged_messages(flight.folder / "flight.tlog", {kind})
        if m.get_srcSystem() == drone + 1
    ]
    return {round(row[0], 6): row[1:] for row in rows if 0.0 <= row[0] <= flight.end_s}


def wkb(geometry):
    """Return the coordinates (n, 3) of a WKB point or line with Z."""
    kind = int.from_bytes(geometry[1:5], "little")
    at = 5 if kind % 1000 == 1 or kind & 0xFF == 1 else 9
    return np.frombuffer(geometry[at:], "<f8").reshape(-1, 3)


def read(path, layer=None):
    """Return name → coordinates of every feature that GDAL reads."""
    meta, _, geometries, columns = pyogrio.raw.read(path, layer=layer, force_2d=False)
    names = columns[[str(f).lower() for f in meta["fields"]].index("name")]
    features: dict[str, list[Any]] = {}
    for name, geometry in zip(names, geometries, strict=True):
        features.setdefault(name, []).append(wkb(geometry))
    return features


@pytest.mark.parametrize("which", ["alone", "fleet"])
@pytest.mark.parametrize("form", ["kml", "geojson"])
def test_gdal_reads_every_path_and_point_at_its_position(which, form, request, tmp_path):
    flight = request.getfixturevalue(which)
    path = tmp_path / f"flight.{form}"
    count = {"kml": write_kml, "geojson": write_geojson}[form](flight, path)
    layers = ["flight", "judge"] if form == "kml" else [None]
    features = {layer: read(path, layer) for layer in layers}
    assert sum(len(place) for layer in features.values() for places in layer.values() for place in places) == count
    judges = features["judge"] if form == "kml" else features[None]
    for drone in flight.drone_tracks:
        [coordinates] = judges[f"judge/drone_{drone.number}"]
        bus = sent(flight, drone.number)
        line = next(path_line for path_line in paths(flight) if path_line.name == f"judge/drone_{drone.number}")
        assert len(coordinates) == len(line.t_s)
        expected = np.array([bus[round(t, 6)] for t in line.t_s])
        np.testing.assert_allclose(
            (coordinates - expected) * METRES, 0.0, atol=0.02
        )  # the resolution of degrees on the bus
    own = features["flight"] if form == "kml" else features[None]
    assert all(not name.startswith("judge") for name in features.get("flight", {}))
    steps = [name for name in own if name.startswith("step ")]
    assert sum(len(own[name]) for name in steps) == len(flight.steps)
    assert len([n for n in judges if n.startswith("judge/declaration")]) == len(flight.all_declarations) > 0


def test_the_target_is_at_its_logged_position(alone, tmp_path):
    write_kml(alone, tmp_path / "flight.kml")
    [[place]] = read(tmp_path / "flight.kml", "judge")["judge/target"]
    drone = sent(alone, 0)[round(float(alone.drone_tracks[0].truth.t_s[0]), 6)]
    north_m, east_m = ((place - drone) * METRES)[[1, 0]]
    start = alone.logs.poses[0]
    assert start.target_ned[0] - start.position_ned[0] == pytest.approx(north_m, abs=0.1)
    assert start.target_ned[1] - start.position_ned[1] == pytest.approx(east_m, abs=0.1)


def test_geojson_has_times_and_marks_paths_of_the_judge(alone, tmp_path):
    write_geojson(alone, tmp_path / "flight.geojson")
    document = json.loads((tmp_path / "flight.geojson").read_text())
    lines = {f["properties"]["name"]: f for f in document["features"] if f["geometry"]["type"] == "LineString"}
    for name, line in lines.items():
        assert line["properties"]["judge"] is name.startswith("judge/")
        assert len(line["properties"]["t_s"]) == len(line["geometry"]["coordinates"])
    assert lines["judge/drone_0"]["properties"]["t_s"][-1] == pytest.approx(alone.end_s, abs=0.03)
    assert document["about"]["judge/success"] == "True"


def test_kml_times_are_dates_from_1970(alone, tmp_path):
    write_kml(alone, tmp_path / "flight.kml")
    text = (tmp_path / "flight.kml").read_text()
    first = next(line for line in paths(alone)).t_s[0]
    assert f"<when>1970-01-01T00:00:{first:09.6f}Z</when>" in text


def test_a_standing_target_has_no_path(alone):
    assert not alone.target_track.moves()
    assert "judge/target" not in [feature.name for feature in paths(alone)]
    assert "judge/target" in [feature.name for feature in points(alone)]
