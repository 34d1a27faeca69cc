"""Four drones from one context: one request with four pictures, one array of four actions, one verdict."""

import json
import math
from pathlib import Path

import cv2
import numpy as np
import pytest
from pymavlink import mavutil

from dronecats.border.camera import CameraModel
from dronecats.border.frames import geodetic_to_ned
from dronecats.cli.main import main
from dronecats.sitl.scenario import load_world, origin
from episodes.assets.multirotor import X500
from episodes.render import Renderer, camera_pose

SMALL = CameraModel(640, 360)


def fly(capsys, out, *arguments):
    assert main(["fly", "--sitl", "--pilot", "oracle", "--out", str(out), "--json", *arguments]) == 0
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    folder = out / result["episode"]
    logs = ("decisions.jsonl", "truth.jsonl")
    return result, *([json.loads(line) for line in (folder / log).read_text().splitlines()] for log in logs)


@pytest.mark.parametrize("episode", ["blocks-commanding-01", "residential-commanding-01"])
def test_a_fleet_finds_the_named_candidate_in_lockstep(tmp_path, capsys, episode):
    result, decisions, truth = fly(capsys, tmp_path / "run", "--speed", "max", "--episode", episode)
    assert result["success"]
    steps = {}
    for decision in decisions:
        steps.setdefault(decision["step"], []).append(decision)
    for together in steps.values():
        assert [d["drone"] for d in together] == [0, 1, 2, 3]
        assert len({d["reply"] for d in together}) == 1  # one context: the same text, of which each has its part
        assert len({d["frame_id"] for d in together}) == 4
    frames = {f["frame_id"]: f for f in truth if f["kind"] == "frame"}
    assert all(frames[d["frame_id"]]["drone"] == d["drone"] for d in decisions)
    claims = [d for d in decisions if d["action"]["action"] == "finished"]
    assert len(claims) == result["declarations"] == 1
    assert frames[claims[0]["frame_id"]]["distance_m"] == pytest.approx(result["ne_m"], abs=1e-3)
    poses = [p for p in truth if p["kind"] == "pose"]
    assert {p["drone"] for p in poses} == {0, 1, 2, 3}
    waiting = set(range(4)) - {claims[0]["drone"]}
    for drone in waiting:  # those that only hover stay where they began
        places = [p["position_ned"] for p in poses if p["drone"] == drone]
        assert max(abs(a - b) for place in places for a, b in zip(place, places[0], strict=True)) < 0.8
    pictures_show_the_fleet(tmp_path / "run" / episode, truth)


def true_poses(folder: Path, world):
    """Return (drone, time in µs) → (place NED, matrix body → NED), as the truth bus had it, from the tlog."""
    log, poses = mavutil.mavlink_connection(str(folder / "flight.tlog"), dialect="development"), {}
    while message := log.recv_match(type="HIL_STATE_QUATERNION"):
        w, x, y, z = message.attitude_quaternion
        turned = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        )
        place = geodetic_to_ned(*origin(world), message.lat / 1e7, message.lon / 1e7, message.alt / 1e3)
        poses[message.get_srcSystem() - 1, message.time_usec] = (place, turned, tuple(message.attitude_quaternion))
    return poses


def pictures_show_the_fleet(folder: Path, truth) -> None:
    """Each picture that the pilot saw shows every other drone where a pinhole and the truth have it, and nothing else.

    What is looked for is the difference to the same place drawn without drones.
    """
    world = load_world(str(folder / "episode.json"))
    poses, bare = true_poses(folder, world), Renderer(world.scene, SMALL)
    t0_us = next(line["t0_us"] for line in truth if line["kind"] == "begin")
    names = {f["frame_id"]: f for f in truth if f["kind"] == "frame"}
    shape = np.array([*X500.touching, *X500.hubs, SMALL.offset_frd])
    shown = unseen = 0
    for name in sorted((folder / "frames").iterdir()):
        frame = names[int(name.stem.split("_")[0])]
        time_us, i = t0_us + round(frame["t"] * 1e6), frame["drone"]
        place, turned, attitude = poses[i, time_us]
        eye = np.array(place) + turned @ np.array(SMALL.offset_frd)
        picture = cv2.imread(str(name))[..., ::-1].astype(int)
        view = bare.render(camera_pose(place, attitude, SMALL), world.moved(frame["t"]))
        differs = np.abs(picture - view.rgb).max(axis=2) > 60
        allowed = np.zeros_like(differs)
        for j in set(range(4)) - {i}:
            other, its_turn, _ = poses[j, time_us]
            local = (np.array(other) + shape @ its_turn.T - eye) @ turned
            if (local[:, 0] < 0.2).any():
                continue
            pixels = np.array((320.0, 180.0)) + 320.0 * local[:, 1:] / local[:, :1]
            (left, top), (right, bottom) = (
                np.clip(pixels.min(axis=0), 0, (640, 360)),
                np.clip(pixels.max(axis=0), 0, (640, 360)),
            )
            box = (
                slice(max(int(top) - 3, 0), math.ceil(bottom) + 3),
                slice(max(int(left) - 3, 0), math.ceil(right) + 3),
            )
            allowed[box] = True
            near, whole = local[:, 0].max() < 3.0, right - left > 0.9 * np.ptp(pixels[:, 0])
            if near and whole:  # and nothing stands between drones so near to each other
                assert differs[box].mean() > 0.05, f"drone {j} is not in {name.name}"
                shown += 1
        assert (differs & ~allowed).mean() < 0.004, f"{name.name} shows what is not there"
        unseen += not allowed.any()
    bare.close()
    assert shown >= 2  # of those that stand behind
    assert unseen >= 2  # of those that stand before


@pytest.mark.slow
def test_a_fleet_flies_in_real_time_although_its_four_frames_take_a_while(tmp_path, capsys):
    result, decisions, _ = fly(capsys, tmp_path / "run", "--speed", "1", "--episode", "blocks-commanding-01")
    assert result["success"]
    assert {d["drone"] for d in decisions} == {0, 1, 2, 3}
