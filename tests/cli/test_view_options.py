"""`--view` and what goes with it: refused in one sentence before anything flies, declared where something does."""

import subprocess
import sys

import pytest

from dronecats.cli.main import main, parse
from dronecats.watch import opening

FLYING = (["fly", "--sitl"], ["sitl"], ["bench"], ["study", "run", "x.toml"], ["study", "latency"])


@pytest.mark.parametrize("words", FLYING, ids=lambda words: " ".join(words[:2]))
def test_every_verb_that_flies_can_be_watched(words):
    args = parse([*words, "--view", "--view-port", "9000"])
    assert (args.view, args.view_port, args.view_stay) == (True, 9000, False)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["fly", "--sitl", "--view-port", "9000"], "--view-port goes with --view"),
        (["fly", "--sitl", "--view-stay"], "--view-stay goes with --view"),
        (["fly", "--sitl", "--view", "--view-port", "0"], "--view-port 0 is no port"),
        (["fly", "--sitl", "--view", "--view-port", "70000"], "--view-port 70000 is no port"),
        (["sitl", "--view", "--view-stay"], "leave --view-stay out"),
        (["bench", "--pilot", "oracle", "--engine", "ray", "--view"], "leave it out"),
    ],
)
def test_what_does_not_go_together_is_refused(words, said, capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    assert main(words) == 2
    assert said in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_without_viser_it_is_said_what_to_install(capsys, monkeypatch, tmp_path):
    monkeypatch.setattr(opening, "find_spec", lambda name: None)
    monkeypatch.chdir(tmp_path)
    assert main(["fly", "--sitl", "--view"]) == 2
    assert "dronecats[view]" in capsys.readouterr().err


def test_the_command_that_flies_does_not_load_what_draws():
    """Opening a page costs the flight's process neither viser nor the world."""
    code = "import dronecats.watch.opening, sys; print([m for m in ('viser', 'numpy', 'embreex') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
