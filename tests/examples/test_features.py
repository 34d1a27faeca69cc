"""The head's inputs are the same from a dataset and from a served prompt. Mirroring swaps left and right."""

import cv2
import numpy as np
import pytest

from dronecats.agent.action import Action, Finished, Go, Rotate, Think
from dronecats.agent.prompt import History, Prompt
from dronecats.pilots import actions
from examples.action_head import features
from foundation.camera import CameraModel, encode
from foundation.errors import UsageError

FLOWN: tuple[Action, ...] = (
    Rotate(-90.0),
    Rotate(-32.5),
    Go(412.0, 530.0, 13.25),
    Think(),
    Go(500.0, 498.0, 4.5),
    Finished(),
    Rotate(40.0),
)


def test_prompt_and_dataset_give_the_same_history():
    """Training reads logged actions. A flight reads the text of the prompt."""
    history = History(CameraModel())
    for count, action in enumerate(FLOWN, 1):
        history.append(action)
        prompt = Prompt.load().render("go to the cyan SUV", history.render(), 5)
        from_prompt = actions.read_prompt(prompt)
        past_steps = [features.as_past(one) for one in FLOWN[:count]][-5:]
        np.testing.assert_allclose(features.history(from_prompt.past(0)), features.history(past_steps), atol=1e-3)
        assert from_prompt.command == "go to the cyan SUV"
    assert not features.history(
        actions.read_prompt(Prompt.load().render("x", History(CameraModel()).render(), 5)).past(0)
    ).any()


def test_the_history_lists_the_newest_action_first_and_without_depth():
    near, far = (features.history([features.as_past(Go(250.0, 500.0, depth_m))]) for depth_m in (3.0, 30.0))
    np.testing.assert_array_equal(near, far)
    vector = features.history([features.as_past(one) for one in (Rotate(90.0), Go(250.0, 500.0, 3.0))])
    assert vector[:6].tolist() == [1.0, 0.0, 0.0, 0.0, -0.25, 0.0]
    assert vector[6:12].tolist() == [0.0, 1.0, 0.0, 0.0, 0.0, 1.0]


def test_the_history_holds_the_turn_since_the_last_go():
    past = [features.as_past(one) for one in (Rotate(-90.0), Go(500.0, 500.0, 5.0), Rotate(90.0), Rotate(45.0))]
    assert features.history(past)[-2] == pytest.approx(135.0 / 360.0)


def test_a_mirrored_history_swaps_left_and_right():
    past = [features.as_past(one) for one in FLOWN[:3]]
    mirrored = [features.as_past(one) for one in (Rotate(90.0), Rotate(32.5), Go(588.0, 530.0, 13.25))]
    for count in (2, 3):  # two turns; two turns and a go
        seen = features.history(past[:count], mirrored=True)
        np.testing.assert_allclose(seen, features.history(mirrored[:count]), atol=1e-6)


def test_word_features_distinguish_colours_objects_and_landmarks():
    def alike(one, other):
        return float(features.words(one) @ features.words(other))

    instruction = "fly to the cyan SUV"
    assert alike(instruction, instruction) == pytest.approx(1.0)
    assert alike(instruction, "fly to the brown SUV") < 0.9
    assert alike(instruction, "fly to the cyan van") > alike(instruction, "fly to the brown van")
    assert alike("the bench nearest the kiosk", "the kiosk nearest the bench") < 0.9
    assert not features.words("").any()


def test_mirrored_words_swap_left_and_right():
    left, right = "the kiosk left of the bench", "the kiosk right of the bench"
    np.testing.assert_array_equal(features.words(left, mirrored=True), features.words(right))
    assert (features.words(left) != features.words(right)).any()


def test_jpeg_and_png_pictures_are_resized_to_the_input_size():
    shown = np.zeros((720, 1280, 3), np.uint8)
    shown[:, 640:] = (250, 20, 20)
    ok, png = cv2.imencode(".png", shown[:, :, ::-1])
    assert ok
    for data in (encode(shown), png.tobytes()):
        small = features.picture(data)
        assert small.shape == (3, features.HEIGHT, features.WIDTH)
        assert small.dtype == np.uint8
        np.testing.assert_allclose(small[:, 70, -20], (250, 20, 20), atol=8)
        np.testing.assert_allclose(small[:, 70, 20], 0, atol=8)


def test_invalid_pictures_are_rejected():
    for data in (b"", b"no picture", b"\xff\xd8\xff\xe0"):
        with pytest.raises(UsageError):
            features.picture(data)
