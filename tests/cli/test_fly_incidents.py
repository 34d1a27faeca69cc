"""Collisions and estimator resets in the output of `dronecats fly` at the end of a flight."""

import pytest

from dronecats.cli.main import main
from tests.report.results.synthetic_runs import clear, hit, reset, tell_incidents, write_run

EPISODE = "residential-approaching-01"
INCIDENTS = (hit(2.0, "mailbox-3", 0.8), hit(8.0, "mailbox-3", 1.1), clear(10.0, 1.5), reset(4.0))


@pytest.fixture
def printed(tmp_path, monkeypatch, capsys):
    """Return a function that returns the lines printed at the end of a flight with these incidents."""

    def printed(*incidents):
        folder = write_run(tmp_path / "run", (EPISODE,)) / EPISODE
        tell_incidents(folder, *incidents)
        result = {"outcome": "success", "success": True, "ne_m": 1.0, "reason": "cap", "status": 0, "steps": 5,
                  "declarations": 1, "sim_seconds": 24.0, "real_time_factor": 9.0, "run_dir": str(folder),
                  "episode": EPISODE}  # fmt: skip
        monkeypatch.setattr("dronecats.flight.run.fly.fly", lambda *_: result)
        assert main(["fly", "--sitl", "--speed", "max", "--pilot", "oracle", "--episode", EPISODE]) == 0
        return capsys.readouterr().out.splitlines()

    return printed


def test_incidents_are_printed_once(printed):
    lines = printed(*INCIDENTS)
    [hits] = [line for line in lines if "mailbox-3" in line]
    assert all(word in hits for word in ("2 hits", "1.1 m/s", "1.5 s"))
    [resets] = [line for line in lines if "estimator reset" in line]
    assert "yaw" in resets
    assert "4.0 s" in resets


def test_a_flight_without_incidents_prints_no_incident_lines(printed):
    calm, rough = printed(), printed(*INCIDENTS)
    assert len(rough) == len(calm) + 2
    assert [line for line in rough if line in calm] == calm
