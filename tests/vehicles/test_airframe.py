"""Airframe files: shipped ones can hover, and the error for an invalid one names its field."""

import tomllib
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from foundation.errors import UsageError
from foundation.frames import GRAVITY
from tests.support.refusal import refusal
from vehicles import airframe

FILES = Path(airframe.__file__).parent / "airframes"


@pytest.mark.parametrize("name", airframe.names())
def test_shipped_airframe_hovers_with_margin_and_balance(name: str) -> None:
    frame = airframe.load(name)
    assert 0.3 < frame.mass_kg * GRAVITY / frame.thrust_max < 0.6
    assert sum(rotor.spin for rotor in frame.rotors) == 0
    for axis in (0, 1):  # at equal speeds, the thrust acts on the centre of mass and the torques cancel
        assert sum(rotor.position_frd[axis] for rotor in frame.rotors) == pytest.approx(0.0, abs=1e-9)
        assert sum(rotor.spin * rotor.position_frd[axis] for rotor in frame.rotors) == pytest.approx(0.0, abs=1e-9)
    a, b, c = sorted(frame.inertia_frd)
    assert a + b >= c  # holds for every rigid body


@pytest.mark.parametrize("name", airframe.names())
def test_every_constant_names_its_source(name: str) -> None:
    for line in (FILES / f"{name}.toml").read_text(encoding="utf-8").splitlines():
        if "=" in line.split("#")[0] and not line.startswith(("spin", "contact_points_frd")):
            assert "#" in line, line


def test_quad_rotors_have_px4_order_and_spin() -> None:
    corners = [(r.position_frd[0] > 0, r.position_frd[1] > 0, r.spin) for r in airframe.load("x500").rotors]
    assert corners == [(True, True, 1), (False, False, 1), (True, False, -1), (False, True, -1)]


def test_unknown_name_suggests_the_nearest() -> None:
    with pytest.raises(UsageError, match="x500"):
        airframe.load("x50")
    with pytest.raises(UsageError, match=r"hexa.*nano.*racer250.*x500"):
        airframe.load("zzzzzz")
    with pytest.raises(UsageError, match=r"missing\.toml"):
        airframe.load("missing.toml")


def test_a_user_file_loads_by_path(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text((FILES / "x500.toml").read_text(encoding="utf-8").replace("mass_kg = 2.0", "mass_kg = 1.5"))
    assert airframe.load(str(path)).mass_kg == 1.5
    assert airframe.load(str(path)).name == "mine"


def test_the_error_names_a_malformed_field() -> None:
    fields: list[tuple[str, object, str]] = [
        ("mass_kg", -1.0, "mass_kg"),
        ("mass_kg", float("nan"), "mass_kg"),
        ("mass_kg", "heavy", "mass_kg"),
        ("mass_kg", 10**400, "mass_kg"),
        ("mass_kg", 1e200, "mass_kg"),
        ("name", "x", "name"),
        ("mass_kg", 50.0, "thrust_coefficient"),
        ("inertia_frd", [1.0, 2.0], "inertia_frd"),
        ("inertia_frd", [0.02, 0.02, 0.0], "inertia_frd"),
        ("inertia_frd", [0.02, 0.02, -0.04], "inertia_frd"),
        ("inertia_frd", [0.02, 0.02, 0.041], "inertia_frd"),  # no rigid body: 0.041 > 0.02 + 0.02
        ("inertia_frd", [0.07, 0.02, 0.04], "inertia_frd"),
        ("wings", 2, "wings"),
        ("rotors", [], "rotors"),
        ("curve", 3, "curve"),
        ("contact_points_frd", [[0, 0, 0]], "contact_points_frd"),
        ("contact_points_frd", [[x, y, -0.2] for x in (-1, 1) for y in (-1, 1)], "contact_points_frd"),  # all above
        ("contact_points_frd", [[x, y, 0.2] for x in (1, 2) for y in (-1, 1)], "contact_points_frd"),  # all in front
        ("contact_points_frd", [[x, 0, 0.2] for x in (-1, 0, 1)], "contact_points_frd"),  # in a line
        ("contact_points_frd", [[0, 0, 0.2]] * 3, "contact_points_frd"),  # a single point
        ("mav_type", 2.5, "mav_type"),
    ]
    for field, value, named in fields:
        table = tomllib.loads((FILES / "x500.toml").read_text(encoding="utf-8"))
        table[field] = value
        message = refusal(airframe.parse, table, "broken")
        assert named in message, message
        assert "\n" not in message


@pytest.mark.parametrize("key", ["cells", "capacity_ah"])
@pytest.mark.parametrize("value", [0, -1])
def test_a_battery_without_cells_or_capacity_is_rejected(key: str, value: int) -> None:
    table = tomllib.loads((FILES / "x500.toml").read_text(encoding="utf-8"))
    table["battery"][key] = value
    assert f"battery.{key}" in refusal(airframe.parse, table, "broken")


def test_rounded_moments_of_a_plate_and_three_feet_are_accepted() -> None:
    table = tomllib.loads((FILES / "x500.toml").read_text(encoding="utf-8"))
    table |= {
        "inertia_frd": [0.01, 0.02, 0.03],
        "contact_points_frd": [[0.1, 0, 0.2], [-0.1, 0.1, 0.2], [-0.1, -0.1, 0.2]],
    }
    assert airframe.parse(table, "fine").inertia_frd == (0.01, 0.02, 0.03)


def test_a_camera_pitch_outside_the_gimbal_range_is_rejected() -> None:
    table = tomllib.loads((FILES / "x500.toml").read_text(encoding="utf-8"))
    for gimbal in ({}, {"pitch_min_deg": 60.0, "pitch_max_deg": -60.0}):
        table["camera"] = {"pitch_deg": 45.0, "gimbal": gimbal}
        assert "pitch_deg" in refusal(airframe.parse, table, "broken")
    table["camera"] = {"pitch_deg": 30.0, "gimbal": {}}
    assert airframe.parse(table, "fine").camera.pitch_deg == 30.0


def test_the_error_names_a_missing_field() -> None:
    table = tomllib.loads((FILES / "x500.toml").read_text(encoding="utf-8"))
    del table["curve"]["radius_m"]
    with pytest.raises(UsageError, match=r"curve\.radius_m"):
        airframe.parse(table, "broken")


_VALUES = st.recursive(
    st.none() | st.booleans() | st.integers(-3, 3) | st.floats() | st.text(max_size=3),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=8,
)


@settings(max_examples=200, deadline=None)
@given(st.data())
def test_any_field_value_loads_or_raises_a_usage_error(data: st.DataObject) -> None:
    table = tomllib.loads((FILES / "x500.toml").read_text(encoding="utf-8"))
    place = data.draw(st.sampled_from([table, table["curve"], table["battery"], table["rotors"][0]]))
    place[data.draw(st.sampled_from(sorted(place)))] = data.draw(_VALUES)
    try:
        frame = airframe.parse(table, "odd")
    except UsageError:
        return
    assert frame.thrust_max > frame.mass_kg * GRAVITY
