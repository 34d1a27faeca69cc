"""The published schemas agree with the rows and with the reader."""

import json
from typing import Any

import jsonschema
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from foundation.run_folder.reading import parse_row
from foundation.run_folder.rows import ESTIMATE_ROWS, TRUTH_ROWS, Decision
from foundation.run_folder.schema import FOLDER, published, text
from tests.foundation.run_folder.published import validator

PLACE = [1.0, 2.0, -2.0]
DECISION = {"step": 0, "drone": 0, "frame_id": 7, "t_frame": 1.0, "t_decided": 1.5, "reply": "{}", "error": None,
            "action": {"action": "go", "point": [500.0, 500.0], "depth_m": 4.0}, "latency_s": 0.5, "tokens_in": None,
            "tokens_out": 5, "thinking": False, "rate_hz": None, "mended": ["fence"]}  # fmt: skip
MEASURED = {"t": 1.0, "drone": 0, "position_ned": PLACE, "yaw_deg": 5.0, "target_ned": None, "distance_m": 3.0,
            "visible": True}  # fmt: skip
ROWS: dict[str, list[tuple[dict[str, Any], Any]]] = {
    "decisions": [(DECISION, Decision)],
    "truth": [
        ({"kind": "begin", "t": 0.0, "t0_us": 5, "cap_s": 300.0, "source": None}, TRUTH_ROWS["begin"]),
        ({"kind": "pose", **MEASURED}, TRUTH_ROWS["pose"]),
        ({"kind": "frame", "frame_id": 7, **MEASURED, "distance_box_m": 2.0, "target_frd": PLACE,
          "target_box": [400.0, 410.5, 600.0, 600.0]}, TRUTH_ROWS["frame"]),
        ({"kind": "hit", "t": 7.5, "drone": 1, "what": "house-25", "closing_speed": 1.2, "crash": True},
          TRUTH_ROWS["hit"]),
        ({"kind": "clear", "t": 9.5, "drone": 1, "contact_s": 1.5}, TRUTH_ROWS["clear"]),
        (
            {"kind": "reset", "t": 9.5, "drone": 1, "count": 2, "quantities": ["yaw", "height"], "yaw_deg": -87.0,
             "position_m": 0.1, "height_m": -2.0, "velocity_mps": 0.0},
            TRUTH_ROWS["reset"],
        ),
        ({"kind": "end", "t": 300.0, "reason": "cap", "error": None}, TRUTH_ROWS["end"]),
    ],
    "estimate": [
        ({"kind": "estimate", "source": "flight.tlog", "origin": PLACE, "target": {"std_m": 3.0, "altitude_m": None},
          "target_ned": PLACE}, ESTIMATE_ROWS["estimate"]),
        ({"kind": "pose", **MEASURED, "position_std_m": PLACE, "distance_std_m": 0.5}, ESTIMATE_ROWS["pose"]),
        ({"kind": "frame", "frame_id": 7, **MEASURED, "distance_std_m": None}, ESTIMATE_ROWS["frame"]),
    ],
}  # fmt: skip
PLACES = [(name, row, kind, key) for name, rows in ROWS.items() for row, kind in rows for key in row]
VALUES = st.one_of(
    st.none(), st.booleans(), st.integers(-2, 300), st.floats(-400, 400), st.text(max_size=3),
    st.lists(st.floats(-9, 9), min_size=2, max_size=4), st.dictionaries(st.sampled_from(["action", "x"]), st.text()),
)  # fmt: skip


def test_the_schema_files_are_up_to_date_with_the_rows():
    made = {name: text(schema) for name, schema in published().items()}
    assert made == {path.name: path.read_text() for path in FOLDER.iterdir()}, "run `make schemas`"


def accepted(name, value):
    try:
        validator(name).validate(value)
    except jsonschema.ValidationError:
        return False
    return True


def test_schema_and_reader_accept_valid_rows():
    for name, rows in ROWS.items():
        for row, kind in rows:
            assert accepted(name, {**row, "added": 1})
            assert parse_row({**row, "added": 1}, kind)[1] is None


@settings(deadline=None, max_examples=400)
@given(st.sampled_from(PLACES), VALUES, st.booleans())
def test_schema_and_reader_agree_on_any_changed_row(place, value, gone):
    name, row, kind, key = place
    if key in ("t_frame", "t_decided"):  # a schema cannot express the order of the two times
        value = 1.25 if isinstance(value, int | float) and not isinstance(value, bool) else value
    changed = {k: v for k, v in row.items() if k != key or not gone}
    if not gone:
        changed[key] = value
    if key == "kind" and changed.get("kind") != row["kind"]:
        assert not accepted(name, changed)
        return
    if isinstance(value, float) and value == int(value):
        return  # 5.0 is an integer for a schema, but not for the reader
    assert accepted(name, changed) == (parse_row(changed, kind)[1] is None)


@pytest.mark.parametrize("name", ["verdict", "result", "run"])
def test_every_field_with_a_unit_suffix_has_a_description(name):
    """The description of a field states the unit. This test only checks that the description exists."""
    for part in json.loads((FOLDER / f"{name}.schema.json").read_text())["$defs"].values():
        for field, schema in part["properties"].items():
            if field.endswith(("_m", "_s", "_deg", "_hz", "_ned")):
                assert schema.get("description"), field
