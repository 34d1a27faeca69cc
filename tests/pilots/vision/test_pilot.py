"""Tests detection, ranging, rejection and decisions of the vision pilot on drawn pictures."""

import json
import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dronecats.pilots.actions import PastAction
from dronecats.pilots.vision import color_detector, color_target, pilot, ranging, search
from dronecats.pilots.vision import color_target as approach
from dronecats.pilots.vision.command import SIZES, read_referent
from episodes.maps import assets
from foundation.camera import encode
from foundation.errors import UsageError

BGR = {
    "red": (24, 18, 200),
    "orange": (10, 110, 240),
    "yellow": (10, 205, 245),
    "green": (50, 140, 20),
    "cyan": (220, 205, 0),
    "blue": (190, 60, 20),
    "purple": (150, 35, 110),
    "magenta": (150, 20, 210),
}
CAMERA_UP_M = 1.7


def scene(seed=1, sunny=1.0):
    """Return a 640 × 360 picture of sky, grass, a grey road and two dull houses, with the horizon in the middle."""
    rng = np.random.default_rng(seed)
    picture = np.zeros((360, 640, 3), np.float32)
    height = np.linspace(0.0, 1.0, 180)[:, None]
    picture[:180] = (235, 190, 150) * (1 - height[:, :, None]) + np.array((240, 225, 210)) * height[:, :, None]
    picture[180:] = (45, 120, 85)
    cv2.fillConvexPoly(picture, np.array([(310, 180), (330, 180), (700, 360), (-60, 360)]), (105, 105, 105))
    cv2.rectangle(picture, (20, 110), (150, 195), (120, 150, 170), -1)
    cv2.fillConvexPoly(picture, np.array([(10, 110), (85, 70), (160, 110)]), (50, 55, 110))
    cv2.rectangle(picture, (520, 120), (630, 190), (90, 110, 150), -1)
    picture[180:] += rng.normal(0.0, 9.0, (180, 640, 1))
    return np.clip(picture * sunny, 0, 255).astype(np.uint8)


def put(picture, bgr, distance_m, side_m=0.0, side_on=True, size=None, shade=1.0):
    """Draw a simple vehicle whose centre is `distance_m` ahead of the body and `side_m` to the right."""
    size = size or SIZES["suv"]
    long, deep = (size.length_m, size.width_m) if side_on else (size.width_m, size.length_m)
    face = distance_m - 0.5 - 0.5 * deep
    f = 320.0

    def pixel(x, up):
        return round(320 + f * (side_m + x) / face), round(180 + f * (CAMERA_UP_M - up) / face)

    def box(left, low, right, high, color):
        cv2.rectangle(picture, pixel(left, high), pixel(right, low), tuple(int(c * shade) for c in color), -1)

    box(-long / 2, size.paint_from_m, long / 2, 0.62 * size.height_m, bgr)
    box(-long * 0.35, 0.62 * size.height_m, long * 0.4, size.paint_to_m, bgr)
    box(-long * 0.3, 0.65 * size.height_m, long * 0.35, 0.92 * size.height_m, (45, 35, 30))
    for wheel in (-0.3, 0.3) if side_on else ():
        box(long * wheel - 0.35, 0.0, long * wheel + 0.35, 0.65, (28, 28, 28))
    return picture


def look(picture, command):
    return color_detector.find(pilot.decode(encode(picture[:, :, ::-1])), read_referent(command))


def decide(picture, command="go to the cyan SUV", past=()):
    return json.loads(color_target.decide(pilot.decode(encode(picture[:, :, ::-1])), read_referent(command), past))


def test_every_colour_is_detected_at_its_place_in_sun_and_shade():
    for shade in (1.0, 0.55):
        for color in BGR:
            seen = look(put(scene(), BGR[color], 12.0, 2.0, shade=shade), f"go to the {color} SUV")
            assert seen is not None, (color, shade)
            assert 0.5 * (seen.box.left + seen.box.right) == pytest.approx(0.5 * 2.0 / 10.5, abs=0.03), (color, shade)


def test_distance_is_estimated_from_apparent_size():
    for side_on in (True, False):
        for distance in (4.5, 6.0, 9.0, 14.0, 20.0):
            seen = look(put(scene(), BGR["cyan"], distance, side_on=side_on), "go to the cyan SUV")
            assert seen.range.distance_m == pytest.approx(distance, rel=0.2), (distance, side_on)


def test_nothing_is_detected_in_an_empty_scene():
    for color in BGR:
        assert look(scene(), f"go to the {color} SUV") is None


def test_sky_and_lawn_are_not_detected_as_cars():
    blue_sky = scene()
    blue_sky[:170] = (205, 135, 75)
    assert look(blue_sky, "go to the blue car") is None
    assert look(scene(3), "go to the green car") is None


def test_a_car_of_another_colour_is_not_detected():
    assert look(put(scene(), BGR["red"], 10.0), "go to the cyan SUV") is None


def test_the_car_of_the_named_colour_is_detected():
    picture = put(put(scene(), BGR["red"], 9.0, -3.0, side_on=False), BGR["blue"], 9.0, 3.0, side_on=False)
    assert look(picture, "go to the blue car").box.left > 0.0
    assert look(picture, "go to the red car").box.right < 0.0


def test_a_sign_in_the_sky_is_too_high_to_be_a_car():
    picture = scene()
    cv2.rectangle(picture, (300, 60), (360, 90), BGR["cyan"], -1)
    assert look(picture, "go to the cyan SUV") is None


def test_the_pilot_approaches_by_depth_then_by_short_strides_and_declares():
    far, nearer = (decide(put(scene(), BGR["cyan"], d)) for d in (14.0, 6.5))
    assert far["action"] == nearer["action"] == "go"
    assert far["depth_m"] > 10.0
    assert 2.0 <= nearer["depth_m"] < 5.0
    assert decide(put(scene(), BGR["cyan"], 3.9))["action"] == "finished"


CLAIM, NEARER = PastAction("finished"), PastAction("go", x_px=640.0, y_px=400.0, depth_m=2.6)


def end_on(distance_m):
    return put(scene(), BGR["cyan"], distance_m, side_on=False)


def test_a_failed_claim_is_repeated_from_nearer_and_then_given_up():
    once = decide(end_on(4.4), past=(CLAIM,))
    assert once["action"] == "go"
    assert 1.2 <= 0.6 * once["depth_m"] <= 2.5
    assert decide(end_on(4.2), past=(CLAIM, NEARER))["action"] == "finished"
    thrice = decide(end_on(4.2), past=(CLAIM, NEARER, CLAIM, NEARER, CLAIM))
    assert thrice == {"action": "rotate", "angle_deg": search.LEAVE_TURN_DEG}


def test_a_claimed_target_that_moves_away_is_followed():
    assert decide(end_on(7.5), past=(CLAIM,))["action"] == "go"
    assert decide(scene(), past=(CLAIM,))["action"] == "rotate"


def test_after_a_failed_claim_the_pilot_flies_to_an_open_view():
    """The pilot flies away before it searches. A target's end at the picture's edge is not a detection."""
    turned = PastAction("rotate", angle_deg=search.LEAVE_TURN_DEG)
    assert decide(scene(), past=(CLAIM, turned))["depth_m"] == search.WANDER_M
    beside = put(scene(), BGR["cyan"], 4.5, -4.5)
    assert decide(beside, past=(CLAIM, turned))["depth_m"] == search.WANDER_M
    other = decide(put(scene(), BGR["cyan"], 12.0, 3.0), past=(CLAIM, turned))
    assert other["action"] == "go"
    assert other["point"][0] > 550


def test_after_the_second_failed_target_the_pilot_turns_to_the_other_side():
    first = json.loads(search.turn_away(()))["angle_deg"]
    assert json.loads(search.turn_away((PastAction("rotate", angle_deg=first), CLAIM)))["angle_deg"] == -first


def test_a_target_missing_in_one_picture_is_approached_once_more():
    seen_before = PastAction("go", x_px=500.0, y_px=370.0, depth_m=14.0)
    on = decide(scene(), past=(seen_before,))
    assert on["action"] == "go"
    assert on["point"] == [500, 500]
    assert on["depth_m"] == pytest.approx(11.0)
    blind = PastAction("go", x_px=640.0, y_px=360.0, depth_m=11.0)
    assert decide(scene(), past=(seen_before, blind))["action"] == "rotate"


def test_a_weak_detection_counts_only_at_the_expected_place():
    hidden, bias, out = (np.zeros(shape, np.float32) for shape in ((color_detector.LENGTH, 1), (1,), (1, 2)))
    unsure = color_detector.PatchNetwork(hidden, bias, out, np.array((-0.85, 0.0), np.float32))
    picture, named = put(scene(), BGR["cyan"], 12.0), read_referent("go to the cyan SUV")
    assert color_detector.find(picture, named, network=unsure) is None
    assert color_detector.find(picture, named, color_detector.ExpectedPlace(0.0, 10.5), unsure) is not None
    assert color_detector.find(picture, named, color_detector.ExpectedPlace(0.0, 30.0), unsure) is None
    assert color_detector.find(picture, named, color_detector.ExpectedPlace(0.4, 10.5), unsure) is None


def test_every_vehicle_of_the_catalogue_is_ranged_by_its_own_outline():
    """A box is not enough: the painted parts of a cyclist, or of a quadrotor on its stand, are not a box."""
    for distance in (6.0, 12.0):
        for asset in color_detector.KINDS:
            mesh = assets.build(asset, "red")
            painted = [k for k, m in enumerate(mesh.materials) if m.name.endswith("-red")]
            points = mesh.vertices[np.unique(mesh.triangles[np.isin(mesh.material, painted)])] * (1.0, 1.0, -1.0)
            size = SIZES[{"pickup": "pickup truck"}.get(asset, asset)]
            for turn in (0.3, 1.2, 2.4):
                c, s = math.cos(turn), math.sin(turn)
                ahead = distance - 0.5 + c * points[:, 0] - s * points[:, 1]
                if ahead.min() < 2.0:  # it is cut off below and cannot be measured
                    continue
                x, y = 0.5 * (s * points[:, 0] + c * points[:, 1]) / ahead, 0.5 * (CAMERA_UP_M - points[:, 2]) / ahead
                low = np.clip((x.min(), y.min()), (-0.5, -9 / 32), 9.0)
                high = np.clip((x.max(), y.max()), -9.0, (0.5, 9 / 32))
                box = ranging.BoundingBox(*low.tolist(), *high.tolist())
                assert ranging.measure(box, size, 9 / 16).distance_m == pytest.approx(distance, rel=0.15), asset


def test_the_search_turns_one_way_and_leaves_after_a_full_circle():
    picture, turned = scene(), 0.0
    past: list[PastAction] = []
    while (action := decide(picture, past=tuple(past[-5:])))["action"] == "rotate":
        turned += action["angle_deg"]
        past.append(PastAction("rotate", angle_deg=action["angle_deg"]))
        assert len(past) < 14
    assert turned >= 300.0  # with a field of view of 90°, this covers all directions
    assert action["action"] == "go"


def test_the_pilot_turns_to_the_side_of_a_target_lost_nearby():
    assert decide(scene(), past=(PastAction("go", x_px=200.0, depth_m=4.0),))["angle_deg"] < 0
    assert decide(scene(), past=(PastAction("go", x_px=1100.0, depth_m=4.0),))["angle_deg"] > 0


def test_a_target_that_disappears_after_the_shortest_stride_is_claimed_once():
    nothing = scene()
    for depth, action in ((2.01, "finished"), (2.6, "rotate"), (4.5, "rotate")):
        assert decide(nothing, past=(PastAction("go", x_px=600.0, depth_m=depth),))["action"] == action
    claimed = (PastAction("go", x_px=600.0, depth_m=2.01), PastAction("finished"))
    assert decide(nothing, past=claimed)["action"] == "rotate"


def test_without_a_colour_word_the_pilot_searches_and_never_claims():
    assert decide(put(scene(), BGR["cyan"], 4.0), "go to the SUV")["action"] == "rotate"


def test_equal_requests_get_equal_replies_with_one_action_per_picture():
    jpeg = encode(put(scene(), BGR["cyan"], 10.0)[:, :, ::-1])
    prompt = "Command: go to the cyan SUV\n1. ROTATE angle=60deg"
    assert pilot.answer(prompt, [jpeg]) == pilot.answer(prompt, [jpeg])
    assert len(json.loads(pilot.answer(prompt, [jpeg] * 4))) == 4


@settings(max_examples=40, deadline=None)
@given(st.binary(max_size=300))
def test_bytes_that_are_not_a_picture_are_rejected(data):
    with pytest.raises(UsageError):
        pilot.answer("Command: go to the cyan SUV", [data])


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from([*BGR, "white", "black", "grey", "pink", "brown"]))
def test_any_picture_gets_a_valid_action(seed, color):
    rng = np.random.default_rng(seed)
    picture = rng.integers(0, 256, (36, 64, 3), dtype=np.uint8).repeat(10, 0).repeat(10, 1)
    action = decide(picture, f"go to the {color} van")
    assert action["action"] in ("go", "rotate", "think", "finished")
    if action["action"] == "go":
        assert all(0 <= v <= 1000 for v in action["point"])
        assert math.isfinite(action["depth_m"])
        assert action["depth_m"] >= 2.0


def test_the_pilot_aims_ahead_of_a_target_that_crosses_its_path():
    """The target was straight ahead when the last stride began, and has moved right since."""
    picture = put(scene(), BGR["cyan"], 13.0, 1.2)
    before = PastAction("go", x_px=600.0, y_px=380.0, depth_m=approach.encode_lead(15.5, 0.0))
    assert decide(picture, past=(before,))["point"][0] > decide(picture)["point"][0] + 25


def test_vehicles_with_plates_are_ranged_by_their_size_alone():
    """`find_all` serves fleets, which look for vehicles with plates. It ignores the outline of the kind."""
    seen = color_detector.find_all(put(scene(), BGR["cyan"], 12.0), read_referent("go to the cyan van"))
    boxy = replace(SIZES["van"], outline="")
    assert [s.range for s in seen] == [ranging.measure(s.box, boxy, 9 / 16) for s in seen] != []
