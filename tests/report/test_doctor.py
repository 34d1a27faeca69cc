"""The doctor looks at everything, hides every key, and its exit status says whether a flight is possible."""

import json
import socket

import pytest

from dronecats.cli import doctor
from dronecats.cli.main import main


def test_exit_status_and_verdict_agree_with_the_findings(capsys):
    status = main(["doctor", "--json"])
    said = json.loads(capsys.readouterr().out)
    missing = [f for f in said["findings"] if f["state"] == doctor.MISSING]
    assert said["can_simulate"] == (not missing)
    assert status == (1 if missing else 0)
    assert all(f["remedy"] for f in missing)
    assert {*doctor.BASE, *doctor.SIM} <= {f["name"] for f in said["findings"]}


def test_a_missing_package_is_named_with_the_way_to_get_it(monkeypatch, capsys):
    monkeypatch.setitem(doctor.SIM, "no-such-distribution", "no_such_module_anywhere")
    assert main(["doctor"]) == 1
    printed = capsys.readouterr().out
    assert "✗ no-such-distribution" in printed
    assert doctor.INSTALL["sim"] in printed


@pytest.mark.parametrize("flag", [[], ["--json"]])
def test_keys_are_named_and_never_shown(monkeypatch, capsys, flag):
    monkeypatch.setenv("OPENAI_API_KEY", "sk-top-secret")
    main(["doctor", *flag])
    printed = capsys.readouterr().out
    assert "OPENAI_API_KEY" in printed
    assert "sk-top-secret" not in printed


def test_a_taken_port_is_a_note_and_no_obstacle():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as holder:
        holder.bind(("127.0.0.1", 0))
        found = doctor.port(holder.getsockname()[1], "a test")
    assert found.state == doctor.NOTE
    assert found.remedy
