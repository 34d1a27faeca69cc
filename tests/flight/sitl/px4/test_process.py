"""A PX4 process never outlives its parent. A command that cannot run is reported before anything starts."""

import os
import signal
import subprocess
import sys
import time

import psutil
import pytest

from dronecats.flight.sitl.px4 import Px4Process, arguments, environment
from foundation.errors import UsageError

# a typical wrapper script: it starts PX4 in the background and waits; it writes the file `pids` last
WRAPPER = "echo $PX4_SIM_MODEL $PX4_INSTANCE $PWD; sleep 600 & sleep 601 & echo $! > pids; wait"


def running(folder):
    return [p for p in psutil.process_iter(["cmdline", "cwd"]) if p.info["cwd"] == str(folder)]


def wait_for(condition):
    due_s = time.monotonic() + 20.0
    while not condition():
        assert time.monotonic() < due_s
        time.sleep(0.02)


@pytest.fixture
def script(tmp_path):
    path = tmp_path / "start px4.sh"
    path.write_text(f"#!/bin/sh\n{WRAPPER}\n")
    path.chmod(0o755)
    return path


def test_px4_runs_in_its_own_folder_and_ends_with_all_its_child_processes(tmp_path, script, monkeypatch):
    monkeypatch.delenv("PX4_SIM_MODEL", raising=False)
    folder = tmp_path / "vehicle-1"
    process = Px4Process(f"'{script}' {{instance}}", 3, folder, folder / "px4.log", 1.0)
    wait_for(lambda: (folder / "pids").exists())
    assert process.poll() is None
    process.close()
    assert running(folder) == []
    assert (folder / "px4.log").read_text().split() == ["none_iris", "3", str(folder)]


def test_px4_ends_when_its_parent_is_killed(tmp_path, script):
    folder = tmp_path / "vehicle-1"
    code = f"""
import time
from pathlib import Path
from dronecats.flight.sitl.px4 import Px4Process
Px4Process({f"'{script}'"!r}, 0, Path({str(folder)!r}), Path({str(folder / "px4.log")!r}), 1.0)
time.sleep(600)
"""
    parent = subprocess.Popen([sys.executable, "-c", code])
    wait_for(lambda: (folder / "pids").exists())
    assert running(folder)
    os.kill(parent.pid, signal.SIGKILL)
    parent.wait()
    wait_for(lambda: running(folder) == [])


def test_the_exit_status_is_reported_and_px4_can_be_restarted(tmp_path):
    process = Px4Process("sh -c 'exit 7'", 0, tmp_path, tmp_path / "px4.log", 1.0)
    for _ in range(2):
        wait_for(lambda: process.poll() is not None)
        assert process.poll() == 7
        process.restart()
    process.close()


def test_paths_in_the_command_may_be_relative_to_the_current_folder(tmp_path, monkeypatch):
    (tmp_path / "build").mkdir()
    monkeypatch.chdir(tmp_path)
    assert arguments("sh -i {instance} ./build other/none", 2) == [
        "sh",
        "-i",
        "2",
        str(tmp_path / "build"),
        "other/none",
    ]


@pytest.mark.parametrize("command", ["", "no-such-program -d", "'unfinished"])
def test_a_command_that_cannot_be_run_is_reported(command):
    with pytest.raises(UsageError, match="--px4"):
        arguments(command, 0)


def test_the_environment_has_the_variables_of_px4s_start_script(monkeypatch):
    for name in ("PX4_SIM_MODEL", "PX4_SYS_AUTOSTART", "PX4_SIM_SPEED_FACTOR"):
        monkeypatch.delenv(name, raising=False)
    assert environment(2, 1.0)["PX4_SIM_MODEL"] == "none_iris"
    assert "PX4_SIM_SPEED_FACTOR" not in environment(0, 1.0)
    assert environment(0, 4.0)["PX4_SIM_SPEED_FACTOR"] == "4"
    monkeypatch.setenv("PX4_SYS_AUTOSTART", "4001")
    assert "PX4_SIM_MODEL" not in environment(0, 1.0)
