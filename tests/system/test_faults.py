"""Faults of a model or of the program in flight do not leak secrets, and the flight ends in order."""

from pathlib import Path

import pytest

from dronecats.agent.models.endpoint import GIVE_UP_S, RetryPolicy
from dronecats.cli.main import main
from dronecats.pilots.server import PilotServer
from tests.support.command_line import last_object
from tests.support.first_question import after_first_question
from tests.support.json_lines import rows

KEY = "sk-SECRET-1234567890"


@pytest.fixture
def fly(tmp_path, capsys):
    """Fly with a pilot function behind the model interface; return (status, result, all output and written files)."""

    def run(pilot, *arguments):
        with PilotServer(after_first_question(pilot), "m") as server:
            endpoint = server.base_url.replace("://", "://me:pw777@")
            command = ["fly", "--sitl", "--speed", "max", "--latency", "fixed:0.5", "--model", "openai/m"]
            status = main([*command, "--base-url", endpoint, "--out", str(tmp_path / "run"), "--json", *arguments])
        captured = capsys.readouterr()
        written = [p.read_bytes() for p in (tmp_path / "run").rglob("*") if p.is_file()]
        return status, last_object(captured.out), captured.out.encode() + captured.err.encode() + b"".join(written)

    return run


def test_a_model_failure_in_flight_ends_it_with_status_3_and_leaks_no_secret(fly, monkeypatch):
    monkeypatch.setenv("OPENAI_API_KEY", KEY)
    calls = []

    def pilot(prompt, images):
        calls.append(prompt)
        if len(calls) > 2:
            raise RuntimeError(f"overloaded, {KEY}")
        return '{"action":"rotate","angle_deg":10}'

    monkeypatch.setattr(RetryPolicy.__init__, "__defaults__", (GIVE_UP_S, 3, 0.0))  # no pauses
    status, result, everything = fly(pilot)
    assert status == 3
    assert result["outcome"] == "error"
    assert "500" in result["error"]
    assert result["steps"] == 2
    assert KEY.encode() not in everything
    assert b"pw777" not in everything


def test_unreadable_replies_are_logged_as_errors_and_the_flight_continues(fly, monkeypatch):
    monkeypatch.setattr(RetryPolicy.__init__, "__defaults__", (GIVE_UP_S, 3, 0.0))  # no pauses
    replies = ["\ud800 no json", "", '{"action":"land"}', '{"action":"go","point":[9],"depth_m":1}']

    def pilot(prompt, images):
        if not replies:
            raise RuntimeError
        return replies.pop(0)

    status, result, _ = fly(pilot)
    assert status == 3  # the pilot fails after the four replies
    assert result["steps"] == 4
    decisions = rows(Path(result["run_dir"]) / "decisions.jsonl")
    assert [row["action"] for row in decisions] == [None] * 4
    assert all(row["error"] for row in decisions)
    assert decisions[0]["reply"] == "\ud800 no json"


def test_an_internal_error_in_flight_lands_the_vehicle_and_is_reported(fly, monkeypatch):
    monkeypatch.setattr("dronecats.agent.controller.plan", lambda action, camera: 1 / 0)
    status, result, everything = fly(lambda prompt, images: '{"action":"think"}')
    assert status == 3
    assert "ZeroDivisionError" in result["error"]
    assert b"landing" in everything
    assert b"ZeroDivisionError: division by zero" in everything  # the traceback, in the run folder
