"""`dronecats replay` on the command line: it prints its address, serves the page, and ends on request."""

import json
import os
import re
import signal
import socket
import subprocess
import threading
import urllib.request

import pytest

from dronecats.cli.main import main
from foundation.run_folder import layout
from tests.support.command_line import DRONECATS
from tests.support.ports import free_port
from tests.support.run_folders import run_folder


@pytest.mark.slow
def test_the_address_is_printed_and_an_interrupt_ends_the_command(runs):
    port = str(free_port(socket.SOCK_STREAM))  # the page takes the next free one if this one is taken
    command = [*DRONECATS, "replay", str(runs / "paper"), str(runs / "other"), "--no-browser", "--port", port]
    before = sorted(runs.rglob("*"))
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=dict(os.environ)
    ) as process:
        late = threading.Timer(120.0, process.kill)
        late.start()
        assert process.stdout is not None
        lines = [process.stdout.readline() for _ in range(3)]
        address = re.search(r"http://127\.0\.0\.1:\d+/\S+", lines[1])
        assert address, lines
        page = urllib.request.urlopen(address[0])
        assert "text/html" in page.headers["Content-Type"]
        process.send_signal(signal.SIGINT)
        rest, errors = process.communicate(timeout=60)
        late.cancel()
    assert process.returncode == 0
    assert rest == ""
    assert "Traceback" not in errors
    assert sorted(runs.rglob("*")) == before  # nothing is written into a run


def test_wrong_options_are_a_one_line_error(capsys):
    for options, parts in (
        (["--port", "70000"], "--port 70000 "),
        (["--speed", "0"], "--speed .*0.1 .*20, .*0"),
        (["--speed", "nan"], "--speed .*0.1 .*20, .*nan"),
        (["--at", "-1"], "--at .*-1"),
    ):
        assert main(["replay", "anything", "--no-browser", *options]) == 2, options
        error = capsys.readouterr().err
        assert re.search(parts, error), error
        assert error.count("\n") == 1, options


def test_wrong_runs_are_a_one_line_error(tmp_path, capsys):
    first = run_folder(tmp_path / "first", {"nowhere-approaching-01": "go there"})
    second = run_folder(tmp_path / "second", {"nowhere-approaching-02": "go there"})
    many = run_folder(tmp_path / "many", {f"nowhere-approaching-{k:02}": "go there" for k in (1, 2)})
    broken = run_folder(tmp_path / "broken", {"nowhere-approaching-01": "go there"})
    (broken / "nowhere-approaching-01" / layout.DECISIONS).write_text('{"step": -1}\n' * 2)
    newer = run_folder(tmp_path / "newer", {"nowhere-approaching-01": "go there"})
    (newer / layout.RUN).write_text(json.dumps({**json.loads((newer / layout.RUN).read_text()), "schema": 99}))
    for runs, parts in (
        ([tmp_path / "nothing"], f"{tmp_path}/nothing"),
        ([first, second], "nowhere-approaching-01 .*nowhere-approaching-02"),
        ([many], f"{tmp_path}/many .*2 "),
        ([broken], r"decisions\.jsonl line 1\b"),
        ([newer], f"{tmp_path}/newer"),
        ([first] * 10, r"\b10 .*\b9 "),
    ):
        assert main(["replay", *map(str, runs), "--no-browser"]) == 2, parts
        error = capsys.readouterr().err
        assert re.search(parts, error), error
        assert error.count("\n") == 1
