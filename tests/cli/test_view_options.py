"""The options `--view…`: flying commands accept them, and reject invalid combinations before any flight."""

import re
import subprocess
import sys

from dronecats.cli.main import main, parse
from dronecats.cli.options import page_of

FLYING = (["fly", "--sitl"], ["sitl"], ["bench"], ["study", "run", "x.toml"], ["study", "latency"])


def test_every_flying_command_accepts_view():
    for words in FLYING:
        args = parse([*words, "--view", "--view-port", "9000"])
        assert (args.view, args.view_port, args.view_stay) == (True, 9000, False), words


def test_every_command_with_a_page_accepts_more_host_names():
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


def test_the_options_of_the_page_may_stand_beside_a_spec(capsys, tmp_path):
    page = ["--view", "--view-port", "9000", "--view-host", "me", "--view-stay"]
    assert main(["fly", "--spec", str(tmp_path / "absent.json"), *page]) == 2
    assert "absent.json" in capsys.readouterr().err  # the missing file, not the options


def test_a_flying_command_does_not_import_the_drawing_packages():
    """Opening a page loads neither viser nor the world in the flight's process."""
    code = (
        "import dronecats.view.live.opening, sys\n"
        "print([name for name in ('viser', 'numpy', 'embreex') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
