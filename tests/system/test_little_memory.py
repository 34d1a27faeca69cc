"""With too little address space, flying commands end with a one-line error before they load heavy modules."""

import json
import resource
import subprocess
import sys

import pytest

from dronecats.cli.main import FLIGHT_GB
from foundation import machine
from foundation.errors import UsageError

LIMITED = """
import resource, sys
resource.setrlimit(resource.RLIMIT_AS, (1_000_000 * 1024,) * 2)
from dronecats.cli.main import main
status = main(sys.argv[1:])
loaded = [name for name in ("numpy", "numba") if name in sys.modules]
print(*loaded)
sys.exit(status)
"""


def limited(*words):
    command = [sys.executable, "-c", LIMITED, *words]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.mark.parametrize("words", [["fly", "--sitl"], ["sitl"], ["bench"]], ids=" ".join)
def test_flying_commands_report_needed_and_available_memory(words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = limited(*words)
    assert done.returncode == 2, done.stderr
    assert done.stderr.count("\n") == 1
    assert "2.0 GB" in done.stderr or machine.on_this_machine(FLIGHT_GB) > FLIGHT_GB
    assert "1.0 GB" in done.stderr
    assert done.stdout.strip() == ""  # nothing was loaded
    assert list(tmp_path.iterdir()) == []


def test_commands_that_need_little_memory_work():
    assert limited("models", "list").returncode == 0


def test_doctor_reports_the_memory_limit():
    done = limited("doctor", "--json")
    assert done.returncode == 1
    report = json.loads(done.stdout.splitlines()[0])
    assert "1.0 GB" in report["findings"][-1]["detail"]


def test_memory_check_rejects_only_a_need_above_the_limit(monkeypatch):
    monkeypatch.setattr(resource, "getrlimit", lambda which: (resource.RLIM_INFINITY,) * 2)
    machine.check("a flight", 1e6)
    monkeypatch.setattr(resource, "getrlimit", lambda which: (10**9, resource.RLIM_INFINITY))
    machine.check("what needs nothing", 0.0)
    with pytest.raises(UsageError, match=r"5\.\d GB.*1\.0 GB.*ulimit -v"):
        machine.check("a flight", 5.0)


def test_more_cores_need_more_memory(monkeypatch):
    monkeypatch.setattr("os.cpu_count", lambda: 64)
    assert machine.on_this_machine(2.0) > 5.0
