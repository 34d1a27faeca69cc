"""Each reply of the table is read as it says, by both parsers."""

import pytest

from dronecats.agent.reply.mends import MENDS
from dronecats.agent.reply.reading import reading
from tests.agent.reply.table import agrees, rows, words

ROWS = rows()


@pytest.mark.parametrize("row", ROWS, ids=str)
def test_both_read_it_as_the_table_says(row):
    strict = reading(row.text, row.drones, row.axis_order, "strict")
    lenient = reading(row.text, row.drones, row.axis_order, "lenient")
    assert [words(one) for one, said in zip(strict, row.strict, strict=True) if not agrees(one, said)] == []
    assert [words(one) for one, said in zip(lenient, row.lenient, strict=True) if not agrees(one, said)] == []
    assert all(one.mended == () for one in strict)
    assert tuple(one.mended for one in lenient) == row.mended


def test_the_table_knows_every_code_and_enough_replies():
    assert {code for row in ROWS for each in row.mended for code in each} == set(MENDS)
    assert len({row.text for row in ROWS}) >= 150
