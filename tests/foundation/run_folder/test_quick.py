"""The fast reader and the strict reader agree: for any damage, they return the same rows or the same error."""

import json
from dataclasses import fields
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from foundation.errors import UsageError
from foundation.run_folder import reading
from foundation.run_folder.reading import LONG, fast_reader, fast_reader_of_kinds, parse_row
from foundation.run_folder.rows import TRUTH_ROWS, Decision
from foundation.typed_file import LARGE
from tests.foundation.run_folder.test_schemas import ROWS

GOOD = [("truth.jsonl", row) for row, _ in ROWS["truth"]] + [("decisions.jsonl", row) for row, _ in ROWS["decisions"]]
WORDS = (
    "1e999", "-1e13", "1e12", "999999999999.9", "1.0", "-0", "-0.0", "01", "1.", "NaN", "-Infinity", "true", "null",
    "12345678901234567890", "9" * 60, "0." + "1" * 60, '"\\ud800"', '"\\udc00\\ud800"', '"\\ud83d\\ude00"', '"é"',
    '"\x01"', '"\\q"', "[]", "{}", "[1,2]", "[1,2,3]", "[1,2,1e13]", "[1,2,3,4]", '{"action":"go","a":[1e3,2E-400]}',
    '{"action":5}', '{"action":"finished","action":"think"}', '"pose"', '"end"', "'", "", " ", '"' + "x" * LONG + '"',
    "1" * 5000, "[" * 300 + "]" * 300, '"open',
)  # fmt: skip


@st.composite
def lines(draw):
    """Draw a valid log line, or a line with a changed value, duplicate or missing keys, or changed bytes."""
    file, row = draw(st.sampled_from(GOOD))
    parts = [f"{json.dumps(key)}: {json.dumps(value)}" for key, value in row.items()]
    for _ in range(draw(st.integers(0, 2))):
        key = draw(st.sampled_from([*row, "added", "kind", "\\ud800"]))
        part = f'"{key}": {draw(st.sampled_from(WORDS))}'
        at = draw(st.integers(0, len(parts)))
        parts[at : at + draw(st.integers(0, 1))] = [part]
    gap = draw(st.sampled_from([", ", ", ", ",", " ,\t"]))
    text = bytearray(f"{{{gap.join(parts)}}}".encode())
    for _ in range(draw(st.sampled_from([0, 0, 0, 1, 2]))):
        text[draw(st.integers(0, len(text) - 1))] = draw(st.integers(0, 255))
    end = draw(st.sampled_from([None, None, None, 3, -1, -2]))
    return file, bytes(text[:end])


def read_result(folder) -> Any:
    try:
        logs = reading.read(folder)
    except UsageError as damage:
        return str(damage)
    return repr(logs)  # repr distinguishes 0, 0.0 and -0.0


def strict_read_result(folder) -> Any:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(reading, "fast_reader", lambda row: lambda line: None)
        patch.setattr(reading, "fast_reader_of_kinds", lambda kinds: lambda line: None)
        return read_result(folder)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("quick")


@settings(max_examples=150, deadline=None)
@given(st.lists(lines(), min_size=1, max_size=3), st.booleans())
def test_both_readers_agree_on_random_lines(folder, made, whole):
    for file in ("truth.jsonl", "decisions.jsonl"):
        text = b"\n".join(line for of, line in made if of == file)
        (folder / file).write_bytes(text + b"\n" if whole else text)
    assert read_result(folder) == strict_read_result(folder)


def test_both_readers_agree_on_every_replaced_value(folder):
    (folder / "truth.jsonl").write_text("")
    for file, row in GOOD:
        (folder / "decisions.jsonl").write_text("")
        for key in row:
            for word in WORDS:
                parts = [f"{json.dumps(k)}: {word if k == key else json.dumps(row[k])}" for k in row]
                (folder / file).write_bytes(f"{{{', '.join(parts)}}}\n".encode())
                assert read_result(folder) == strict_read_result(folder), (key, word)
        (folder / file).write_text("")


def test_the_fast_reader_accepts_valid_lines():
    """If the fast reader returned None, the tests above would compare the strict reader with itself."""
    for name, rows in ROWS.items():
        for row, kind in rows:
            line = json.dumps({**row, "added": {"later": [1]}}).encode()
            read = fast_reader_of_kinds(TRUTH_ROWS) if name == "truth" else fast_reader(kind)
            assert read(line) == parse_row(row, kind)[0]


@pytest.mark.parametrize("row", [*TRUTH_ROWS.values(), Decision])
def test_the_fast_reader_rejects_numbers_that_are_too_large(row):
    """The fast reader relies on the type annotations alone; `damage.py` checks each value."""
    (good,) = [example for rows in ROWS.values() for example, kind in rows if kind is row][:1]
    read, looked_at = fast_reader(row), 0
    for field in fields(row):
        for value in (LARGE, -LARGE, [LARGE, 0.0, 0.0], [0.0, 0.0, -LARGE], [0.0, 0.0, 0.0, LARGE]):
            changed = {**good, field.name: value}
            if parse_row(changed, row)[0] is None:
                looked_at += 1
                assert read(json.dumps(changed).encode()) is None, field.name
    assert looked_at
