"""`dronecats edit` on the command line: it says where it is, serves the page, and ends when it is told to."""

import os
import signal
import subprocess
import sys
import threading
import urllib.request

import pytest

from dronecats.cli.main import main
from tests.support.command_line import DRONECATS


def test_the_address_is_told_and_an_interrupt_ends_it(yard, tmp_path, port):
    command = [*DRONECATS, "edit", yard, "--no-browser", "--port", str(port)]
    out = tmp_path / "my records"
    with subprocess.Popen(
        [*command, "--out", str(out)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=dict(os.environ)
    ) as process:
        late = threading.Timer(120.0, process.kill)
        late.start()
        assert process.stdout is not None
        lines = [process.stdout.readline(), process.stdout.readline()]
        assert f"http://127.0.0.1:{port}" in lines[1], process.stderr
        assert str(out) in lines[1]
        page = urllib.request.urlopen(f"http://127.0.0.1:{port}")
        assert "text/html" in page.headers["Content-Type"]
        process.send_signal(signal.SIGINT)
        rest, errors = process.communicate(timeout=60)
        late.cancel()
    assert process.returncode == 0
    assert rest == ""
    assert "Traceback" not in errors
    assert not out.exists()  # nothing was written, so nothing is there


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["campsu"], "no map, no episode and no record file: did you mean campus?"),
        (["xyz"], "did you mean blocks, campus, residential"),
        (["absent.json"], "does not exist"),
        (["residential", "--port", "70000"], "no port"),
    ],
)
def test_wrong_usage_is_one_sentence(arguments, sentence, capsys):
    assert main(["edit", *arguments, "--no-browser"]) == 2
    said = capsys.readouterr().err
    assert sentence in said
    assert said.count("\n") == 1


def test_without_viser_it_says_what_to_install(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "viser", None)
    assert main(["edit", "--no-browser"]) == 2
    assert "pip install 'dronecats[edit]'" in capsys.readouterr().err
