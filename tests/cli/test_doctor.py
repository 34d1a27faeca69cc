"""The command `dronecats doctor`: its findings, its exit status, and hidden API keys."""

import json
import re
import socket
import tomllib
from pathlib import Path

import pytest

from dronecats.agent.models.spec import PROVIDERS
from dronecats.cli import doctor
from dronecats.cli.main import main
from foundation.extras import EXTRAS, is_installed

ROOT = Path(__file__).parents[2]


def hide(monkeypatch, *modules):
    """Make modules appear as not installed."""
    monkeypatch.setattr(doctor, "is_installed", lambda module: module not in modules and is_installed(module))


def examined(capsys):
    """Return the exit status, and the object that `doctor --json` prints."""
    status = main(["doctor", "--json"])
    return status, json.loads(capsys.readouterr().out)


def test_exit_status_and_verdict_agree_with_the_findings(capsys):
    status, report = examined(capsys)
    missing = [f for f in report["findings"] if f["state"] == doctor.MISSING]
    assert report["can_simulate"] == (not missing)
    assert status == (1 if missing else 0)
    assert all(f["remedy"] for f in missing)


def test_every_base_package_and_every_extra_is_listed(capsys):
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    base = {re.split(r"[^\w.-]", requirement)[0] for requirement in project["dependencies"]}
    _, report = examined(capsys)
    names = {kind: {f["name"] for f in report["findings"] if f["kind"] == kind} for kind in ("package", "extra")}
    assert names["package"] == {"dronecats", "python", *base}
    assert names["extra"] == {extra.name for extra in EXTRAS}


@pytest.mark.parametrize("extra", EXTRAS, ids=lambda extra: extra.name)
def test_an_incomplete_extra_is_an_obstacle_only_if_it_is_sim(extra, monkeypatch):
    for module in extra.modules:
        hide(monkeypatch, module)
        finding = doctor._extra(extra)
        assert finding.state == (doctor.MISSING if extra.name == "sim" else doctor.NOTE)
        assert finding.remedy == extra.command


def test_a_machine_without_the_extra_sim_gets_one_remedy(monkeypatch, capsys):
    hide(monkeypatch, "numba", "embreex")
    status, report = examined(capsys)
    assert status == 1
    assert [f["name"] for f in report["findings"] if f["state"] == doctor.MISSING] == ["sim"]


def test_a_package_that_does_not_import_is_an_obstacle(monkeypatch, capsys):
    monkeypatch.setattr(doctor, "_import_fault", lambda module: "broken" if module == "numba" else "")
    status, report = examined(capsys)
    assert status == 1
    assert [f["name"] for f in report["findings"] if f["state"] == doctor.MISSING] == ["sim"]


def test_a_missing_base_package_is_an_obstacle(monkeypatch, capsys):
    monkeypatch.setitem(doctor.BASE, "no-such-distribution", "no_such_module_anywhere")
    status, report = examined(capsys)
    assert status == 1
    assert [f["name"] for f in report["findings"] if f["state"] == doctor.MISSING] == ["no-such-distribution"]


def test_the_text_output_names_each_missing_extra_with_its_command(monkeypatch, capsys):
    hide(monkeypatch, "viser", "duckdb")
    assert main(["doctor"]) == 0
    printed = capsys.readouterr().out.splitlines()
    for name in ("view", "query"):
        assert [line for line in printed if f'pip install "dronecats[{name}]"' in line and name in line.split()[:2]]
    assert not [line for line in printed if "dronecats[sim]" in line]


def test_without_enough_memory_the_text_output_has_no_section_for_extras(monkeypatch, capsys):
    monkeypatch.setattr(doctor, "_memory", lambda: doctor.Diagnosis("memory", doctor.MISSING, "too little"))
    assert main(["doctor"]) == 1
    printed = capsys.readouterr().out
    assert "This machine:" in printed
    assert "Extras:" not in printed


@pytest.mark.parametrize("flag", [[], ["--json"]])
def test_api_keys_are_named_but_their_values_are_never_shown(monkeypatch, capsys, flag):
    monkeypatch.setenv("OPENAI_API_KEY", "sk-top-secret")
    main(["doctor", *flag])
    printed = capsys.readouterr().out
    assert "OPENAI_API_KEY" in printed
    assert "sk-top-secret" not in printed


def test_only_keys_that_a_provider_uses_are_listed(monkeypatch):
    used = {provider.key_variable for provider in PROVIDERS.values()} - {None}
    for name in used:
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("MISTRAL_API_KEY", "of-no-use-here")
    finding = next(f for f in doctor.examine() if f.name == "model keys")
    assert finding.state == doctor.NOTE
    offered = set(re.findall(r"[A-Z]+_API_KEY", finding.detail + finding.remedy))
    assert offered == {"OPENAI_API_KEY", "OPENROUTER_API_KEY", "GEMINI_API_KEY", "ANTHROPIC_API_KEY"}
    for name in used:
        monkeypatch.setenv(name, "x")
    finding = next(f for f in doctor.examine() if f.name == "model keys")
    assert set(re.findall(r"[A-Z]+_API_KEY", finding.detail)) == used


def test_a_port_in_use_is_a_note_and_not_an_obstacle():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as holder:
        holder.bind(("127.0.0.1", 0))
        finding = doctor.port(holder.getsockname()[1], "a test")
    assert finding.state == doctor.NOTE
    assert finding.remedy
