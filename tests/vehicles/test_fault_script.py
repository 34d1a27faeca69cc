"""Fault scripts: a vehicle has the faults of a file, and an invalid file is a one-line error."""

from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from foundation.errors import UsageError
from tests.support.refusal import refusal
from tests.vehicles.fleet import vehicle
from vehicles.fault_script import load, parse
from vehicles.faults import KINDS, PARTS, Fault
from vehicles.sensors import Suite

SCRIPT = """
[[fault]]
part = "gps"
kind = "fail"
from_s = 0.4
until_s = 1.2

[[fault]]
part = "gyro"
kind = "bias"
value = [0.1, 0, -0.2]

[[fault]]
part = "rotor2"
kind = "weaken"
from_s = 30
value = 0.5
"""


def test_a_gps_fault_that_exceeds_the_queue_together_with_the_delay_of_the_sensors_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "script.toml"
    path.write_text('[[fault]]\npart = "gps"\nkind = "delay"\nvalue = 0.6\n', encoding="utf-8")
    assert load(path, rotors=4)
    with pytest.raises(UsageError, match=r"script.toml, entry 1: .*the delay must be 0 to 0\.\d+ s, not 0.6 s"):
        load(path, 4, Suite().degraded(gps_delay_s=1.0))


def test_a_file_is_parsed_into_its_faults(tmp_path: Path) -> None:
    path = tmp_path / "script.toml"
    path.write_text(SCRIPT, encoding="utf-8")
    assert load(path, rotors=4) == [
        Fault("gps", "fail", 400_000, 1_200_000),
        Fault("gyro", "bias", value=(0.1, 0.0, -0.2)),
        Fault("rotor2", "weaken", 30_000_000, value=(0.5, 0.0, 0.0)),
    ]


def test_a_single_number_is_the_first_component_as_the_docs_state() -> None:
    (fault,) = parse({"fault": [{"part": "mag", "kind": "bias", "value": 0.02}]}, "script.toml", 4)
    assert fault.value == (0.02, 0.0, 0.0)


def test_a_vehicle_has_the_faults_of_the_file(tmp_path: Path) -> None:
    path = tmp_path / "script.toml"
    path.write_text(SCRIPT, encoding="utf-8")
    craft = vehicle(faults=load(path, rotors=4))
    craft.advance(1100)
    silent_since = int(craft.sensors["gps_time_us"])
    assert 0 < silent_since < 400_000
    craft.advance(600)
    assert int(craft.sensors["gps_time_us"]) > 1_200_000


def test_the_error_for_a_wrong_entry_names_file_entry_and_reason(tmp_path: Path) -> None:
    for entry, word in [
        ('part = "wing"\nkind = "fail"', "fail of wing"),
        ('part = "rotor5"\nkind = "fail"', "fail of rotor5"),
        ('part = "gps"\nkind = "explode"', "explode of gps"),
        ('part = "baro"\nkind = "delay"\nvalue = 0.2', "delay of baro"),
        ('part = "gps"\nkind = "delay"\nvalue = 60', "delay of gps"),
        ('part = "gps"\nkind = "bias"', "'value'"),
        ('part = "gps"\nkind = "fail"\nvalue = 1', "'value'"),
        ('part = "gps"\nkind = "bias"\nvalue = [1, 2]', "[1, 2]"),
        ('part = "gps"\nkind = "bias"\nvalue = nan', "nan"),
        ('part = "gps"\nkind = "fail"\nfrom_s = -1', "'from_s'"),
        ('part = "gps"\nkind = "fail"\nfrom_s = inf', "'from_s'"),
        ('part = "gps"\nkind = "fail"\nfrom_s = 5\nuntil_s = 5', "fail of gps"),
        ('part = "gps"\nkind = "fail"\nwhen = 5', "'when'"),
        ('kind = "fail"', "'part'"),
    ]:
        path = tmp_path / "bad.toml"
        path.write_text(f'[[fault]]\npart = "mag"\nkind = "freeze"\n\n[[fault]]\n{entry}\n', encoding="utf-8")
        message = refusal(load, path, rotors=4)
        assert [each for each in ("bad.toml", "entry 2", word) if each not in message] == [], message
        assert "\n" not in message, entry


def test_a_file_that_is_not_a_script_is_rejected(tmp_path: Path) -> None:
    path = tmp_path / "bad.toml"
    assert "bad.toml" in refusal(load, path, rotors=4)  # the file does not exist yet
    for text in ["[[fault]", "fault = 3", "fault = [1]", "[fault]\npart = 'gps'", "wind = 3", "\xff"]:
        path.write_text(text, encoding="latin-1")
        assert "bad.toml" in refusal(load, path, rotors=4), text


def test_more_faults_than_a_vehicle_can_hold_are_rejected() -> None:
    with pytest.raises(UsageError, match="17"):
        parse({"fault": [{"part": "gps", "kind": "fail"}] * 17}, "long.toml", 4)


values = st.one_of(
    st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=5), st.lists(st.floats(), max_size=4)
)
entries = st.dictionaries(st.sampled_from(["part", "kind", "from_s", "until_s", "value", "other"]), values) | st.builds(
    lambda part, kind, rest: {"part": part, "kind": kind} | rest,
    st.sampled_from(sorted(PARTS)),
    st.sampled_from(sorted(KINDS)),
    st.dictionaries(st.sampled_from(["from_s", "until_s", "value"]), values),
)


@settings(deadline=None)  # the first vehicle may have to be compiled
@given(st.lists(entries, max_size=4))
def test_any_table_gives_valid_faults_or_a_usage_error(listed: list[Any]) -> None:
    try:
        faults = parse({"fault": listed}, "any.toml", 4)
    except UsageError:
        return
    assert len(faults) == len(listed)
    assert vehicle(faults=faults).faults["count"] == len(listed)
