"""Flights with disturbances have their own row, and the report states the disturbance above the tables."""

from dronecats.report.report_data import entrants
from dronecats.report.report_folder import opening
from dronecats.report.tables.setup import setup
from foundation.protocol import RADIUS_M
from tests.report.small import line, made, small
from tests.support.scores import a_run, collected, flights

LATE = "pictures come 0.5 s late"


def disturbed():
    """Return flights of one pilot, undisturbed and with late images."""
    late = a_run("runs/late", flight={"disturbances": {"frame": {"delay_s": 0.5}}}, disturbed=LATE)
    return collected(flights(a_run("runs/plain"), {"campus-approaching": "ss"}),
                     flights(late, {"campus-approaching": "sf"}))  # fmt: skip


def test_disturbed_and_undisturbed_flights_of_a_pilot_have_separate_rows():
    assert [entrant.label for entrant in entrants(disturbed())] == ["vision", f"vision, {LATE}"]


def test_a_disturbance_is_stated_above_the_tables_and_in_the_setup_table():
    data = small(disturbed())
    (sentence,) = (sentence for sentence in opening(data, RADIUS_M) if LATE in sentence)
    assert sentence.startswith(f"vision, {LATE} ")
    table = made(setup, data)
    assert line(table, f"vision, {LATE}")["disturbed"].value == LATE
    assert line(table, "vision")["disturbed"].value is None
    plain = small()
    assert not [sentence for sentence in opening(plain, RADIUS_M) if LATE in sentence]
    assert "disturbed" not in [column.name for column in made(setup, plain).columns]


def test_the_setup_table_names_the_prompt_before_its_digest():
    named = a_run("runs/paper", prompt_name="paper", prompt_sha256="c" * 64)
    table = made(setup, small(collected(flights(named, {"campus-approaching": "s"}))))
    assert line(table, "vision")["prompt"].value == "paper, cccccccc"
