"""Reads a Rerun recording with Rerun's own reader."""

from collections import defaultdict
from typing import Any

import numpy as np
import pytest
from rerun.chunk import RrdReader
from scipy.spatial.transform import Rotation

from dronecats.report.export import rerun as exported
from foundation.frames import geodetic_to_ned


@pytest.fixture(scope="module", params=["alone", "fleet"])
def recording(request, tmp_path_factory):
    """Return (flight, entity → column → [(s or None, value)], the reader)."""
    flight = request.getfixturevalue(request.param)
    path = tmp_path_factory.mktemp("rerun") / "flight.rrd"
    exported.write(flight, path)
    reader = RrdReader(str(path))
    entities: dict[str, dict[str, list[Any]]] = defaultdict(lambda: defaultdict(list))
    for chunk in reader.stream().to_chunks():
        batch = chunk.to_record_batch()
        times = batch.column("episode").cast("int64").to_pylist() if "episode" in chunk.timeline_names else None
        for name in batch.schema.names[1:]:
            for k, value in enumerate(batch.column(name).to_pylist()):
                entities[chunk.entity_path][name].append((times[k] if times else None, value))
    for columns in entities.values():
        for values in columns.values():
            values.sort(key=lambda entry: -1 if entry[0] is None else entry[0])
    return flight, entities, reader


def nanos(t_s):
    return round(t_s * 1e6) * 1000


def test_every_pose_is_exported_as_east_north_up(recording):
    flight, entities, _ = recording
    assert flight.drone_tracks
    for drone in flight.drone_tracks:
        tracks = ((f"drone_{drone.number}", drone.estimate), (f"judge/drone_{drone.number}", drone.truth))
        for name, track in tracks:
            moved = entities[f"/world/{name}"]["Transform3D:translation"]
            assert [at for at, _ in moved] == [nanos(t) for t in track.t_s]
            places = np.array([value[0] for _, value in moved])
            np.testing.assert_allclose(places[:, [1, 0, 2]] * (1, 1, -1), track.position_ned, atol=1e-4)
            turned = np.array([value[0] for _, value in entities[f"/world/{name}"]["Transform3D:quaternion"]])
            noses = Rotation.from_quat(turned).apply([1.0, 0.0, 0.0])
            true = Rotation.from_quat(track.attitude[:, [1, 2, 3, 0]]).apply([1.0, 0.0, 0.0])
            np.testing.assert_allclose(noses[:, [1, 0, 2]] * (1, 1, -1), true, atol=1e-5)


def test_the_pictures_equal_the_pilots_pictures_in_bytes(recording):
    flight, entities, _ = recording
    for drone in flight.drone_tracks:
        logged = entities[f"/world/drone_{drone.number}/camera/image"]["EncodedImage:blob"]
        mine = [frame for frame in flight.frames if frame.drone == drone.number]
        assert [at for at, _ in logged] == [nanos(frame.t_s) for frame in mine]
        assert [bytes(value[0]) for _, value in logged] == [frame.jpeg.read_bytes() for frame in mine]


def test_the_camera_transform_gives_the_measured_target_position(recording):
    """Transform the target from the world through body and camera into right-down-forward axes."""
    flight, entities, _ = recording
    camera = entities["/world/drone_0/camera"]
    mounted = Rotation.from_quat(camera["Transform3D:quaternion"][0][1][0])
    offset = np.array(camera["Transform3D:translation"][0][1][0])
    body = entities["/world/judge/drone_0"]
    places, turns = (dict(body[f"Transform3D:{part}"]) for part in ("translation", "quaternion"))
    frames = [f for f in flight.logs.frames.values() if not f.drone and f.target_frd]
    assert frames
    for frame in frames:
        at = nanos(frame.t)
        north, east, down = frame.target_ned
        there = Rotation.from_quat(turns[at][0]).inv().apply(np.array([east, north, -down]) - places[at][0])
        forward, right, below = frame.target_frd
        np.testing.assert_allclose(mounted.inv().apply(there - offset), (right, below, forward), atol=0.03)


def test_geographic_points_have_latitude_before_longitude(recording):
    flight, entities, _ = recording
    points = entities["/map/judge/drone_0"]["GeoPoints:positions"]
    latitude, longitude, altitude = flight.origin
    on_earth = [value[0] for _, value in points]
    north_east = [geodetic_to_ned(latitude, longitude, altitude, lat, lon, altitude)[:2] for lat, lon in on_earth]
    np.testing.assert_allclose(north_east, flight.drone_tracks[0].truth.position_ned[:, :2], atol=1e-3)


def test_the_log_has_every_reply_and_the_judges_lines_are_separate(recording):
    flight, entities, _ = recording
    lines = entities["/log"]["TextLog:text"]
    assert len(lines) == 1 + len(flight.steps)
    assert sorted(at for at, _ in lines[1:]) == sorted(nanos(s.decision.t_decided) for s in flight.steps)
    assert len(entities["/judge/log"]["TextLog:text"]) == len(flight.all_declarations)


def test_only_the_judges_entities_have_the_target(recording):
    flight, entities, _ = recording
    places = [value[0] for _, value in entities["/world/judge/target"]["Points3D:positions"]]
    np.testing.assert_allclose(np.array(places)[:, [1, 0, 2]] * (1, 1, -1), flight.target_track.position_ned, atol=1e-4)
    mine = [path for path in entities if "judge" not in path and not path.startswith("/__")]
    assert not any("target" in path for path in mine)


def test_the_file_has_one_recording_and_one_blueprint(recording):
    _, _, reader = recording
    assert len(reader.recordings()) == 1
    assert len(reader.blueprints()) == 1
