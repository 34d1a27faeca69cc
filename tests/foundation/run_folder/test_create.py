"""A flight may use a new episode folder, or the folder of a flight that was killed or ended with an error."""

import json
import subprocess
import sys

import pytest

from dronecats.bench.campaign import Batch
from foundation.errors import UsageError
from foundation.run_folder import layout
from foundation.run_folder.folder import create, write_run

FLY = """
import sys, time
from pathlib import Path
from foundation.run_folder.folder import create
with create(Path(sys.argv[1]), "oracle", "e-01", {"seed": 1}) as folder:
    (folder / "decisions.jsonl").write_text("{}\\n")
    print("flying", flush=True)
    time.sleep(600)
"""


def episode(run):
    return create(run, "oracle", "e-01", {"seed": 1})


def kept(run):
    return sorted(path.name for path in (run / layout.UNFINISHED).glob("*"))


@pytest.mark.process
def test_a_killed_flight_can_be_repeated_but_a_running_flight_blocks_its_episode(tmp_path):
    run = tmp_path / "run"
    with subprocess.Popen([sys.executable, "-c", FLY, str(run)], stdout=subprocess.PIPE) as flying:
        assert flying.stdout is not None
        assert flying.stdout.readline() == b"flying\n"
        with pytest.raises(UsageError, match=r"another process is flying .*e-01"), episode(run):
            pass
        assert kept(run) == []
        flying.kill()
    with episode(run) as folder:
        assert (folder / layout.DECISIONS).read_text() == ""
    assert kept(run) == ["e-01-1"]
    assert (run / layout.UNFINISHED / "e-01-1" / layout.DECISIONS).read_text() == "{}\n"


def test_only_a_flight_that_ended_with_an_error_can_be_repeated(tmp_path):
    for outcome, is_again in (("success", False), ("failure", False), ("unknown", False), ("error", True)):
        run = tmp_path / outcome
        with episode(run) as folder:
            (folder / layout.VERDICT).write_text(json.dumps({"outcome": outcome}))
        if is_again:
            with episode(run) as folder:
                assert not (folder / layout.VERDICT).exists()
        else:
            with pytest.raises(UsageError, match="already has a flight"), episode(run):
                pass
        assert kept(run) == ["e-01-1"] * is_again


def test_single_flights_may_share_a_run_folder_but_not_with_a_running_benchmark(tmp_path):
    run = tmp_path / "run"
    beside = create(run, "oracle", "e-02", {"seed": 1})
    with episode(run), beside, pytest.raises(UsageError, match="another process is flying"):
        Batch(run, {"seed": 1})
    batch = Batch(run, {"seed": 1})
    with pytest.raises(UsageError, match="another process is flying"), episode(run):
        pass
    batch.close()
    with episode(run):
        pass


def test_a_flight_with_different_settings_is_rejected_and_no_folder_moves(tmp_path):
    run = tmp_path / "run"
    with episode(run):
        pass
    write_run(run, {"seed": 2})
    with pytest.raises(UsageError, match="other settings"), episode(run):
        pass
    assert kept(run) == []


def test_a_run_cannot_resume_with_different_package_versions(tmp_path):
    run = tmp_path / "run"
    with episode(run):
        pass
    kept_run = json.loads((run / layout.RUN).read_text())
    for versions, part in (
        ({"numpy": "1.0.0"}, "numpy"),
        ({"python": "3.2.1"}, "python"),
        ({"dronecats": "0"}, "dronecats"),
    ):
        (run / layout.RUN).write_text(json.dumps({**kept_run, "versions": {**kept_run["versions"], **versions}}))
        for begin in (lambda: create(run, "oracle", "e-02", {"seed": 1}).__enter__(), lambda: Batch(run, {"seed": 1})):
            with pytest.raises(UsageError, match=part):
                begin()
    patch = ".".join([*kept_run["versions"]["python"].split(".")[:2], "99"])
    (run / layout.RUN).write_text(json.dumps({**kept_run, "versions": {**kept_run["versions"], "python": patch}}))
    Batch(run, {"seed": 1}).close()


def test_a_flight_that_another_process_finished_meanwhile_is_kept(tmp_path):
    run = tmp_path / "run"

    def other():
        with episode(run) as folder:
            (folder / layout.DECISIONS).write_text("{}\n")
            (folder / layout.VERDICT).write_text('{"outcome": "success"}')

    with pytest.raises(UsageError, match="already has a flight"), create(run, "oracle", "e-01", {"seed": 1}, other):
        pass
    assert json.loads((run / "e-01" / layout.VERDICT).read_text())["outcome"] == "success"


def test_a_benchmark_can_resume_after_a_single_flight_is_added(tmp_path):
    of_suite = {"seed": 1, "suite": {"name": "quick"}}
    Batch(tmp_path / "run", of_suite).close()
    with episode(tmp_path / "run"):
        pass
    Batch(tmp_path / "run", of_suite).close()


def test_a_setting_missing_in_the_new_flight_is_a_difference(tmp_path):
    Batch(tmp_path / "run", {"seed": 1, "disturbed": "wind"}).close()
    with pytest.raises(UsageError, match="disturbed"), episode(tmp_path / "run"):
        pass


def test_a_flight_is_rejected_if_a_concurrent_flight_creates_the_run_with_other_settings(tmp_path):
    def meanwhile():
        with create(tmp_path / "run", "vision", "e-02", {"seed": 2}):
            pass

    with pytest.raises(UsageError, match="seed"), create(tmp_path / "run", "oracle", "e-01", {"seed": 1}, meanwhile):
        pass
    assert json.loads((tmp_path / "run" / layout.RUN).read_text())["seed"] == 2
