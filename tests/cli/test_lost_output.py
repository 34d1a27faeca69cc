"""If the reader of the output exits, only the output is lost. The work continues and the exit status is correct."""

import json
import shlex
import signal
import subprocess
import sys

import pytest

from tests.support.command_line import DRONECATS

FLY = [*DRONECATS, "fly", "--sitl", "--speed", "max", "--pilot", "oracle", "--latency", "fixed:0.5", "--json", "--out"]


# `dronecats`; before its third and its sixth question it waits for a line on its standard input
HELD = """
import sys
from dronecats.agent.prompt import Prompt
from dronecats.cli.main import main
render, count = Prompt.render, 0

def held(*arguments, **options):
    global count
    count += 1
    if count in (3, 6):
        sys.stdin.readline()
    return render(*arguments, **options)

Prompt.render = held
sys.exit(main(sys.argv[1:]))
"""
HELD_FLY = [sys.executable, "-c", HELD, *FLY[len(DRONECATS) :]]


def after_one_line(command, **streams):
    """Start a command, read one line of its output, and close the pipe, as `head -1` does."""
    process = subprocess.Popen(command, stdout=subprocess.PIPE, **{"stderr": subprocess.PIPE, **streams}, text=True)
    assert process.stdout is not None
    assert process.stdout.readline()
    process.stdout.close()
    return process


@pytest.mark.slow
@pytest.mark.parametrize("stderr", [subprocess.PIPE, subprocess.STDOUT])
def test_a_flight_continues_when_its_output_reader_exits(tmp_path, stderr):
    process = after_one_line([*HELD_FLY, str(tmp_path / "run")], stderr=stderr, stdin=subprocess.PIPE)
    process.stdin.close()
    error_output = process.stderr.read() if process.stderr else None
    assert process.wait(300) == 0
    (verdict,) = (tmp_path / "run").glob("*/verdict.json")
    assert json.loads(verdict.read_text())["outcome"] == "success"
    if error_output is not None:
        assert len(error_output.splitlines()) == 1


def test_a_shell_pipeline_gets_the_exit_status_of_the_command():
    line = f"{shlex.join(DRONECATS)} judge /nowhere 2>&1 | head -0; exit ${{PIPESTATUS[0]}}"
    assert subprocess.run(["bash", "-c", line], timeout=300, check=False).returncode == 2


def test_an_interrupted_flight_without_a_reader_exits_with_130(tmp_path):
    process = after_one_line([*HELD_FLY, str(tmp_path / "run"), "--full"], stdin=subprocess.PIPE)
    process.stdin.write("\n")
    process.stdin.flush()
    assert process.stderr.readline()
    process.send_signal(signal.SIGINT)
    assert process.wait(300) == 130


def test_a_keyboard_interrupt_inside_exec_exits_with_130(tmp_path):
    (tmp_path / "verb.py").write_text(
        "import sys\n"
        "from dronecats.cli.exit_status import exit_status\n"
        "sys.exit(exit_status('verb', lambda: exec('raise KeyboardInterrupt')))\n"
    )
    done = subprocess.run([sys.executable, "-m", "verb"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (130, "verb: interrupted\n")


def test_a_list_exits_with_0_and_no_error_output_when_its_reader_exits():
    process = after_one_line([*DRONECATS, "episodes", "list"])
    assert process.stderr.read() == ""
    assert process.wait(60) == 0


@pytest.mark.parametrize("closed", [">&-", "2>&-", ">&- 2>&-"])
def test_a_command_with_closed_output_keeps_its_exit_status(closed):
    line = f"exec {shlex.join([*DRONECATS, 'judge', '/nowhere'])} {closed}"
    assert subprocess.run(["bash", "-c", line], timeout=60, check=False).returncode == 2


def test_an_output_write_error_exits_with_3():
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [*DRONECATS, "episodes", "list"], stdout=full, stderr=subprocess.PIPE, text=True, check=False
        )
    assert done.returncode == 3
    assert "No space left on device" in done.stderr
    assert len(done.stderr.splitlines()) == 1
