"""The shared style of all pages: the palettes of the light and dark themes, in CSS and in Python."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dronecats.report.kit import palette
from dronecats.report.kit.shell import PageContent, page

COLOR = re.compile("#[0-9a-fA-F]{3,8}")


def contrast(one: str, other: str) -> float:
    """Return the contrast ratio of two colours. Source: WCAG 2.2, relative luminance."""
    red, green, blue = 0.2126, 0.7152, 0.0722
    light = sorted(sum(w * c for w, c in zip((red, green, blue), palette.linear(x), strict=True)) for x in (one, other))
    return (light[1] + 0.05) / (light[0] + 0.05)


@pytest.mark.parametrize("theme", [palette.LIGHT, palette.DARK], ids=["light", "dark"])
def test_text_has_a_contrast_of_at_least_4_5_on_paper_and_panel(theme):
    for ink in ("ink", "quiet", "link", "good", "bad", "odd"):
        for ground in ("paper", "panel"):
            assert contrast(theme[ink], theme[ground]) >= 4.5, (ink, ground)


def test_both_themes_define_the_same_colours_and_styles_use_no_others():
    assert palette.LIGHT.keys() == palette.DARK.keys()
    for folder in ("dronecats.report.page", "dronecats.study.report"):
        html = "".join(page(PageContent(title="x", folder=folder, main="")))
        style = re.sub(r"--[\w-]+: [^;]+;", "", html.split("<style>")[1].split("</style>")[0])
        used = set(re.findall(r"var\(--([\w-]+)", style)) - {"c", "share"}
        assert used <= palette.LIGHT.keys() | palette.MARKS.keys()
        assert {color.lower() for color in COLOR.findall(style)} <= {"#000", "#0006", "#0008", "#fff", "#6d7278"}


@given(st.tuples(*[st.integers(0, 255)] * 3))
def test_linear_and_srgb_are_inverse(color):
    assert palette.shade(palette.linear("#{:02x}{:02x}{:02x}".format(*color))) == color
