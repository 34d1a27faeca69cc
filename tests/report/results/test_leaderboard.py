"""Tests the leaderboard: only verified entries, and separate tables for built-in pilots and models."""

import json
import re
from dataclasses import replace

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dronecats.pilots.oracle.failing import FAILURES
from dronecats.report.leaderboard.leaderboard import entry, page
from dronecats.report.leaderboard.verification import VERSION_KEY, CellScore, Verification
from dronecats.report.report_data import pilot_description
from episodes.records.catalogue import VERSION
from foundation.errors import UsageError
from tests.docs.pages import ROOT

ENTRIES = sorted((ROOT / "docs" / "leaderboard").glob("*.json"))


def cell(successes: int, scored: int) -> CellScore:
    return CellScore(
        scored=scored, successes=successes, oracle_successes=successes, declared=scored, unscored=0, ne_m=1.0
    )


ONE = Verification(
    name="One", note="", pilot="openai/one", is_model=True, suite="one-drone", partial=None, flights=1, steps=9,
    settings={"latency": "fixed:0.5"}, cells={"approaching": cell(13, 20), "searching": cell(8, 20)},
    interval=(0.375, 0.671), identity="0" * 64,
    archive_sha256="a" * 64, archive_bytes=7, dronecats="0.1.0", verified=True, differences=(), checked=(),
    unchecked=(),
)  # fmt: skip
OURS = replace(ONE, name="Ours", pilot="oracle", is_model=False, archive_sha256="b" * 64)


def test_the_page_matches_the_stored_entries():
    """`dronecats leaderboard docs/leaderboard/*.json --out docs/leaderboard.md` regenerates it."""
    assert ENTRIES
    assert (ROOT / "docs" / "leaderboard.md").read_text(encoding="utf-8") == page(map(entry, ENTRIES))


def tables(page_text: str) -> list[list[str]]:
    """Return the names of the entries in each table of a page, one table per heading."""
    rows = (
        re.findall(r"^\| \[(\w+)\]", part, re.MULTILINE) for part in re.split(r"^#+ ", page_text, flags=re.MULTILINE)
    )
    return [names for names in rows if names]


def test_a_built_in_pilot_is_never_among_models():
    page_text = page([OURS, ONE])
    assert tables(page_text) == [["One"], ["Ours"]]
    assert "`oracle`" in page_text
    assert "`openai/one`" in page_text


def test_rates_are_percent_with_the_entrys_interval():
    row = next(line for line in page([ONE]).splitlines() if line.startswith("| [One]"))
    assert re.findall(r"[\d.]+", row.partition(") | ")[2]) == ["1", "65.0", "40.0", "52.5", "40", "37.5", "67.1"]


def test_better_entries_come_first_and_partial_entries_have_their_own_table():
    better = replace(ONE, name="Two", cells={"approaching": cell(19, 20)}, archive_sha256="c" * 64)
    partial = replace(better, name="Three", partial="some are missing", archive_sha256="d" * 64)
    assert tables(page([ONE, partial, better])) == [["Two", "One"], ["Three"]]
    assert "some are missing" in page([partial])


def test_an_earlier_version_has_its_own_table():
    present = replace(ONE, name="Present", archive_sha256="c" * 64, settings={VERSION_KEY: VERSION})
    assert tables(page([ONE, present])) == [["Present"], ["One"]]


def test_no_table_holds_two_agents():
    steady = replace(
        ONE, name="Steady", archive_sha256="c" * 64, settings={"agent": "dronecats.run.steady.steady_agent"}
    )
    papers = replace(
        ONE, name="Papers", archive_sha256="d" * 64, settings={"agent": "dronecats.run.pilot.papers_agent"}
    )
    assert tables(page([steady, papers, ONE])) == [["One", "Papers"], ["Steady"]]


def test_unverified_and_duplicate_entries_are_rejected():
    with pytest.raises(UsageError, match=r"One.*a\.json"):
        page([replace(ONE, verified=False, differences=("a.json differs",))])
    with pytest.raises(UsageError, match="One"):
        page([ONE, ONE])


def test_every_pilot_has_a_description():
    for pilot in ("oracle", "vision", "blind", "blind:fan", "recorded:x", *(f"failing:{f}" for f in FAILURES)):
        assert pilot_description(pilot), pilot


def test_a_file_without_an_entry_is_rejected(tmp_path):
    for data in (b"", b"[]", b"{}", b'{"name": 1}', b"\xff"):
        (tmp_path / "x.json").write_bytes(data)
        with pytest.raises(UsageError, match=r"x\.json"):
            entry(tmp_path / "x.json")
    with pytest.raises(UsageError, match=r"nowhere\.json"):
        entry(tmp_path / "nowhere.json")


def test_an_entry_survives_a_json_round_trip(tmp_path):
    (tmp_path / "x.json").write_bytes(msgspec.json.encode(ONE))
    assert json.loads((tmp_path / "x.json").read_text())["cells"]["approaching"]["successes"] == 13
    assert entry(tmp_path / "x.json") == ONE


@given(name=st.text(st.characters(codec="utf-8"), min_size=1, max_size=30), note=st.text(max_size=40))
def test_names_and_notes_are_plain_text(name, note):
    """A name or a note cannot add a table, link, heading or HTML to the page."""
    page_text = page([replace(ONE, name=name, note=note)])
    plain = page([replace(ONE, name="x", note="y")])
    for mark in (r"^#", r"^\|", r"(?<!\\)\[", r"(?<!\\)<", r"(?<!\\)`", r"(?<!\\)\|"):
        assert len(re.findall(mark, page_text, re.MULTILINE)) == len(re.findall(mark, plain, re.MULTILINE)), mark


def test_each_entry_is_linked_from_its_row():
    page_text = page([replace(ONE, name="A b_c: d (x)"), OURS])
    anchors = {
        re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-")
        for heading in re.findall("^#+ (.+)$", page_text, re.M)
    }
    links = set(re.findall(r"\]\(#([^)]+)\)", page_text))
    assert len(links) == 2
    assert links <= anchors
