"""Typed files: contents must match the annotations. An error is one sentence with file, key and rule."""

from dataclasses import dataclass
from typing import Annotated, Any, Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import Meta

from foundation.errors import UsageError
from foundation.typed_file import json_of, toml_table, typed
from tests.support.refusal import refusal

Share = Annotated[float, Meta(ge=0.0, le=1.0)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Wheel:
    """A part of a cart."""

    place: tuple[float, float, float]
    radius_m: Annotated[float, Meta(gt=0.0)]
    spokes: Annotated[int, Meta(ge=0, le=99)] = 12


@dataclass(frozen=True, slots=True, kw_only=True)
class Cart:
    """The contents of a file."""

    name: Annotated[str, Meta(pattern="^[a-z]+$", extra={"wrong": "may hold small letters only"})]
    paint: Literal["red", "green"] = "red"
    wheels: Annotated[tuple[Wheel, ...], Meta(min_length=1, max_length=4)]
    loads: dict[str, Share] | None = None
    open: bool = False
    pull: Annotated[float | tuple[Share, Share] | None, Meta(extra={"wrong": "is not a share or two"})] = None


WHEEL = {"place": [0, 1, 2], "radius_m": 0.3}
CART = {"name": "cart", "wheels": [WHEEL]}


def test_a_valid_table_becomes_the_dataclass():
    cart = typed({**CART, "loads": {"hay": 1}}, Cart, "cart.toml")
    assert cart == Cart(name="cart", wheels=(Wheel(place=(0.0, 1.0, 2.0), radius_m=0.3),), loads={"hay": 1.0})
    assert isinstance(cart.wheels[0].place[0], float)


WRONG: list[tuple[dict[str, Any], tuple[str, ...]]] = [
    ({"nane": 1}, ("'nane'", "'name'")),
    ({"zzzz": 1}, ("'zzzz'", "wheels", "loads")),
    ({"name": "Cart"}, ("'name'", "small letters")),
    ({"name": None}, ("'name'", "None")),
    ({"paint": "gren"}, ("'paint'", "'gren'", "green")),
    ({"paint": 3}, ("'paint'", "red, green")),
    ({"loads": None}, ("'loads'", "null")),
    ({"loads": {"hay": 2}}, ("'loads.hay'", "2", "0 … 1")),
    ({"loads": {"hay": float("nan")}}, ("'loads.hay'", "nan")),
    ({"wheels": []}, ("'wheels'", "1 … 4")),
    ({"wheels": 3}, ("'wheels'", "list")),
    ({"wheels": [3]}, ("'wheels[0]'", "3")),
    ({"wheels": [WHEEL, {"place": [0, 1, 2]}]}, ("'wheels[1].radius_m'", "missing")),
    ({"wheels": [{**WHEEL, "radius": 1}]}, ("'wheels[0].radius'", "'radius_m'")),
    ({"wheels": [{**WHEEL, "radius_m": 0}]}, ("'wheels[0].radius_m'", "above 0")),
    ({"wheels": [{**WHEEL, "radius_m": float("inf")}]}, ("'wheels[0].radius_m'", "inf")),
    ({"wheels": [{**WHEEL, "radius_m": True}]}, ("'wheels[0].radius_m'", "not a number")),
    ({"wheels": [{**WHEEL, "radius_m": 10**400}]}, ("'wheels[0].radius_m'",)),
    ({"wheels": [{**WHEEL, "spokes": 100}]}, ("'wheels[0].spokes'", "100", "0 … 99")),
    ({"wheels": [{**WHEEL, "spokes": 1 << 20000}]}, ("'wheels[0].spokes'", "0 … 99")),
    ({"wheels": [{**WHEEL, "spokes": 1.5}]}, ("'wheels[0].spokes'", "whole")),
    ({"wheels": [{**WHEEL, "place": [1, 2]}]}, ("'wheels[0].place'", "3")),
    ({"wheels": [{**WHEEL, "place": [1, 2, "x"]}]}, ("'wheels[0].place[2]'", "'x'")),
    ({"pull": [0.5, 2]}, ("'pull'", "a share or two", "[0.5, 2]")),
    ({"pull": "x"}, ("'pull'", "a share or two")),
    ({"open": 1}, ("'open'", "true nor false")),
]


@pytest.mark.parametrize(("changed", "words"), WRONG, ids=[words[0] + str(k) for k, (_, words) in enumerate(WRONG)])
def test_errors_are_one_sentence_with_file_key_and_rule(changed, words):
    message = refusal(typed, {**CART, **changed}, Cart, "cart.toml")
    assert [word for word in ("cart.toml", *words) if word not in message] == [], message
    assert "\n" not in message


def test_invalid_tables_are_rejected():
    nothing: list[Any] = [3, None, [], "x", {}]
    for value in nothing:
        assert "cart.toml" in refusal(typed, value, Cart, "cart.toml")


values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=3),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from(["name", "place", "x"]), inner),
    max_leaves=6,
)


@given(st.sampled_from([*Cart.__dataclass_fields__]), values)
def test_any_value_is_accepted_or_rejected_with_one_short_sentence(key, value):
    try:
        read: Cart | str = typed({**CART, key: value}, Cart, "cart.toml")
    except UsageError as error:
        read = str(error)
    if isinstance(read, str):
        assert read.startswith("cart.toml: ")
        assert "\n" not in read
        assert len(read) < 300


def test_an_unreadable_file_is_rejected_with_one_sentence(tmp_path):
    path = tmp_path / "cart"
    for data in (b"[m", b"\xff\xfe", b"a = " + b"9" * 5000, b"a = " + b"[" * 5000, b"#" * 1_000_001):
        path.write_bytes(data)
        message = refusal(toml_table, path, "cart.toml")
        assert message.startswith("cart.toml ")
        assert "\n" not in message
    for data in (b"", b"{", b"\xff\xfe", b"9" * 5000, b"[" * 5000, b'{"a": 1, "a": 1}', b"NaN", b" " * 1_000_001):
        message = refusal(json_of, data, "cart.json")
        assert message.startswith("cart.json")
        assert "\n" not in message
    assert "gone.toml" in refusal(toml_table, tmp_path / "gone.toml", "--cart gone.toml")
    assert str(tmp_path) in refusal(toml_table, tmp_path, f"--cart {tmp_path}")
