"""The doctor looks at everything, hides every key, and its exit status says whether a flight is possible."""

import json
import re
import socket

import pytest

from dronecats.agent.models.providers import PROVIDERS
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


def test_only_keys_that_a_provider_uses_are_offered(monkeypatch):
    used = {provider.key_variable for provider in PROVIDERS.values()} - {None}
    for name in used:
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("MISTRAL_API_KEY", "of-no-use-here")
    found = next(f for f in doctor.examine() if f.name == "model keys")
    assert found.state == doctor.NOTE
    offered = set(re.findall(r"[A-Z]+_API_KEY", found.detail + found.remedy))
    assert offered == {"OPENAI_API_KEY", "OPENROUTER_API_KEY", "GEMINI_API_KEY", "ANTHROPIC_API_KEY"}
    for name in used:
        monkeypatch.setenv(name, "x")
    found = next(f for f in doctor.examine() if f.name == "model keys")
    assert set(re.findall(r"[A-Z]+_API_KEY", found.detail)) == used


def test_a_taken_port_is_a_note_and_no_obstacle():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as holder:
        holder.bind(("127.0.0.1", 0))
        found = doctor.port(holder.getsockname()[1], "a test")
    assert found.state == doctor.NOTE
    assert found.remedy
