"""The option `--view` and its companions: rejected in one sentence before any flight, accepted by commands that fly."""

import re
import subprocess
import sys

from dronecats.cli.main import main, parse
from dronecats.cli.options import page_of

FLYING = (["fly", "--sitl"], ["sitl"], ["bench"], ["study", "run", "x.toml"], ["study", "latency"])


def test_every_verb_that_flies_can_be_watched():
    for words in FLYING:
        args = parse([*words, "--view", "--view-port", "9000"])
        assert (args.view, args.view_port, args.view_stay) == (True, 9000, False), words


def test_every_verb_with_a_page_takes_other_host_names_for_it():
    for words, prefix in (*((words, "view-") for words in FLYING), (["replay", "run"], ""), (["edit"], "")):
        flag = [] if prefix == "" else ["--view"]
        args = parse([*words, *flag, f"--{prefix}host", "drone.example.org", f"--{prefix}host", "other"])
        assert page_of(args, prefix) == (8090, ("drone.example.org", "other")), words


def test_incompatible_options_are_rejected(capsys, monkeypatch, tmp_path):
    for words, parts in (
        (["fly", "--sitl", "--view-port", "9000"], "--view-port .*--view"),
        (["fly", "--sitl", "--view-stay"], "--view-stay .*--view"),
        (["fly", "--sitl", "--view", "--view-port", "0"], "--view-port 0 "),
        (["fly", "--sitl", "--view", "--view-port", "70000"], "--view-port 70000 "),
        (["fly", "--sitl", "--view-host", "me"], "--view-host .*--view"),
        (["fly", "--sitl", "--view", "--view-host", "http://me/"], "--view-host 'http://me/' "),
        (["replay", "run", "--host", "me:8080"], "--host 'me:8080' "),
        (["edit", "--host", ""], "--host '' "),
        (["sitl", "--view", "--view-stay"], "--view-stay"),
        (["bench", "--pilot", "oracle", "--engine", "ray", "--view"], "--view"),
    ):
        monkeypatch.chdir(tmp_path)
        assert main(words) == 2, words
        assert re.search(parts, capsys.readouterr().err), words
        assert list(tmp_path.iterdir()) == [], words


def test_the_command_that_flies_does_not_load_what_draws():
    """Opening a page loads neither viser nor the world in the flight's process."""
    code = (
        "import dronecats.view.live.opening, sys\n"
        "print([name for name in ('viser', 'numpy', 'embreex') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
