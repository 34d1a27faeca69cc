"""A full disk produces one sentence and exit status 3, and leaves no half-written verdict."""

import json
import re
import resource
from contextlib import contextmanager

import pytest

from dronecats.cli.main import main
from dronecats.flight.run.episode import EpisodeEnd
from dronecats.flight.run.setup import fly_and_judge
from tests.support.command_line import last_object


@contextmanager
def file_sizes_limited(limit):
    """Limit every file of this process to `limit` bytes. Python ignores SIGXFSZ, so writes fail."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "decisions.jsonl").write_text(
        '{"step": 0, "drone": 0, "frame_id": 0, "t_frame": 4.5, "t_decided": 5.0, "action": {"action": "finished"}}\n'
    )
    (tmp_path / "truth.jsonl").write_text(
        '{"kind": "begin", "t": 0.0, "t0_us": 0}\n'
        '{"kind": "frame", "t": 4.5, "drone": 0, "frame_id": 0, "distance_m": 4.0, "visible": true}\n'
        '{"kind": "end", "t": 6.0, "reason": "decided"}\n'
    )
    return tmp_path


def concluded(folder, limit):
    """Return the result of a flight whose files may not grow beyond `limit` bytes after its end."""

    def afterwards(ending):
        (folder / "afterwards.json").write_text("x" * 5000)

    with file_sizes_limited(limit):
        return fly_and_judge(lambda: EpisodeEnd("decided", None, 6.0, 1.0, 1), folder, "e", "blind", afterwards)


def test_a_verdict_that_cannot_be_written_is_reported_and_returned(folder):
    result = concluded(folder, 100)
    assert (result["status"], result["outcome"]) == (3, "success")
    assert re.search(r"verdict\.json.*File too large", result["error"])
    assert not list(folder.glob("verdict.json*"))


def test_failures_after_the_verdict_do_not_affect_the_verdict(folder):
    result = concluded(folder, 4000)
    assert (result["status"], result["outcome"]) == (3, "success")
    assert "File too large" in result["error"]
    assert (result["success_at_first"], result["success_within_three"], result["censored"]) == (True, True, True)
    assert (result["declaration_precision"], result["false_declarations"]) == (1.0, 0)
    assert json.loads((folder / "verdict.json").read_text())["outcome"] == "success"


def test_a_full_disk_does_not_damage_an_older_verdict(folder):
    (folder / "verdict.json").write_text('{"outcome": "error"}')
    concluded(folder, 100)
    assert json.loads((folder / "verdict.json").read_text()) == {"outcome": "error"}
    assert [path.name for path in folder.glob("verdict.json*")] == ["verdict.json"]


@pytest.mark.parametrize("limit", [5000, 60_000])  # run.json fits, the logs do not
def test_a_full_disk_during_a_flight_ends_it_with_status_3(tmp_path, capsys, rendered_run, limit):
    """The fixture `rendered_run` flies first, so all kernels of this flight are already compiled and cached."""
    words = ["--pilot", "oracle", "--latency", "fixed:0.5", "--out", str(tmp_path / "run"), "--json"]
    with file_sizes_limited(limit):
        status = main(["fly", "--sitl", "--speed", "max", *words])
    captured = capsys.readouterr()
    assert status == 3, captured.err
    assert "Traceback" not in captured.err
    assert "File too large" in captured.err
    assert last_object(captured.out)["outcome"] in ("error", "success")
