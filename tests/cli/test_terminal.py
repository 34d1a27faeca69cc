"""Texts of a model or a server reach the terminal as plain text. The tests start the real program."""

import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dronecats.cli.output import Drawing, Printing
from foundation.wording import printable
from tests.agent.models.pointing import wrapped
from tests.agent.models.recording import Recording
from tests.support.command_line import DRONECATS
from tests.support.terminal import in_terminal, screen

HOSTILE = "\x1b]52;c;cm0gLXJm\x07\x1b[2J\x9b31m\r\u202eelif\u2066 \x08\x00\x7f"
STEERS = re.compile(r"[\x00-\x09\x0b-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069]")


def run(*words, **streams):
    """Run the program and return its exit status and its standard output and standard error as one text."""
    environment = {**os.environ, "PYTHONIOENCODING": "utf-8"}
    done = subprocess.run([*DRONECATS, *words], capture_output=True, env=environment, timeout=120, check=False)
    return done.returncode, (done.stdout + done.stderr).decode("utf-8")


def completion(text):
    return json.dumps(wrapped("openai", text, 1, 1)).encode()


@pytest.mark.parametrize("form", [[], ["--json"]])
def test_model_replies_are_escaped(form):
    with Recording(completion(HOSTILE)) as server:
        status, output = run("models", "check", "local/m", "--base-url", server.url, *form)
    assert status == 1
    assert "elif" in output
    assert not STEERS.search(output)


@pytest.mark.parametrize("answered", [400, 200])
def test_server_errors_are_escaped(answered):
    with Recording(HOSTILE.encode(), answered) as server:
        status, output = run("models", "check", "local/m", "--base-url", server.url)
    assert status == 3
    assert r"\u001b]52;c;cm0gLXJm\u0007" in output
    assert "elif" in output
    assert not STEERS.search(output)


def test_command_line_arguments_are_escaped():
    status, output = run("judge", f"x{HOSTILE}".replace("\x00", ""))
    assert status == 2
    assert r"\u001b[2J" in output
    assert not STEERS.search(output)


@given(st.lists(st.text()))
def test_an_output_stream_writes_no_control_characters(texts):
    with tempfile.TemporaryFile() as file:
        stream = Printing(file.fileno(), "utf-8", "backslashreplace")
        assert [stream.write(text) for text in texts] == [len(text) for text in texts]
        stream.writelines(texts)
        print(*texts, file=stream, flush=True)
        file.seek(0)
        assert not STEERS.search(file.read().decode())


def test_only_progress_bars_may_write_a_carriage_return(monkeypatch):
    reading, writing = os.pipe()
    monkeypatch.setattr(sys, "stderr", Printing(writing, "utf-8", "strict"))
    for file in (Drawing(), sys.stderr):
        print("\r50 %", end="", file=file, flush=True)
    os.close(writing)
    with open(reading, "rb") as pipe:
        assert pipe.read() == b"\r50 %\\u000d50 %"


def test_a_text_is_written_once_if_a_signal_interrupts_it():
    received: list[bytes] = []

    def read():
        while part := os.read(reading, 4096):
            received.append(part)
            if b"." in part:
                os.kill(os.getpid(), signal.SIGUSR1)  # the writer has not yet returned from its system call

    reading, writing = os.pipe()
    before = signal.signal(signal.SIGUSR1, signal.default_int_handler)
    reader = threading.Thread(target=read)
    reader.start()
    stream = Printing(writing, "utf-8", "strict")
    interrupted = 0
    for _ in range(300):
        try:
            print(".", file=stream, flush=True)
            time.sleep(1.0)  # until the signal
        except KeyboardInterrupt:
            interrupted += 1
    os.close(writing)
    reader.join()
    signal.signal(signal.SIGUSR1, before)
    assert interrupted == 300
    assert b"".join(received).count(b".") == 300


def test_progress_stays_on_one_terminal_line(tmp_path):
    (tmp_path / "verb.py").write_text(
        "from dronecats.cli.output import Live\n"
        "from dronecats.cli.output import Output\n"
        "with Output():\n"
        "    live = Live(total=4)\n"
        "    live.now('1/4; ' + 'x' * 200, done=1)\n"
        f"    live.say({'a/b: ' + HOSTILE!r})\n"
        "    live.now('3/4', done=3)\n"
        "    live.close('4/4; ' + 'y' * 100)\n"
    )
    status, received = in_terminal([sys.executable, "-m", "verb"], columns=60, cwd=tmp_path)
    assert status == 0
    assert r"\u000d" not in received.replace(printable(HOSTILE), "")
    assert not STEERS.search(received.replace("\r", ""))
    message, *rest = screen(received)
    assert message.startswith(r"a/b: \u001b]52;c;")
    assert rest == ["4/4; " + "y" * 100, ""]
    bars = [part for part in re.split(r"[\r\n]+", received) if "█" in part]
    assert all(len(bar) <= 60 for bar in bars)
    assert {(bar.count("█"), bar.split()[1].rstrip(";")) for bar in bars} == {(2, "1/4"), (7, "3/4")}
