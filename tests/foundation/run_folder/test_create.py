"""A flight may use a new episode folder, or that of a flight that failed with an error or was killed."""

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
def test_a_killed_flight_is_flown_again_and_a_living_one_is_left_alone(tmp_path):
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


def test_only_a_flight_without_a_score_is_flown_again(tmp_path):
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


def test_flights_of_one_run_may_fly_side_by_side_but_not_beside_a_benchmark(tmp_path):
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


def test_a_run_of_other_settings_is_refused_and_nothing_is_moved(tmp_path):
    run = tmp_path / "run"
    with episode(run):
        pass
    write_run(run, {"seed": 2})
    with pytest.raises(UsageError, match="other settings"), episode(run):
        pass
    assert kept(run) == []


def test_a_run_is_not_gone_on_with_under_other_packages(tmp_path):
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


def test_a_flight_that_is_added_to_a_benchmark_leaves_it_a_benchmark(tmp_path):
    of_suite = {"seed": 1, "suite": {"name": "quick"}}
    Batch(tmp_path / "run", of_suite).close()
    with episode(tmp_path / "run"):
        pass
    Batch(tmp_path / "run", of_suite).close()


def test_a_setting_that_the_new_flight_lacks_is_a_difference(tmp_path):
    Batch(tmp_path / "run", {"seed": 1, "disturbed": "wind"}).close()
    with pytest.raises(UsageError, match="disturbed"), episode(tmp_path / "run"):
        pass


def test_of_two_flights_that_begin_a_run_together_the_other_kind_is_refused(tmp_path):
    def meanwhile():
        with create(tmp_path / "run", "vision", "e-02", {"seed": 2}):
            pass

    with pytest.raises(UsageError, match="seed"), create(tmp_path / "run", "oracle", "e-01", {"seed": 1}, meanwhile):
        pass
    assert json.loads((tmp_path / "run" / layout.RUN).read_text())["seed"] == 2
