"""The table of the benchmark `commanding`."""

from benchmarks.commanding import CommandedFlight, table


def test_pilot_and_commander_have_their_own_columns():
    flight = CommandedFlight(
        outcome="success", declarations=1, steps=2, seconds=3.0, questions=4, question_tokens=5, commanded=6,
        commanded_tokens=7,
    )  # fmt: skip
    header, _, row = table({"hierarchical": [flight]}).splitlines()
    cells = dict(zip(header.split(" | "), row.split(" | "), strict=True))
    assert (cells["questions"], cells["tokens"], cells["to the commander"]) == ("4.0", "5", "6.0")
