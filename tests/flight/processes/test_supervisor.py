import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from dronecats.flight.processes.supervisor import ChildKind, Supervisor
from dronecats.flight.run.pilot import PILOT
from dronecats.pilots.server import PilotConfig
from foundation.errors import InfrastructureError, LinkError, UsageError
from tests.flight.processes.ending_part import EndingConfig

ENDING = ChildKind("ending", "tests.flight.processes.ending_part:EndingPart", EndingConfig)


@pytest.fixture
def supervisor(tmp_path):
    made = Supervisor(tmp_path)
    yield made
    made.close()


def gone(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    return Path(f"/proc/{pid}/stat").read_text().split(")")[1].split()[0] == "Z"


def test_a_child_reports_its_address_and_ends_when_the_supervisor_closes(supervisor):
    child = supervisor.start(PILOT, PilotConfig(pilot="blind"))
    assert child.ready()["base_url"].startswith("http://127.0.0.1:")
    supervisor.check()
    supervisor.close()
    assert gone(child.pid)


@pytest.mark.parametrize("asks", [False, True], ids=["looked after", "told something"])
def test_the_error_of_an_ended_child_quotes_its_output(supervisor, asks):
    child = supervisor.start(ENDING, EndingConfig(turns=3))
    child.ready()
    os.waitid(os.P_PID, child.pid, os.WEXITED | os.WNOWAIT)
    with pytest.raises(InfrastructureError, match="the wire is out"):
        child.do("begin") if asks else supervisor.check()


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSEGV])
def test_the_error_of_a_killed_child_names_the_child_and_the_signal(supervisor, tmp_path, number):
    """After a crash, the log also has the stacks of the threads."""
    child = supervisor.start(ENDING, EndingConfig())
    child.ready()
    os.kill(child.pid, number)
    os.waitid(os.P_PID, child.pid, os.WEXITED | os.WNOWAIT)
    with pytest.raises(InfrastructureError, match=f"ending.*{number.name}"):
        supervisor.check()
    assert ("processes/child.py" in (tmp_path / "ending.log").read_text()) == (number == signal.SIGSEGV)


def looks(supervisor, until, limit_s=60):
    """Check repeatedly, as a flight does, until a condition holds."""
    deadline = time.monotonic() + limit_s
    while not until():
        assert time.monotonic() < deadline, "it never came to that"
        supervisor.check()
        time.sleep(0.01)  # the flight's tick; nothing in this test depends on it


def test_a_hanging_child_is_reported_with_its_log_and_later_commands_fail_at_once(tmp_path):
    supervisor = Supervisor(tmp_path, answer_s=1.0)
    child = supervisor.start(ENDING, EndingConfig())
    child.ready()
    os.kill(child.pid, signal.SIGSTOP)
    words = r"1 s.*ending\.log"
    with pytest.raises(InfrastructureError, match=words):
        looks(supervisor, lambda: False)
    with pytest.raises(InfrastructureError, match=words):
        child.do("begin", 1e6)  # fails at once instead of waiting for eleven days
    supervisor.close()
    assert gone(child.pid)


def test_a_hanging_child_is_reported_as_the_cause_of_another_error(tmp_path):
    supervisor = Supervisor(tmp_path)
    well, stopped = (supervisor.start(ChildKind(name, ENDING.part, EndingConfig), EndingConfig()) for name in "ab")
    for child in (well, stopped):
        child.ready()
    symptom = LinkError("the vehicle has been silent")
    assert supervisor.cause(symptom, within_s=0.5) is symptom
    beat: Any = stopped._heartbeat
    beat._answered_s = None  # due at once
    os.kill(stopped.pid, signal.SIGSTOP)
    named = supervisor.cause(symptom, within_s=0.5)
    assert isinstance(named, InfrastructureError)
    assert re.search(r"\bb\b.*hangs.*b\.log", str(named))
    supervisor.close()


def test_an_ended_child_is_reported_as_the_cause_of_another_error(supervisor):
    child = supervisor.start(ENDING, EndingConfig())
    child.ready()
    child._process.kill()
    child._process.wait()
    assert "SIGKILL" in str(supervisor.cause(LinkError("the vehicle has been silent")))


def test_a_child_that_pauses_briefly_recovers(supervisor):
    child = supervisor.start(ENDING, EndingConfig())
    child.ready()
    os.kill(child.pid, signal.SIGSTOP)
    supervisor.check()
    supervisor.check()
    os.kill(child.pid, signal.SIGCONT)
    looks(supervisor, lambda: child._heartbeat._answered_s is not None)


def test_a_heartbeat_is_never_taken_for_the_answer_to_a_command(supervisor):
    child = supervisor.start(ENDING, EndingConfig())
    child.ready()
    for _ in range(3):
        child._heartbeat._answered_s = None  # due at once
        supervisor.check()
        assert child.do("begin") is None
        assert not child._answers


def test_a_child_that_is_not_ready_yet_needs_no_heartbeat(tmp_path):
    supervisor = Supervisor(tmp_path, answer_s=0.0)
    child = supervisor.start(ENDING, EndingConfig())
    for _ in range(3):
        supervisor.check()
        time.sleep(0.01)
    child.ready()
    supervisor.close()


def test_a_usage_error_in_a_child_is_raised_as_a_usage_error(supervisor):
    first = supervisor.start(PILOT, PilotConfig(pilot="blind"))
    port = int(first.ready()["base_url"].split(":")[2].split("/")[0])
    with pytest.raises(UsageError, match=str(port)):
        supervisor.start(PILOT, PilotConfig(pilot="blind", port=port)).ready()


def test_children_of_a_killed_parent_end_by_themselves(tmp_path):
    script = (
        "import sys, time\nfrom pathlib import Path\n"
        "from dronecats.flight.processes.supervisor import ChildKind, Supervisor\n"
        "from tests.flight.processes.ending_part import EndingConfig\n"
        "ending = ChildKind('ending', 'tests.flight.processes.ending_part:EndingPart', EndingConfig)\n"
        "s = Supervisor(Path(sys.argv[1]))\nc = s.start(ending, EndingConfig())\nc.ready()\n"
        "print(c.pid, flush=True)\ntime.sleep(60)\n"
    )
    parent = subprocess.Popen([sys.executable, "-c", script, str(tmp_path)], stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    pid = int(parent.stdout.readline())
    parent.kill()
    parent.wait()
    parent.stdout.close()
    deadline = time.monotonic() + 10
    while not gone(pid):
        assert time.monotonic() < deadline, "the child outlived its parent"
        time.sleep(0.05)  # polls, because a process that is not our child cannot be waited for
