import pytest

from foundation.errors import UsageError
from hil.link.envelope import SIMULATED, Limits
from hil.link.envelope_file import load


def test_a_file_says_what_differs(tmp_path):
    path = tmp_path / "field.toml"
    path.write_text("ceiling_m = 12\nexclusions = [[[5, -2], [5, 2], [9, 2], [9, -2]]]\nfloor_m = -3.5\n")
    limits = load(path, Limits())
    assert (limits.ceiling_m, limits.floor_m, limits.radius_m) == (12.0, -3.5, Limits().radius_m)
    assert limits.exclusions == (((5.0, -2.0), (5.0, 2.0), (9.0, 2.0), (9.0, -2.0)),)
    path.write_text("")
    assert load(path, SIMULATED) == SIMULATED


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("ceiling = 3", "'ceiling' is no limit; there are battery_min, ceiling_m"),
        ("ceiling_m = 'high'", "ceiling_m wants a number above 0, got 'high'"),
        ("speed = nan", "speed wants a number above 0"),
        ("speed = -1", "speed wants a number above 0"),
        ("yaw_rate = true", "yaw_rate wants a number"),
        ("ceiling_m = 1.2", "no room is left"),
        ("radius_m = 0.5", "leaves no room"),
        ("exclusions = [[[1, 2], [3, 4]]]", "three or more corners"),
        ("exclusions = [[[1, 2], [3, inf], [4, 5]]]", "three or more corners"),
        ("exclusions = 7", "three or more corners"),
        ("exclusions_geodetic = [[[1], [2], [3]]]", "latitude, longitude"),
        ("ceiling_m = = 3", "is not TOML"),
    ],
)
def test_what_is_wrong_is_named(tmp_path, text, sentence):
    path = tmp_path / "field.toml"
    path.write_text(text)
    with pytest.raises(UsageError) as refused:
        load(path, Limits())
    assert sentence in str(refused.value)
    assert str(path) in str(refused.value)


def test_no_file_is_said(tmp_path):
    with pytest.raises(UsageError, match="cannot be read"):
        load(tmp_path / "nowhere.toml", Limits())
