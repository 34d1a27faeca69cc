import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from dronecats.border.errors import InfrastructureError, UsageError
from dronecats.run.supervisor import Supervisor


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


def test_a_child_says_what_it_bound_and_ends_with_its_parent(supervisor):
    child = supervisor.start("pilot", {"pilot": "blind"})
    assert child.ready()["base_url"].startswith("http://127.0.0.1:")
    supervisor.check()
    supervisor.close()
    assert gone(child.pid)


def test_a_killed_child_is_named_with_the_signal(supervisor):
    child = supervisor.start("pilot", {"pilot": "blind"})
    child.ready()
    os.kill(child.pid, signal.SIGKILL)
    os.waitid(os.P_PID, child.pid, os.WEXITED | os.WNOWAIT)
    with pytest.raises(InfrastructureError, match=r"the pilot process ended in flight \(killed by SIGKILL"):
        supervisor.check()


def test_wrong_usage_in_a_child_is_wrong_usage_here(supervisor):
    first = supervisor.start("pilot", {"pilot": "blind"})
    port = int(first.ready()["base_url"].split(":")[2].split("/")[0])
    with pytest.raises(UsageError, match=str(port)):
        supervisor.start("pilot", {"pilot": "blind", "port": port}).ready()


def test_children_of_a_killed_parent_end_by_themselves(tmp_path):
    script = (
        "import sys, time\nfrom pathlib import Path\nfrom dronecats.run.supervisor import Supervisor\n"
        "s = Supervisor(Path(sys.argv[1]))\nc = s.start('pilot', {'pilot': 'blind'})\nc.ready()\n"
        "print(c.pid, flush=True)\ntime.sleep(60)\n"
    )
    parent = subprocess.Popen([sys.executable, "-c", script, str(tmp_path)], stdout=subprocess.PIPE, text=True)
    pid = int(parent.stdout.readline())
    parent.kill()
    parent.wait()
    parent.stdout.close()
    deadline = time.monotonic() + 10
    while not gone(pid):
        assert time.monotonic() < deadline, "the child outlived its parent"
        time.sleep(0.05)  # polls another process; there is nothing to wait on for a process that is not our child
