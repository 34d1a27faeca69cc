"""Camera options from TOML: the file sets the options, and an invalid file gives an error of one sentence."""

import json
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from episodes.camera.optics.file import load, optics_of
from episodes.camera.optics.options import Exposure, Haze, LensModel, Optics, Rain, Sensor
from foundation.errors import UsageError

ALL = """
seed = 7
[lens]
k1 = -0.2
k2 = 0.03
vignetting = 0.5
[sensor]
full_well_e = 3000
read_noise_e = 4.5
[exposure]
time_s = 0.02
poses = 4
[haze]
density_per_m = 0.01
color = [0.5, 0.5, 0.6]
[rain]
rate_mm_h = 12
wind_ned = [3, 0, 0]
"""
WANTED = Optics(
    LensModel(-0.2, 0.03, vignetting=0.5),
    Sensor(3000.0, 4.5),
    Exposure(0.02, 4),
    Haze(0.01, color=(0.5, 0.5, 0.6)),
    Rain(12.0, (3.0, 0.0, 0.0)),
    7,
)


def test_a_file_sets_the_options_and_json_preserves_them(tmp_path):
    file = tmp_path / "optics.toml"
    file.write_text(ALL)
    optics = load(file)
    assert optics == WANTED
    assert optics_of(json.loads(json.dumps(optics.as_dict())), "run.json") == optics


def test_an_empty_file_enables_no_effect(tmp_path):
    file = tmp_path / "optics.toml"
    file.write_text("")
    assert load(file) == Optics()


def test_an_invalid_file_is_rejected_in_one_sentence(tmp_path):
    for text, part in (
        ("[lens", "optics.toml"),
        ("[lenz]\nk1 = 0", "'lens'"),
        ("[haze]\ndensity = 1", "'density_per_m'"),
        ("[lens]\nk1 = 'much'", "'lens.k1'"),
        ("[lens]\nk1 = nan", "'lens.k1'"),
        ("[lens]\nk1 = true", "'lens.k1'"),
        ("[lens]\nk1 = -0.3", "[lens]"),
        ("[lens]\nk1 = -0.25\nk2 = 0.0288", "[lens]"),
        ("[exposure]\nposes = 2.5", "'exposure.poses'"),
        ("[exposure]\nposes = 100000", "2 … 64"),
        ("[rain]\nwind_ned = [1, 2]", "'rain.wind_ned'"),
        ("[rain]\nwind_ned = [1, 2, 1e9]", "-40 … 40"),
        ("rain = 3", "rain"),
        ("seed = -1", "seed"),
        ("a = " + "[" * 5000, "TOML"),
        ("#" * 1_000_001, "optics.toml"),
    ):
        file = tmp_path / "optics.toml"
        file.write_text(text)
        with pytest.raises(UsageError, match=re.escape(part)) as refused:
            load(file)
        assert len(str(refused.value).splitlines()) == 1, text
        assert "optics.toml" in str(refused.value), text


def test_the_error_names_a_missing_file(tmp_path):
    with pytest.raises(UsageError, match=r"none\.toml"):
        load(tmp_path / "none.toml")


VALUE = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=6,
)
KEYS = st.sampled_from(["k1", "time_s", "poses", "color", "wind_ned", "density_per_m"]) | st.text()
SECTION = st.dictionaries(KEYS, VALUE, max_size=3)
NAMES = st.sampled_from(["sensor", "exposure", "haze", "rain", "lens", "seed"]) | st.text(max_size=8)


@given(st.dictionaries(NAMES, SECTION | VALUE, max_size=4))
def test_any_table_gives_options_or_a_usage_error(table):
    try:
        optics = optics_of(table, "here")
    except UsageError:
        return
    assert optics_of(optics.as_dict(), "again") == optics
