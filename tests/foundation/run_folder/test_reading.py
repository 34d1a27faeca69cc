"""The strict reader ignores unknown fields, names invalid values, and rejects newer formats."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dronecats.judge.episode import write_verdict
from dronecats.pilots.scripted import replies
from dronecats.report.recorded.run import recorded_run
from foundation.errors import UsageError
from foundation.run_folder import layout, reading
from foundation.run_folder.folder import create, write_run
from foundation.run_folder.reading import parse_row
from foundation.run_folder.results import Result
from foundation.run_folder.rows import Begin, Decision
from foundation.run_folder.writing import LineLog, as_json
from tests.support.refusal import refusal

ROW = {"step": 0, "drone": 0, "frame_id": 0, "t_frame": 1.0, "t_decided": 1.5, "action": {"action": "finished"}}


@pytest.fixture
def episode(tmp_path):
    with create(tmp_path / "run", "oracle", "e-01", {"seed": 1}) as folder:
        pass
    (folder / layout.TRUTH).write_text('{"kind": "begin", "t0_us": 5}\n')
    (folder / layout.DECISIONS).write_text(json.dumps(ROW) + "\n")
    return folder


def of_version(episode, version):
    path = episode.parent / layout.RUN
    run = json.loads(path.read_text())
    path.write_text(json.dumps({**{k: v for k, v in run.items() if k != "schema"}, **version}))


def test_a_run_records_its_schema_version_and_runs_without_one_are_readable(episode):
    assert json.loads((episode.parent / layout.RUN).read_text())["schema"] == reading.SCHEMA == 1
    assert reading.read(episode).decisions[0].declares
    of_version(episode, {})  # runs from before schema versions existed
    assert reading.read(episode).begin == Begin(t0_us=5)


@pytest.mark.parametrize(("schema", "word"), [(2, "newer"), ("1", "version"), (True, "version")])
def test_every_reader_and_writer_rejects_a_run_of_an_unknown_version(episode, schema, word):
    of_version(episode, {"schema": schema})
    run = episode.parent
    before = (run / layout.RUN).read_bytes()
    for at_it in (
        lambda: reading.read(episode),
        lambda: recorded_run(run),
        lambda: recorded_run(episode),
        lambda: create(run, "oracle", "e-02", {"seed": 1}).__enter__(),
        lambda: write_run(run, {"seed": 1}),
    ):
        message = refusal(at_it)
        assert word in message
        assert "\n" not in message
    assert (run / layout.RUN).read_bytes() == before


def test_unknown_kinds_and_fields_are_ignored(episode):
    with (episode / layout.TRUTH).open("a") as file:
        file.write('{"kind": "wind", "t": "gusty"}\n{"kind": "end", "t": 9, "reason": "cap", "mood": []}\n')
    logs = reading.read(episode)
    assert logs.end is not None
    assert (logs.end.t, logs.end.reason) == (9.0, "cap")


def test_an_error_names_the_file_the_line_and_the_field(episode):
    path = episode / layout.DECISIONS
    for field, value in (
        ("t_frame", "1"), ("reply", None), ("action", {}), ("thinking", 1), ("tokens_in", 2.5), ("latency_s", 1e12),
    ):  # fmt: skip
        path.write_text(json.dumps(ROW) + "\n" + json.dumps({**ROW, field: value}) + "\n")
        message = refusal(reading.read, episode)
        assert [word for word in (f"{path} line 2", field) if word not in message] == [], message
    path.write_text('{"step": 0}\n')
    with pytest.raises(UsageError, match=r"line 1 .*\bdrone\b"):
        reading.read(episode)


def test_nan_and_infinity_are_invalid_json(episode):
    row = json.dumps({**ROW, "action": {"action": "go", "depth_m": float("nan")}, "added": float("inf")})
    (episode / layout.DECISIONS).write_text(row + "\n")
    with pytest.raises(UsageError, match=r"line 1 .*JSON"):
        reading.read(episode)


@given(st.text(st.characters(codec=None), max_size=20))
def test_any_reply_is_read_back_unchanged(tmp_path_factory, reply):
    """A reply may contain a lone surrogate: a model may send one, and JSON can hold it."""
    path = tmp_path_factory.mktemp("log") / layout.DECISIONS
    log = LineLog(path)
    log.write(Decision(**{**ROW, "reply": reply}))
    log.close()
    assert [d.reply for d in reading.rows(path, Decision)] == [reply] == replies(path)


@pytest.mark.parametrize("word", ["kind", "source"])
def test_a_lone_surrogate_in_a_keyword_is_damage(word):
    assert parse_row({"kind": "begin", "t0_us": 1, word: "\ud800"}, Begin)[0] is None


def test_numbers_that_are_too_large_are_damage():
    for value in (10**400, 1e12, -1e12, 1e308):
        assert "t_frame" in (parse_row({**ROW, "t_frame": value}, Decision)[1] or "")
    assert parse_row({"kind": "begin", "t0_us": 10**18}, Begin)[0] == Begin(t0_us=10**18)  # a clock may have any epoch


def test_a_stored_verdict_is_read_as_a_result_and_an_incomplete_one_is_damage(episode):
    verdict = write_verdict(episode)
    result = reading.stored_result("e-01", episode)
    assert (result.episode, result.outcome, result.declarations) == ("e-01", verdict.outcome, 1)
    (episode / layout.VERDICT).write_text('{"outcome": "solved"}')
    with pytest.raises(UsageError, match=r"verdict\.json.*outcome"):
        reading.stored_result("e-01", episode)


def test_a_result_survives_conversion_to_json_and_back():
    result = Result(episode="e", outcome="failure", steps=3, success_at_first=False, reason="cap", status=0)
    assert reading.result_of(json.loads(json.dumps(result.as_json()))) == result
    assert "distances" not in as_json(result)
