"""A reader returns fields of a numpy record as plain Python numbers, with their current values."""

import numpy as np
import pytest

from foundation.record_reader import reader

RECORD = np.dtype(
    [("time_us", "i8"), ("place", "f8", (3,)), ("short", "i4"), ("turn", "f8", (2, 2)), ("count", "i8")], align=True
)


def test_the_reader_returns_current_values_as_plain_numbers():
    record = np.zeros(1, RECORD)[0]
    read = reader(record, "place", "turn", "count")
    record["place"], record["turn"], record["count"] = (1.5, -2.0, 0.1), ((1.0, 2.0), (3.0, 4.0)), 7
    assert read() == (1.5, -2.0, 0.1, 1.0, 2.0, 3.0, 4.0, 7)
    record["count"] = -1
    assert read()[-1] == -1
    assert isinstance(read()[-1], int)


def test_a_field_of_a_nested_record_is_read():
    outer = np.zeros(1, np.dtype([("first", "f8"), ("inner", RECORD)]))[0]
    read = reader(outer["inner"], "time_us")
    outer["inner"]["time_us"] = 20_000
    assert read() == (20_000,)


@pytest.mark.parametrize("names", [("short",), ("count", "place"), ("place", "place")])
def test_unreadable_fields_are_rejected(names):
    with pytest.raises(ValueError):
        reader(np.zeros(1, RECORD)[0], *names)
