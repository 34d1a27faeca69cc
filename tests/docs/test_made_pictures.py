"""The committed pictures have the size and the colours that their code produces."""

from typing import Any

import cv2
import numpy as np
import pytest

from tests.docs.made_pictures import FOLDER, MADE, few_colors

NEAR = 24  # tolerance of each channel, of 255: JPEG compression and resizing change colours
PIXELS = 40  # minimum number of pixels in the colour of a mark


@pytest.mark.parametrize("made", MADE, ids=lambda made: made.name)
def test_a_committed_picture_has_the_size_and_the_colours_of_its_marks(made):
    picture: Any = cv2.imread(str(FOLDER / made.name))
    assert (picture.shape[1], picture.shape[0]) == made.size
    rgb = picture[..., ::-1].astype(int)
    for color in made.colors:
        assert (np.abs(rgb - color).max(axis=2) <= NEAR).sum() >= PIXELS, color


def test_color_reduction_keeps_the_colors_of_small_marks():
    shades = np.random.default_rng(0).integers(60, 200, (200, 200, 1), np.uint8)
    picture = np.repeat(shades, 3, axis=2)
    picture[:4, :4] = (255, 47, 214)
    kept = np.asarray(few_colors(picture, ((255, 47, 214),)).convert("RGB"))
    assert (kept[:4, :4] == (255, 47, 214)).all()
