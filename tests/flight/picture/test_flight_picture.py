"""The picture of a flight is drawn from its files alone, complete or truncated."""

import json
import math

import cv2
import numpy as np
import pytest

from dronecats.flight import picture as flight_picture
from dronecats.judge.verdict import qualifies
from foundation.errors import UsageError
from foundation.run_folder.reading import read
from tests import pictures


def flight(folder, drones=1, steps=12, declare=(7, 11), target_speed=0.0):
    """A synthetic run: each drone flies north to a target at (16, 2), 20 s long."""
    (folder / "frames").mkdir(parents=True)
    truth, decisions = [], []

    def pose(t, drone):
        position = [min(13.5, t), 3.0 * drone + math.sin(t / 3), -1.6]
        target = [16.0, 2.0 + target_speed * t, -0.9]
        return position, target, math.dist(position, target)

    for tick in range(41):
        for drone in range(drones):
            position, target, distance = pose(tick / 2, drone)
            truth.append({"kind": "pose", "t": tick / 2, "drone": drone, "position_ned": position, "yaw_deg": 5.0,
                          "target_ned": target, "distance_m": distance, "visible": True})  # fmt: skip
    for step in range(steps):
        for drone in range(drones):
            t = 1.5 * step
            position, target, distance = pose(t, drone)
            frame_id = step * drones + drone
            truth.append({"kind": "frame", "frame_id": frame_id, "t": t, "drone": drone, "position_ned": position,
                          "yaw_deg": 5.0, "target_ned": target, "distance_m": distance, "visible": True})  # fmt: skip
            action = {"action": "go", "point": [500 + 10 * step, 520], "depth_m": 9.0}
            if step in declare:
                action = {"action": "finished"}
            elif step % 4 == 3:
                action = {"action": "rotate", "angle_deg": 45.0}
            decisions.append({"step": step, "drone": drone, "frame_id": frame_id, "t_frame": t, "t_decided": t + 0.1,
                              "reply": "{}", "action": action, "error": None})  # fmt: skip
            picture = np.full((360, 640, 3), (200, 170, 120), np.uint8)
            picture[200:] = (90, 90, 90)
            cv2.rectangle(
                picture, (300 - 8 * step, 190 - 4 * step), (340 + 8 * step, 210 + 8 * step), (200, 200, 0), -1
            )
            name = f"{frame_id:06d}{f'_d{drone}' if drone else ''}.jpg"
            cv2.imwrite(str(folder / "frames" / name), picture)
    (folder / "truth.jsonl").write_text("".join(json.dumps(r) + "\n" for r in truth))
    (folder / "decisions.jsonl").write_text("".join(json.dumps(r) + "\n" for r in decisions))
    (folder / "episode.json").write_text(json.dumps({"id": "lab-01", "instruction": "go to the cyan SUV $x_1$"}))
    verdict = {"outcome": "success", "ne_m": 3.2, "steps": steps, "deciding": {"t": 16.6}}
    (folder / "verdict.json").write_text(json.dumps(verdict))
    return folder


def colour(path, bgr, tolerance=40):
    """Return the number of pixels of about this colour."""
    picture = pictures.read(path).astype(int)
    return int((np.abs(picture - bgr).max(axis=2) < tolerance).sum())


EXTENT = (-40.0, 60.0, -75.0, 75.0)  # m NED
GROUND = np.full((20, 30, 3), 230, np.uint8)  # a picture from above that fills EXTENT
GREEN, RED = (0x3A, 0xC9, 0x18), (0x2A, 0x2A, 0xFF)


def test_a_complete_flight_shows_the_map_and_both_kinds_of_declaration(tmp_path):
    folder = flight(tmp_path / "run", target_speed=0.04)
    picture = np.full((200, 300, 3), (96, 128, 72), np.uint8)
    path = flight_picture.draw(folder, picture, EXTENT)
    assert path == folder / "flight.png"
    drawn = pictures.read(path)
    assert drawn.shape[1] == 1280
    assert drawn.shape[0] > 1200  # map and two rows of frames
    assert colour(path, GREEN) > 30
    assert colour(path, RED) > 30
    assert colour(path, (72, 128, 96), 3) > 100_000  # the map is there


def test_a_declaration_qualifies_by_the_truth_of_its_own_frame(tmp_path):
    logs = read(flight(tmp_path / "run"))
    qualifying = {d.step: qualifies(d, logs) for d in logs.decisions}
    assert qualifying[7] is False  # 10.5 m north of the start: still more than 5 m away
    assert qualifying[11] is True
    assert qualifying[0] is None


def test_a_flight_without_declarations_or_record_is_still_drawn(tmp_path):
    folder = flight(tmp_path / "run", declare=())
    for name in ("episode.json", "verdict.json"):
        (folder / name).unlink()
    path = flight_picture.draw(folder, GROUND, EXTENT)
    assert colour(path, GREEN) == 0
    assert colour(path, RED, 20) == 0


def test_each_drone_of_a_fleet_has_its_own_colour(tmp_path):
    folder = flight(tmp_path / "run", drones=4, steps=3, declare=(2,))
    path = flight_picture.draw(folder, GROUND, EXTENT)
    for rgb in ("ffb000", "3fa7ff", "ff5c8a", "b48cff"):
        r, g, b = bytes.fromhex(rgb)
        assert colour(path, (b, g, r), 25) > 100


def test_the_same_files_give_the_same_picture(tmp_path):
    folder = flight(tmp_path / "run", steps=5)
    first = flight_picture.draw(folder, GROUND, EXTENT).read_bytes()
    assert flight_picture.draw(folder, GROUND, EXTENT).read_bytes() == first


@pytest.mark.parametrize("keep", [0.0, 0.3, 0.77, 0.999])
def test_truncated_logs_are_drawn(tmp_path, keep):
    folder = flight(tmp_path / "run", steps=6)
    for name in ("truth.jsonl", "decisions.jsonl"):
        data = (folder / name).read_bytes()
        (folder / name).write_bytes(data[: int(keep * len(data))])
    (folder / "frames" / "000001.jpg").write_bytes(b"\xff\xd8\xff")
    (folder / "verdict.json").write_text('{"outcome": "succ')
    assert flight_picture.draw(folder, GROUND, EXTENT).stat().st_size > 10_000


def test_a_folder_without_logs_is_rejected(tmp_path):
    with pytest.raises(UsageError, match=r"truth\.jsonl"):
        flight_picture.draw(tmp_path, GROUND, EXTENT)
