"""Reads MCAP files with MCAP's own reader. Every message agrees with the run folder."""

import dataclasses
import hashlib
import json
from collections import Counter, defaultdict
from typing import Any

import cv2
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from scipy.spatial.transform import Rotation

from dronecats.report.export import layouts, mcap
from foundation.frames import geodetic_to_ned


@pytest.fixture(scope="module", params=["alone", "fleet"])
def recording(request, tmp_path_factory):
    """Return (flight, topic → [(ns, message)], topic → schema, metadata)."""
    flight = request.getfixturevalue(request.param)
    path = tmp_path_factory.mktemp("mcap") / "flight.mcap"
    count = mcap.write(flight, path)
    messages, schemas = defaultdict(list), {}
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for schema, channel, message, decoded in reader.iter_decoded_messages():
            messages[channel.topic].append((message.log_time, decoded))
            schemas[channel.topic] = schema.name
        metadata = {record.name: record.metadata for record in reader.iter_metadata()}
        summary = reader.get_summary()
    assert summary.statistics.message_count == count == sum(map(len, messages.values()))
    return flight, messages, schemas, metadata


def place(vector):
    """Return a vector of the map's frame as NED."""
    return np.array([vector.y, vector.x, -vector.z])


def test_every_pose_has_the_time_position_and_attitude_of_its_track(recording):
    flight, messages, schemas, _ = recording
    for drone in flight.drone_tracks:
        for topic, track in ((f"/drone_{drone.number}", drone.estimate), (f"/judge/drone_{drone.number}", drone.truth)):
            assert schemas[f"{topic}/pose"] == "foxglove.PoseInFrame"
            poses = messages[f"{topic}/pose"]
            assert [at for at, _ in poses] == [round(t * 1e6) * 1000 for t in track.t_s]
            np.testing.assert_allclose([place(p.pose.position) for _, p in poses], track.position_ned, atol=1e-9)
            for (at, pose_message), (w, x, y, z) in zip(poses, track.attitude, strict=True):
                o = pose_message.pose.orientation
                nose = Rotation.from_quat([o.x, o.y, o.z, o.w]).apply([1.0, 0.0, 0.0])
                north, east, down = Rotation.from_quat([x, y, z, w]).apply([1.0, 0.0, 0.0])
                np.testing.assert_allclose(nose, (east, north, -down), atol=1e-9)
                assert pose_message.timestamp.seconds * 10**9 + pose_message.timestamp.nanos == at


def test_the_pictures_equal_the_pilots_pictures_in_bytes_and_times(recording):
    flight, messages, _, _ = recording
    for drone in flight.drone_tracks:
        images = messages[f"/drone_{drone.number}/camera/image"]
        mine = [frame for frame in flight.frames if frame.drone == drone.number]
        assert [(at, hashlib.sha256(i.data).digest(), i.format, i.frame_id) for at, i in images] == [
            (round(f.t_s * 1e9), hashlib.sha256(f.jpeg.read_bytes()).digest(), "jpeg", f"drone_{drone.number}/camera")
            for f in mine
        ]
        assert len(mine) == len(list((flight.folder / "frames").glob("*.jpg"))) / len(flight.drone_tracks)


def test_the_calibration_projects_the_target_to_its_measured_position(recording):
    """Project the target from the map's frame into the image. Compare with `target_frd`."""
    flight, messages, _, _ = recording
    mounted = next(t for _, m in messages["/tf"] for t in m.transforms if t.child_frame_id == "drone_0/camera")
    assert mounted.parent_frame_id == "drone_0"
    calibration = messages["/drone_0/camera/calibration"][0][1]
    K = np.array(calibration.K).reshape(3, 3)
    r, s = mounted.rotation, mounted.translation
    optical = Rotation.from_quat([r.x, r.y, r.z, r.w])
    poses = dict(messages["/judge/drone_0/pose"])
    picture: Any = cv2.imread(str(flight.frames[0].jpeg))
    assert (calibration.height, calibration.width) == picture.shape[:2]
    compared = 0
    for frame in flight.logs.frames.values():
        if frame.drone or frame.target_frd is None:
            continue
        body = poses[round(frame.t * 1e6) * 1000].pose
        turned = Rotation.from_quat([body.orientation.x, body.orientation.y, body.orientation.z, body.orientation.w])
        n, e, d = frame.target_ned
        there = np.array([e, n, -d]) - (body.position.x, body.position.y, body.position.z)
        seen = optical.inv().apply(turned.inv().apply(there) - (s.x, s.y, s.z))
        forward, right, down = frame.target_frd
        np.testing.assert_allclose(seen, (right, down, forward), atol=0.03)
        if forward > 1.0:
            u, v, w = K @ seen
            half = picture.shape[1] / 2.0  # also the focal length, as the field of view is 90°
            assert u / w == pytest.approx(half + half * right / forward, abs=8.0)
            assert v / w == pytest.approx(picture.shape[0] / 2.0 + half * down / forward, abs=8.0)
            compared += 1
    assert compared > 2


def test_a_picture_older_than_the_episode_is_exported(alone, tmp_path, monkeypatch):
    early = [message._replace(t_s=message.t_s - 0.2) for message in mcap.messages(alone)]
    monkeypatch.setattr(mcap, "messages", lambda flight: early)
    assert mcap.write(alone, tmp_path / "early.mcap") == len(early)
    with (tmp_path / "early.mcap").open("rb") as file:
        times = [message.log_time for _, _, message in make_reader(file).iter_messages()]
    assert len(times) == len(early)
    assert min(times) == 0


def test_the_transforms_follow_a_gimbals_pitch(alone):
    frames = sorted(alone.logs.frames.values(), key=lambda frame: frame.t)
    pitches = {frame.frame_id: -10.0 if k < 2 else -40.0 for k, frame in enumerate(frames)}
    on_gimbal = {
        key: dataclasses.replace(frame, camera_pitch_deg=pitches[frame.frame_id])
        for key, frame in alone.logs.frames.items()
    }
    flight = dataclasses.replace(alone, logs=dataclasses.replace(alone.logs, frames=on_gimbal))
    mounts = []
    for t_s, topic, message in mcap.messages(flight):
        for mount in message.transforms if topic == "/tf" else ():
            if mount.child_frame_id == "drone_0/camera":
                r = mount.rotation
                axis = Rotation.from_quat([r.x, r.y, r.z, r.w]).apply([0.0, 0.0, 1.0])  # forward, left, up
                mounts.append((t_s, round(np.degrees(np.arctan2(axis[2], axis[0])), 6)))
    assert mounts == [(0.0, -10.0), (frames[2].t, -40.0)]


def test_the_ring_marks_the_chosen_point(recording):
    flight, messages, _, _ = recording
    picture: Any = cv2.imread(str(flight.frames[0].jpeg))
    height, width = picture.shape[:2]
    gos = [s for s in flight.steps if s.go and s.decision.drone == 0]
    rings = [(at, c.position) for at, m in messages["/drone_0/camera/chosen"] for c in m.circles]
    assert [at for at, _ in rings] == [round(s.decision.t_frame * 1e6) * 1000 for s in gos]
    expected = [(s.go.x * width / 1000, s.go.y * height / 1000) for s in gos]
    np.testing.assert_allclose([(p.x, p.y) for _, p in rings], expected, atol=1e-9)


def test_locations_convert_back_to_positions(recording):
    flight, messages, schemas, _ = recording
    assert schemas["/drone_0/location"] == "foxglove.LocationFix"
    for drone in flight.drone_tracks:
        fixes = messages[f"/judge/drone_{drone.number}/location"]
        lat, lon, alt = flight.origin
        back = [geodetic_to_ned(lat, lon, alt, f.latitude, f.longitude, f.altitude) for _, f in fixes]
        np.testing.assert_allclose(back, drone.truth.position_ned, atol=1e-3)


def test_the_log_has_every_reply_and_the_judges_lines_are_separate(recording):
    flight, messages, schemas, metadata = recording
    assert schemas["/log"] == "foxglove.Log"
    lines = [(at, m.message) for at, m in messages["/log"]]
    assert len(lines) == 1 + len(flight.steps)
    assert lines[0] == (0, flight.instruction)
    at = Counter(at for at, _ in lines[1:])
    assert at == Counter(round(s.decision.t_decided * 1e6) * 1000 for s in flight.steps)
    assert not any("success" in text for _, text in lines)
    assert len(messages["/judge/log"]) == len(flight.all_declarations) + 1
    assert metadata["dronecats"]["instruction"] == flight.instruction
    assert metadata["dronecats/judge"]["judge/outcome"] == flight.verdict.outcome


def test_only_the_judges_scene_has_the_target(recording):
    flight, messages, _, _ = recording
    mine = [entity for _, m in messages["/scene"] for entity in m.entities]
    judges = [entity for _, m in messages["/judge/scene"] for entity in m.entities]
    assert {entity.id.split("/")[0] for entity in mine} == {f"drone_{d.number}" for d in flight.drone_tracks}
    target = next(entity for entity in judges if entity.id == "judge/target")
    np.testing.assert_allclose(place(target.spheres[0].pose.position), flight.target_track.position_ned[0], atol=1e-9)
    declared = {entity.id for entity in judges if "declaration" in entity.id}
    assert declared == {f"judge/declaration/{declaration.step}" for declaration in flight.all_declarations}


def test_the_layout_uses_existing_topics_and_places_every_panel(recording, tmp_path):
    flight, messages, _, _ = recording
    count = layouts.write(tmp_path / "foxglove-layout.json", len(flight.drone_tracks))
    text = (tmp_path / "foxglove-layout.json").read_text()
    layout = json.loads(text)

    def placed(node):
        return [node] if isinstance(node, str) else placed(node["first"]) + placed(node["second"])

    assert sorted(placed(layout["layout"])) == sorted(layout["configById"])
    assert len(layout["configById"]) == count
    topics = {word for word in json.dumps(layout["configById"]).split('"') if word.startswith("/")}
    assert {topic.split(".pose")[0] for topic in topics} <= set(messages)
    assert layout["configById"]["3D!scene"]["topics"]["/judge/scene"] == {"visible": False}
