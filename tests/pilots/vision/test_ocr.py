"""Tests reading the texts of boards and plates in rendered pictures."""

import math
import sys

import cv2
import numpy as np
import pytest

from dronecats.pilots.actions import PastAction
from dronecats.pilots.vision import boards, inscription_target, ocr, pilot, plates
from dronecats.pilots.vision.command import Inscription, plain_text, read_inscription, read_referent
from dronecats.pilots.vision.division import Candidate, GroundPoint, assign_things
from dronecats.pilots.vision.ocr import SURE_CONFIDENCE
from episodes.authoring import asset_pictures as probe
from episodes.camera.renderer.renderer import Renderer
from episodes.maps import assets
from episodes.records import catalogue
from episodes.world.world import World
from foundation.camera import CameraModel, camera_pose, encode
from foundation.errors import UsageError
from foundation.frames import quat_from_euler

SIGN, PLATE = probe.KINDS


def seen(kind, text, distance_m):
    """Return the pilot's picture of an inscription straight ahead, BGR."""
    return pilot.decode(encode(probe.view(kind, text, distance_m)))


@pytest.mark.parametrize(("text", "distance_m"), [("DEPOT", 5.0), ("ROOM 7", 8.0)])
def test_a_board_is_read(text, distance_m):
    image = seen(SIGN, text, distance_m)
    face = probe.face_of(assets.build(SIGN.asset, SIGN.paint, text), SIGN.material)
    eye = max(probe.LEAST_EYE_M, face.height)
    half, middle = 320.0 * 0.5 * boards.WIDTH_M / distance_m, 180.0 + 320.0 * (eye - face.height) / distance_m
    high = 320.0 * 0.5 * boards.HEIGHT_M / distance_m
    box = (round(320 - half), round(middle - high), round(320 + half), round(middle + high))
    board = Candidate(*box, GroundPoint(0.0, distance_m))
    wanted = Inscription(plain_text(text), False)
    assert ocr.matches(wanted, boards.read_board(image, board)) is True
    assert ocr.matches(Inscription("OTHER", False), boards.read_board(image, board)) is False


@pytest.mark.parametrize(("text", "distance_m"), [("5073", 3.0), ("9628", 5.0)])
def test_a_plate_is_detected_and_read(text, distance_m):
    image = seen(PLATE, text, distance_m)
    high = 320.0 * plates.HEIGHT_M / distance_m
    wide = round(320.0 * 1.0 / distance_m)
    plate = plates.find(image, (320 - wide, 100, 320 + wide, 340), high)
    assert plate is not None
    assert plate.text == text
    assert plate.reading is not None
    assert plate.reading.confidence >= SURE_CONFIDENCE
    assert plate.bottom - plate.top == pytest.approx(high, abs=2.0)


def test_equal_pictures_give_equal_readings():
    image = seen(PLATE, "3405", 6.0)
    part = image[180:300, 260:380]
    assert ocr.read_lines(part) == ocr.read_lines(part)


def test_a_missing_package_is_reported_in_one_sentence(monkeypatch):
    monkeypatch.setitem(sys.modules, "rapidocr", None)
    ocr.load_engine.cache_clear()
    jpeg = cv2.imencode(".jpg", np.zeros((360, 640, 3), np.uint8))[1].tobytes()
    with pytest.raises(UsageError, match=r"dronecats\[vision\]"):
        pilot.answer("Command: go to the sign that reads WEST\n", [jpeg] * 4)
    # a command without an inscription does not need the package
    assert "action" in pilot.answer("Command: go to the red car\n", [jpeg])
    ocr.load_engine.cache_clear()


@pytest.fixture(scope="module")
def first_pictures():
    """Return a function (episode) → its record and the four first pictures, BGR."""

    def look(name):
        record = catalogue.load(name)
        world, camera = World(record), CameraModel()
        renderer = Renderer(world.filmed, camera)
        images = []
        for drone, start in enumerate(record.starts):
            pose = camera_pose(start.position_ned, quat_from_euler(0.0, 0.0, math.radians(start.yaw_deg)), camera)
            view = renderer.render(pose, world.moved(0.0, world.fleet.other_starts(drone)))
            images.append(pilot.decode(encode(view.rgb)))
        renderer.close()
        return record, images

    return look


@pytest.mark.parametrize("name", ["blocks-commanding-01", "blocks-commanding-08"])
def test_four_drones_get_four_different_things(first_pictures, name):
    record, images = first_pictures(name)
    wanted = read_inscription(record.instruction)
    assert wanted is not None
    views = inscription_target.find_candidates(images, wanted, read_referent(record.instruction))
    spots = assign_things([[thing.spot for thing in view] for view in views])
    reached = set()
    for spot, start in zip(spots, record.starts, strict=True):
        assert spot is not None
        yaw = math.radians(start.yaw_deg)
        north = start.position_ned[0] + spot.ahead_m * math.cos(yaw) - spot.right_m * math.sin(yaw)
        east = start.position_ned[1] + spot.ahead_m * math.sin(yaw) + spot.right_m * math.cos(yaw)
        things = [record.target, *record.candidates]
        near = min(range(4), key=lambda k: math.dist((north, east), things[k].position_ned[:2]))
        reached.add(near)
    assert reached == {0, 1, 2, 3}


def test_a_board_is_distinguished_from_other_rectangles():
    blank = np.full((360, 640, 3), 176, np.uint8)
    cv2.rectangle(blank, (300, 170), (360, 212), (30, 30, 200), -1)
    assert boards.find(blank) == []  # no posts
    cv2.rectangle(blank, (307, 213), (310, 245), (80, 76, 72), -1)
    cv2.rectangle(blank, (350, 213), (353, 245), (80, 76, 72), -1)
    (board,) = boards.find(blank)
    assert board.spot.ahead_m == pytest.approx(320.0 * boards.HEIGHT_M / 43, rel=0.05)


def test_a_drone_that_has_read_another_text_waits():
    image = np.full((360, 640, 3), 176, np.uint8)
    waiting = (PastAction("think"),)
    command = "the sign that reads WEST"
    replies = inscription_target.decide([image, image], Inscription("WEST", False), command, [waiting, ()])
    assert '"think"' in replies[0]
    assert '"think"' not in replies[1]
