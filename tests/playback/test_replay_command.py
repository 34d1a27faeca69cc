"""`dronecats replay` on the command line: it says where it is, serves the page, and ends when it is told to."""

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import urllib.request

import pytest

from dronecats.cli.main import main
from dronecats.rundir import layout
from tests.support.command_line import DRONECATS
from tests.support.ports import free_port
from tests.support.run_folders import run_folder


@pytest.mark.slow
def test_the_address_is_told_and_an_interrupt_ends_it(runs):
    port = free_port(socket.SOCK_STREAM)
    command = [*DRONECATS, "replay", str(runs / "paper"), str(runs / "other"), "--no-browser", "--port", str(port)]
    before = sorted(runs.rglob("*"))
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=dict(os.environ)
    ) as process:
        late = threading.Timer(120.0, process.kill)
        late.start()
        assert process.stdout is not None
        lines = [process.stdout.readline(), process.stdout.readline()]
        assert f"http://127.0.0.1:{port}" in lines[1], process.stderr
        page = urllib.request.urlopen(f"http://127.0.0.1:{port}")
        assert "text/html" in page.headers["Content-Type"]
        process.send_signal(signal.SIGINT)
        rest, errors = process.communicate(timeout=60)
        late.cancel()
    assert process.returncode == 0
    assert rest == ""
    assert "Traceback" not in errors
    assert sorted(runs.rglob("*")) == before  # nothing is written into a run


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--port", "70000"], "--port 70000 is no port"),
        (["--speed", "0"], "--speed wants a factor from 0.1 to 20, got 0"),
        (["--speed", "nan"], "--speed wants a factor from 0.1 to 20, got nan"),
        (["--at", "-1"], "--at wants seconds since the episode began, 0 or more, got -1"),
    ],
)
def test_wrong_options_are_one_sentence(options, sentence, capsys):
    assert main(["replay", "anything", "--no-browser", *options]) == 2
    said = capsys.readouterr().err
    assert sentence in said
    assert said.count("\n") == 1


def test_wrong_runs_are_one_sentence(tmp_path, capsys):
    first = run_folder(tmp_path / "first", {"nowhere-approaching-01": "go there"})
    second = run_folder(tmp_path / "second", {"nowhere-approaching-02": "go there"})
    many = run_folder(tmp_path / "many", {f"nowhere-approaching-{k:02}": "go there" for k in (1, 2)})
    broken = run_folder(tmp_path / "broken", {"nowhere-approaching-01": "go there"})
    (broken / "nowhere-approaching-01" / layout.DECISIONS).write_text('{"step": -1}\n' * 2)
    newer = run_folder(tmp_path / "newer", {"nowhere-approaching-01": "go there"})
    (newer / layout.RUN).write_text(json.dumps({**json.loads((newer / layout.RUN).read_text()), "schema": 99}))
    for runs, sentence in (
        ([tmp_path / "nothing"], "there is no folder"),
        ([first, second], "is of nowhere-approaching-01 and"),
        ([many], "holds 2 episodes; name one of them"),
        ([broken], "line 1 is damaged"),
        ([newer], "is of a newer dronecats"),
        ([first] * 10, "10 runs are too many for one page: choose 9 at most"),
    ):
        assert main(["replay", *map(str, runs), "--no-browser"]) == 2, sentence
        said = capsys.readouterr().err
        assert sentence in said
        assert said.count("\n") == 1


def test_without_viser_it_says_what_to_install(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "viser", None)
    assert main(["replay", "anything", "--no-browser"]) == 2
    assert "pip install 'dronecats[view]'" in capsys.readouterr().err
