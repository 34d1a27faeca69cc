"""A disk that is full says so in a sentence, ends with status 3, and leaves no half-written verdict."""

import json
import resource
import signal
import subprocess
import sys

import pytest

from tests.support.command_line import DRONECATS, last_object

LIMIT = 2000  # bytes that a file may have: enough for the logs' first lines, too little for a verdict

FLIGHT = """
import json, resource, sys
from pathlib import Path
from dronecats.run.outcome import fly_and_judge
from dronecats.run.episode import Flown

folder = Path(sys.argv[1])

def flight():
    resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]), resource.RLIM_INFINITY))
    return Flown("decided", None, 6.0, 1.0, 1)

def afterwards(flown):
    (folder / "afterwards.json").write_text("x" * 5000)

print(json.dumps(fly_and_judge(flight, folder, "e", "blind", afterwards)))
"""


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
    """What a flight comes to whose files may not grow beyond `limit` bytes after it."""
    done = subprocess.run(
        [sys.executable, "-c", FLIGHT, str(folder), str(limit)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_a_verdict_that_cannot_be_written_is_told_and_known_all_the_same(folder):
    result = concluded(folder, 100)
    assert (result["status"], result["outcome"]) == (3, "success")
    assert result["error"].endswith("verdict.json cannot be written: File too large")
    assert not list(folder.glob("verdict.json*"))


def test_what_comes_after_the_verdict_costs_the_verdict_nothing(folder):
    result = concluded(folder, 4000)
    assert (result["status"], result["outcome"]) == (3, "success")
    assert "cannot be written: File too large" in result["error"]
    assert (result["success_at_first"], result["success_within_three"], result["censored"]) == (True, True, True)
    assert (result["declaration_precision"], result["false_declarations"]) == (1.0, 0)
    assert json.loads((folder / "verdict.json").read_text())["outcome"] == "success"


def test_an_older_verdict_outlives_a_full_disk(folder):
    (folder / "verdict.json").write_text('{"outcome": "error"}')
    concluded(folder, 100)
    assert json.loads((folder / "verdict.json").read_text()) == {"outcome": "error"}
    assert [path.name for path in folder.glob("verdict.json*")] == ["verdict.json"]


@pytest.mark.parametrize("limit", [5000, 60_000])  # run.json fits, the logs do not
def test_logs_that_a_disk_does_not_take_end_a_flight_with_status_3(tmp_path, limit):
    def small():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))

    done = subprocess.run(
        [*DRONECATS, "fly", "--sitl", "--speed", "max", "--pilot", "oracle",
         "--latency", "fixed:0.5", "--out", str(tmp_path / "run"), "--json"],
        capture_output=True, text=True, check=False, preexec_fn=small,
    )  # fmt: skip
    assert done.returncode == 3, done.stderr
    assert "Traceback" not in done.stderr
    assert "File too large" in done.stderr
    assert last_object(done.stdout)["outcome"] in ("error", "success")
