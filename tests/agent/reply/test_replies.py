"""Both parsers give the result that the table states, for each of its replies."""

from dronecats.agent.reply.mends import MENDS
from dronecats.agent.reply.reading import reading
from tests.agent.reply.table import agrees, rows, words

ROWS = rows()


def test_both_parsers_agree_with_the_table():
    for row in ROWS:
        strict = reading(row.text, row.drones, row.axis_order, "strict")
        lenient = reading(row.text, row.drones, row.axis_order, "lenient")
        assert [
            words(result) for result, expected in zip(strict, row.strict, strict=True) if not agrees(result, expected)
        ] == [], row
        assert [
            words(result) for result, expected in zip(lenient, row.lenient, strict=True) if not agrees(result, expected)
        ] == [], row
        assert all(result.mended == () for result in strict), row
        assert tuple(result.mended for result in lenient) == row.mended, row


def test_the_table_covers_every_repair_code():
    assert {code for row in ROWS for codes in row.mended for code in codes} == set(MENDS)
