"""Each reply of the table is read as it says, by both parsers."""

from dronecats.agent.reply.mends import MENDS
from dronecats.agent.reply.reading import reading
from tests.agent.reply.table import agrees, rows, words

ROWS = rows()


def test_both_read_it_as_the_table_says():
    for row in ROWS:
        strict = reading(row.text, row.drones, row.axis_order, "strict")
        lenient = reading(row.text, row.drones, row.axis_order, "lenient")
        assert [words(one) for one, said in zip(strict, row.strict, strict=True) if not agrees(one, said)] == [], row
        assert [words(one) for one, said in zip(lenient, row.lenient, strict=True) if not agrees(one, said)] == [], row
        assert all(one.mended == () for one in strict), row
        assert tuple(one.mended for one in lenient) == row.mended, row


def test_the_table_knows_every_code():
    assert {code for row in ROWS for each in row.mended for code in each} == set(MENDS)
