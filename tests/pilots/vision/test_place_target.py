"""Tests targets that a command names by their place, in rendered pictures."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from dronecats.pilots.actions import PastAction
from dronecats.pilots.fitting import shapes
from dronecats.pilots.vision import pilot, place_target, shape_detector
from dronecats.pilots.vision.command import read_place_expression
from episodes.camera.renderer import renderer as renderers
from episodes.maps import assets, campus
from episodes.maps import scene as scenes
from episodes.maps.assets import service_vehicles
from foundation.camera import CameraModel, CameraPose, encode
from foundation.frames import quat_from_euler

HALF = CameraModel(640, 360)
EYE = (-20.0, 0.0)  # north, east; things stand on the plaza in front of it
SEARCH = shape_detector.find
SEARCHED: dict[tuple[bytes, tuple[str, ...]], list[shape_detector.PlacedThing]] = {}


@pytest.fixture(scope="module")
def court():
    """Return a function (things as kind, m ahead, m right; camera height) → picture of the things on bare ground."""
    empty = campus.build(5)
    ground = tuple(i for i in empty.instances if i.kind == "ground")

    def see(*things, height=1.6):
        stand = tuple(
            scenes.Instance(
                100 + k, f"it-{k}", kind, mesh(kind), (EYE[0] + n, EYE[1] + e, empty.terrain.at(EYE[0] + n, EYE[1] + e))
            )
            for k, (kind, n, e) in enumerate(things)
        )
        renderer = renderers.Renderer(replace(empty, instances=(*ground, *stand)), HALF, shadow_cells=1024)
        eye = (*EYE, empty.terrain.at(*EYE) - height)
        rgb = renderer.render(CameraPose(eye, quat_from_euler(0.0, 0.0, 0.0))).rgb
        renderer.close()
        return pilot.decode(encode(rgb))

    return see


def mesh(kind):
    movers = {"service-cart": service_vehicles.service_cart, "delivery-robot": service_vehicles.delivery_robot}
    return movers[kind]("white") if kind in movers else assets.FIXTURES[kind]()


def decide(picture, command, past=()):
    expression = read_place_expression(command)
    assert expression is not None
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(shape_detector, "find", find_once)
        return json.loads(place_target.decide(picture, expression, past))


def find_once(picture, kinds, network):
    """Search a picture once for all decisions on it. The search takes most of a decision's time."""
    key = (picture.tobytes(), tuple(kinds))
    if key not in SEARCHED:
        SEARCHED[key] = SEARCH(picture, kinds, network)
    return SEARCHED[key]


def go(depth_m, x_px=640.0):
    return PastAction("go", x_px=x_px, depth_m=depth_m)


@pytest.mark.parametrize(("side", "left"), [("left of", True), ("right of", False)])
def test_the_target_on_the_named_side_of_the_landmark_is_approached(court, side, left):
    picture = court(("statue", 16.0, 0.0), ("planter", 16.5, -4.5), ("planter", 16.5, 4.5))
    action = decide(picture, f"go to the planter {side} the statue")
    assert action["action"] == "go"
    expected = 500.0 + 500.0 * math.copysign(4.5 / 16.5, -1.0 if left else 1.0)
    assert action["point"][0] == pytest.approx(expected, abs=40.0)
    assert action["depth_m"] == pytest.approx(math.hypot(17.0, 4.5), rel=0.2)


def test_nearest_means_nearest_to_the_landmark_and_not_to_the_drone(court):
    picture = court(("kiosk", 20.0, 9.0), ("picnic-table", 9.0, -4.0), ("picnic-table", 18.0, 4.0))
    action = decide(picture, "go to the picnic table nearest the kiosk")
    assert action["action"] == "go"
    assert action["point"][0] > 540.0


def test_the_pilot_follows_its_target_and_not_a_similar_thing(court):
    picture = court(("planter", 14.0, 0.0), ("planter", 8.0, -5.0))
    action = decide(picture, "go to the planter left of the statue", (go(17.0),))
    assert action["point"][0] == pytest.approx(500.0, abs=20.0)
    assert action["depth_m"] == pytest.approx(14.5, rel=0.15)


@pytest.mark.parametrize("height", [1.2, 1.3])
def test_a_near_target_is_claimed_and_a_distant_one_is_approached(court, height):
    command = "go to the planter left of the statue"
    assert decide(court(("planter", 3.2, 0.0), height=height), command, (go(2.01),))["action"] == "finished"
    assert decide(court(("planter", 7.5, 0.0), height=height), command, (go(10.5),))["action"] == "go"


def test_after_a_claim_the_pilot_comes_closer_once_claims_again_and_turns_away(court):
    picture = court(("planter", 4.6, 0.0))
    command = "go to the planter nearest Euler Hall"
    claimed = (go(2.01), go(3.0), PastAction("finished"))
    first = decide(picture, command, claimed)
    assert (first["action"], first["depth_m"]) == ("go", pytest.approx(2.01))
    assert decide(picture, command, (*claimed, go(2.01)))["action"] == "finished"
    assert decide(picture, command, (*claimed, go(2.01), PastAction("finished")))["action"] == "rotate"


def test_a_claimed_target_is_not_approached_again(court):
    picture = court(("planter", 4.5, 1.0), ("planter", 15.0, -8.0))
    past = (PastAction("finished"), PastAction("rotate", angle_deg=75.0))
    action = decide(picture, "go to the planter nearest Euler Hall", past)
    assert action["action"] == "go"
    assert action["point"][0] < 400.0


def test_a_find_command_turns_before_it_approaches_a_target(court):
    picture = court(("planter", 12.0, 0.0))
    assert decide(picture, "find the planter nearest Euler Hall and go to it")["action"] == "rotate"
    assert decide(picture, "go to the planter nearest Euler Hall")["action"] == "go"
    turned = (PastAction("rotate", angle_deg=60.0),)
    assert decide(picture, "find the planter nearest Euler Hall and go to it", turned)["action"] == "go"


def test_a_go_to_command_approaches_an_unsure_target_only_in_the_first_picture(court, monkeypatch):
    picture = court(("planter", 12.0, -3.0))
    monkeypatch.setattr(place_target, "_SURE", 1e6)
    assert decide(picture, "go to the planter nearest Euler Hall")["action"] == "go"
    turned = (PastAction("rotate", angle_deg=60.0),)
    assert decide(picture, "go to the planter nearest Euler Hall", turned)["action"] == "rotate"


def test_the_pilot_makes_a_detour_if_strides_bring_the_target_no_nearer(court):
    picture = court(("planter", 15.0, 0.0))
    held_up, on_the_way = (go(15.5), go(15.6), go(15.4)), (go(24.0), go(21.0), go(18.0))
    assert abs(decide(picture, "go to the planter nearest Euler Hall", held_up)["point"][0] - 500.0) > 300.0
    assert abs(decide(picture, "go to the planter nearest Euler Hall", on_the_way)["point"][0] - 500.0) < 30.0


def test_equal_requests_get_equal_replies(court):
    jpeg = encode(court(("statue", 16.0, 0.0), ("planter", 16.5, -4.5))[:, :, ::-1])
    prompt = "Command: go to the planter left of the statue\n1. GO x=640 y=360 depth=19m"
    answer = pilot.answer(prompt, [jpeg])
    assert pilot.answer(prompt, [jpeg]) == answer
    assert json.loads(answer)["action"] == "go"


def test_any_picture_gets_a_valid_action():
    for seed, size in enumerate(((640, 360), (320, 240), (64, 36), (17, 500))):
        picture = np.random.default_rng(seed).integers(0, 256, (size[1], size[0], 3), dtype=np.uint8)
        action = decide(picture, "go to the bench between the kiosk and the statue", (go(12.0),))
        assert action["action"] in ("go", "rotate", "finished"), size


@pytest.mark.slow
def test_most_things_on_a_campus_outside_the_fit_are_detected_at_their_place():
    jpegs = list(shapes.draw(shapes.CHECK_SEED + 50, 1, 12))
    results = shapes.evaluate(shape_detector.ShapeNetwork.shipped(), jpegs)
    near = [odds > -0.9 for present, _ in results.values() for depth, odds in present if depth < 20.0]
    false = sum(odds > 0.3 for _, false_odds in results.values() for odds in false_odds)
    assert len(near) >= 15
    assert sum(near) >= 0.55 * len(near)
    assert false <= 0.4 * len(jpegs) * len(shape_detector.KINDS)


def test_the_distance_of_a_thing_does_not_depend_on_the_height_of_the_camera(court):
    for height in (1.2, 1.6, 2.1):
        picture = court(("planter", 14.0, 3.0), height=height)
        seen = shape_detector.find(picture, ["planter"], shape_detector.ShapeNetwork.shipped())
        assert seen[0].depth_m == pytest.approx(14.0, rel=0.2)
        assert seen[0].right_m == pytest.approx(3.0, abs=0.8)
