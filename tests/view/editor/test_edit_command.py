"""`dronecats edit` on the command line: it prints its address, serves the page, and ends on request."""

import os
import re
import signal
import subprocess
import threading
import urllib.request

from dronecats.cli.main import main
from tests.support.command_line import DRONECATS


def test_the_address_is_printed_and_an_interrupt_ends_the_command(yard, tmp_path, port):
    command = [*DRONECATS, "edit", yard, "--no-browser", "--port", str(port)]
    out = tmp_path / "my records"
    with subprocess.Popen(
        [*command, "--out", str(out)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=dict(os.environ)
    ) as process:
        late = threading.Timer(120.0, process.kill)
        late.start()
        assert process.stdout is not None
        lines = [process.stdout.readline() for _ in range(3)]
        address = re.search(rf"http://127\.0\.0\.1:{port}/\S+", "".join(lines))
        assert address, process.stderr
        assert str(out) in "".join(lines)
        with urllib.request.urlopen(address[0]) as page:
            assert "text/html" in page.headers["Content-Type"]
            assert page.read()  # an unread page would delay the shutdown of the server
        process.send_signal(signal.SIGINT)
        rest, errors = process.communicate(timeout=60)
        late.cancel()
    assert process.returncode == 0
    assert rest == ""
    assert "Traceback" not in errors
    assert not out.exists()  # nothing was written, so no file exists


def test_wrong_usage_is_a_one_line_error(capsys):
    for arguments, parts in (
        (["campsu"], "'campsu' .*campus"),
        (["xyz"], "'xyz' .*blocks.* .campus.* .residential"),
        (["absent.json"], "absent.json"),
        (["residential", "--port", "70000"], "--port 70000 "),
    ):
        assert main(["edit", *arguments, "--no-browser"]) == 2, arguments
        error = capsys.readouterr().err
        assert re.search(parts, error), error
        assert error.count("\n") == 1, arguments
