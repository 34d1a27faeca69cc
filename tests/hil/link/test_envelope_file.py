import pytest

from foundation.errors import UsageError
from hil.link.envelope import SIMULATED, Limits, load
from tests.support.refusal import refusal


def test_a_file_overrides_only_the_limits_that_it_contains(tmp_path):
    path = tmp_path / "field.toml"
    path.write_text("ceiling_m = 12\nexclusions = [[[5, -2], [5, 2], [9, 2], [9, -2]]]\nfloor_m = -3.5\n")
    limits = load(path, Limits())
    assert (limits.ceiling_m, limits.floor_m, limits.radius_m) == (12.0, -3.5, Limits().radius_m)
    assert limits.exclusions == (((5.0, -2.0), (5.0, 2.0), (9.0, 2.0), (9.0, -2.0)),)
    path.write_text("")
    assert load(path, SIMULATED) == SIMULATED


def test_an_error_names_the_file_and_the_limit(tmp_path):
    for text, words in [
        ("ceiling = 3", ("'ceiling'", "ceiling_m")),
        ("ceiling_m = 'high'", ("ceiling_m", "'high'")),
        ("speed = nan", ("speed", "nan")),
        ("speed = -1", ("speed", "-1")),
        ("yaw_rate = true", ("yaw_rate", "True")),
        ("ceiling_m = 1.2", ("floor_m", "ceiling_m", "height_margin_m")),
        ("radius_m = 0.5", ("radius_m", "margin_m")),
        ("exclusions = [[[1, 2], [3, 4]]]", ("exclusions",)),
        ("exclusions = [[[1, 2], [3, inf], [4, 5]]]", ("exclusions",)),
        ("exclusions = 7", ("exclusions",)),
        ("exclusions_geodetic = [[[1], [2], [3]]]", ("exclusions_geodetic", "latitude", "longitude")),
        ("ceiling_m = = 3", ("TOML",)),
    ]:
        path = tmp_path / "field.toml"
        path.write_text(text)
        message = refusal(load, path, Limits())
        assert [word for word in (str(path), *words) if word not in message] == [], text


def test_a_missing_file_is_reported(tmp_path):
    with pytest.raises(UsageError, match=r"nowhere\.toml"):
        load(tmp_path / "nowhere.toml", Limits())
