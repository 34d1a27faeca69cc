"""Episode records round-trip. The loader rejects invalid records with one sentence and agrees with the schema."""

import copy
import json
import re
import tracemalloc
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from episodes import maps
from episodes.maps import assets
from episodes.records import catalogue
from episodes.records import record as records
from episodes.records.record import EpisodeRecord, parse
from foundation.errors import UsageError

SCHEMA = json.loads((Path(records.__file__).parent / "record.schema.json").read_text())
BASE = json.loads(catalogue.load("residential-approaching-01").to_json())
NATIVE = {"asset": "bench", "native": "bench-12", "position_ned": [4.0, 5.0, -0.1], "yaw_deg": 90.0}
TRACKING = json.loads(catalogue.load("residential-tracking-01").to_json())


def read(document: object) -> EpisodeRecord:
    return parse(json.dumps(document), "e.json")


def changed(document: dict[str, Any], path: tuple[Any, ...], value: object) -> dict[str, Any]:
    result = copy.deepcopy(document)
    place = result
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    return result


def refusal(data: bytes | str) -> str:
    with pytest.raises(UsageError) as caught:
        parse(data, "e.json")
    text = str(caught.value)
    assert text.startswith("e.json")
    assert "\n" not in text
    assert len(text) < 400
    return text


def test_shipped_files_round_trip_to_the_same_bytes() -> None:
    files = sorted(path for folder in ("v1", "v2", "open") for path in (catalogue.RECORDS / folder).glob("*.json"))
    assert len(files) == 201
    for path in files:
        record = records.load(path)
        assert record.to_json().encode() == path.read_bytes(), path.name
        assert parse(record.to_json(), "again") == record


def test_a_commanding_record_round_trips() -> None:
    twin = {"asset": "sedan", "paint": "blue", "position_ned": [8, 2.7, 0], "yaw_deg": 0}
    others = [{**twin, "inscription": str(3218 + k)} for k in range(3)]
    document = {**BASE, "cell": "commanding", "target": {**twin, "inscription": "4017"}, "candidates": others}
    document["starts"] = [{"position_ned": [-10, 2 * k, -2], "yaw_deg": 0} for k in range(4)]
    record = read(document)
    assert [c.inscription for c in record.candidates] == ["3218", "3219", "3220"]
    assert parse(record.to_json(), "again") == record
    assert "candidates" in refusal(json.dumps({**document, "candidates": []}))


def test_the_error_names_the_invalid_field() -> None:
    for path, value, says in (
        (("target", "asset"), "suw", "target.asset"),
        (("target", "asset"), "../../etc/passwd", "target.asset"),
        (("target", "paint"), "mauve", "target.paint"),
        (("target", "yaw_deg"), "north", "target.yaw_deg"),
        (("target", "position_ned"), [0, 0], "target.position_ned"),
        (("target", "position_ned"), [0, 1e9, 0], "target.position_ned[1]"),
        (("target", "position_ned"), [0, True, 0], "target.position_ned[1]"),
        (("target", "inscription"), "<b>", "target.inscription"),
        (("starts",), [], "starts"),
        (("starts", 0, "yaw_deg"), 10**400, "starts[0].yaw_deg"),
        (("starts", 0, "hight"), 1, "starts[0].hight"),
        (("map",), "moon", "map"),
        (("cell",), "approching", "approaching"),
        (("id",), "../x", "id"),
        (("id",), "", "id"),
        (("instruction",), "go\n to", "instruction"),
        (("instruction",), "go\x7f\x9b2J", "instruction"),  # terminals interpret \x9b as a control sequence
        (("instruction",), "go\u2028to", "instruction"),  # a line break that is not ASCII
        (("instruction",), "x" * 501, "instruction"),
        (("version",), 2, "version"),
        (("start_distance_m",), float("inf"), "Infinity"),
        (("seed",), -1, "seed"),
        (("seed",), 1.5, "seed"),
        (("start_distance_m",), 1e3, "start_distance_m"),
        (("visible_at_start",), 1, "visible_at_start"),
        (("visible_at_start",), False, "visible_at_start"),
        (("target", "path"), {"waypoints_ned": [[0, 0, 0], [9, 0, 0]], "speed_mps": 1}, "target.position_ned"),
        (("targett",), {}, "'target'"),
    ):
        text = refusal(json.dumps(changed(BASE, path, value)))
        assert says in text, path


def test_the_error_names_a_missing_field() -> None:
    for name in [f for f in EpisodeRecord.__dataclass_fields__ if f != "candidates"]:
        document = {k: v for k, v in BASE.items() if k != name}
        assert f"'{name}'" in refusal(json.dumps(document)), name


def test_documents_that_are_not_records_are_rejected() -> None:
    for text, says in (
        ("", "JSON"),
        ("[]", "episode record"),
        ("null", "episode record"),
        ('{"version": NaN}', "NaN"),
        ('{"version": -Infinity}', "Infinity"),
        ('{"id": "a", "id": "b"}', "twice"),
        ("[" * 100_000, "nested"),
        ('{"a":' * 13 + "1" + "}" * 13, "nested"),
        ("9" * 5000, "digits"),
        (b"\xff\xfe{}", "UTF-8"),
        (" " * 1_000_001, "1000000 bytes"),
        ('{"version": 1e999}', "'version'"),
    ):
        assert says in refusal(text), text


def test_only_moving_cells_have_a_target_path() -> None:
    assert "target.path" in refusal(json.dumps({**BASE, "cell": "tracking"}))
    assert "target.path" in refusal(json.dumps({**TRACKING, "cell": "approaching"}))
    still = changed(TRACKING, ("target", "path", "waypoints_ned"), [[0, 0, 0], [0, 0, 0]])
    assert "repeats" in refusal(json.dumps(still))


def test_a_native_target_round_trips_with_its_name_and_asset() -> None:
    record = read({**BASE, "target": NATIVE})
    assert (record.target.native, record.target.asset, record.target.paint) == ("bench-12", "bench", None)
    assert parse(record.to_json(), "again") == record
    jsonschema.validate(json.loads(record.to_json()), SCHEMA)


def test_loader_and_schema_reject_invalid_native_targets() -> None:
    for target, says in (
        ({**NATIVE, "paint": "red"}, "target.paint"),
        ({**NATIVE, "inscription": "A 1"}, "target.inscription"),
        ({**NATIVE, "path": {"waypoints_ned": [[0, 0, 0], [9, 0, 0]], "speed_mps": 1}}, "target.path"),
        ({**NATIVE, "native": "../../etc/passwd"}, "target.native"),
        ({**NATIVE, "native": 7}, "target.native"),
        ({**NATIVE, "asset": "Bench!"}, "target.asset"),
        ({k: v for k, v in NATIVE.items() if k != "yaw_deg"}, "target.yaw_deg"),
        ({k: v for k, v in NATIVE.items() if k != "native"}, "target.paint"),
    ):
        document = {**BASE, "target": target}
        assert f"'{says}'" in refusal(json.dumps(document)), target
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(document, SCHEMA)


def test_a_file_of_a_gigabyte_is_rejected_without_reading_it_into_memory(tmp_path: Path) -> None:
    file = tmp_path / "vast.json"
    with file.open("wb") as out:
        out.truncate(10**9)
    tracemalloc.start()
    try:
        with pytest.raises(UsageError, match=r"vast\.json.* 1000000 bytes"):
            catalogue.load(file)
        assert tracemalloc.get_traced_memory()[1] < 10_000_000
    finally:
        tracemalloc.stop()


def test_a_sign_cannot_be_a_moving_target() -> None:
    if "sign" in assets.names():
        assert "'target.path'" in refusal(json.dumps(changed(TRACKING, ("target", "asset"), "sign")))


def test_a_big_file_is_not_parsed(tmp_path: Path) -> None:
    file = tmp_path / "big.json"
    file.write_bytes(b"[" * 3_000_000)
    with pytest.raises(UsageError, match=r"big\.json.* 1000000 bytes"):
        records.load(file)
    with pytest.raises(UsageError, match=str(tmp_path)):
        records.load(tmp_path)


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4),
    max_leaves=12,
)
places = [
    ("version",), ("id",), ("map",), ("map_seed",), ("cell",), ("instruction",), ("target",), ("target", "asset"),
    ("target", "yaw_deg"), ("target", "native"), ("target", "paint"), ("target", "path"),
    ("target", "position_ned"), ("target", "position_ned", 2), ("starts",), ("starts", 0),
    ("starts", 0, "position_ned"), ("starts", 0, "yaw_deg"), ("seed",), ("bearing_deg",), ("candidates",), ("extra",),
]  # fmt: skip


@settings(max_examples=100, deadline=None)
@given(path=st.sampled_from(places), value=json_values)
def test_the_schema_accepts_every_record_that_the_loader_accepts(path: tuple[Any, ...], value: object) -> None:
    document = changed(BASE, path, value)
    try:
        read(document)
    except UsageError:
        return
    jsonschema.validate(document, SCHEMA)  # the loader is stricter than the schema (cells, control characters)


@settings(max_examples=100, deadline=None)
@given(st.binary(max_size=200) | st.text(max_size=200))
def test_any_invalid_input_is_rejected_with_one_sentence(data: bytes | str) -> None:
    refusal(data)


def test_the_published_schema_matches_the_types(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert records.schema() == SCHEMA
    assert list(records.schema()["properties"]) == list(SCHEMA["properties"])
    word = re.compile(SCHEMA["$defs"]["name"]["pattern"])
    assert all(word.fullmatch(name) for name in maps.names())
    before = records.SCHEMA_FILE.read_bytes()
    records.write_schema()
    assert records.SCHEMA_FILE.read_bytes() == before  # write_schema keeps the hand-made layout
    monkeypatch.setattr(records, "SCHEMA_FILE", tmp_path / "record.schema.json")
    records.SCHEMA_FILE.write_text("{}")
    records.write_schema()
    assert json.loads(records.SCHEMA_FILE.read_text()) == SCHEMA


def test_bounds_of_schema_and_loader_agree() -> None:
    cases: list[tuple[tuple[Any, ...], float]] = [
        (("start_distance_m",), 300), (("start_distance_m",), 0), (("bearing_deg",), 360), (("bearing_deg",), 0),
        (("seed",), 2**31 - 1), (("seed",), 0), (("target", "yaw_deg"), 360), (("target", "yaw_deg"), -360),
        (("starts", 0, "position_ned", 1), 1000), (("starts", 0, "position_ned", 1), -1000),
    ]  # fmt: skip
    for path, bound in cases:
        inside = changed(BASE, path, bound)
        read(inside)
        jsonschema.validate(inside, SCHEMA)
        outside = changed(BASE, path, bound + (1 if bound > 0 else -1))
        refusal(json.dumps(outside))
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(outside, SCHEMA)


def test_catalogue_finds_ids_files_and_folders(tmp_path: Path) -> None:
    record = catalogue.load(catalogue.DEFAULT)
    (tmp_path / "episode.json").write_text(record.to_json())
    assert catalogue.load(tmp_path) == record
    assert catalogue.load(tmp_path / "episode.json") == record
    assert all(catalogue.load(name).id == name for name in catalogue.ids())


def test_the_catalogue_rejects_invalid_names() -> None:
    for name in ("residential-aproaching-01", "", "../records", "a" * 5000, "x\0y", "no/such.json"):
        with pytest.raises(UsageError) as caught:
            catalogue.load(name)
        assert len(str(caught.value)) < 400, name


def test_the_catalogue_suggests_a_similar_id() -> None:
    with pytest.raises(UsageError, match="residential-approaching-01"):
        catalogue.load("residential-aproaching-01")
