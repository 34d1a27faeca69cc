"""Parallel work: every item is processed, an error ends the whole call, and no worker outlives the caller."""

import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import psutil
import pytest

from episodes.authoring.processes import process_map
from foundation.errors import InfrastructureError


def ignores_interrupts(process: psutil.Process) -> bool:
    status = Path(f"/proc/{process.pid}/status").read_text()
    ignored = next(line for line in status.splitlines() if line.startswith("SigIgn:"))
    return bool(int(ignored.split()[1], 16) >> (signal.SIGINT - 1) & 1)


def sleepers(seconds: float) -> tuple[subprocess.Popen[str], list[psutil.Process]]:
    """Start a process in its own session, with work for two workers. Return the process and its workers."""
    code = (
        "import time; from episodes.authoring.processes import process_map; "
        f"list(process_map(time.sleep, [{seconds}] * 4, 2))"
    )
    parent = subprocess.Popen([sys.executable, "-c", code], stderr=subprocess.PIPE, text=True, start_new_session=True)
    itself = psutil.Process(parent.pid)
    workers: list[psutil.Process] = []
    while len(workers) < 2 or ignores_interrupts(itself):
        assert parent.poll() is None, parent.stderr
        workers = [p for p in itself.children() if any("spawn_main" in word for word in p.cmdline())]
    return parent, workers


def test_every_item_is_processed_and_errors_are_raised() -> None:
    assert sorted(process_map(abs, [-1, 2, -3], jobs=2)) == [1, 2, 3]
    assert list(process_map(abs, [-4, 2], jobs=1)) == [4, 2]
    items: list[Any] = [1, "x"]
    with pytest.raises(TypeError):
        list(process_map(abs, items, jobs=2))


def test_a_worker_that_exits_is_reported() -> None:
    with pytest.raises(InfrastructureError, match="process"):
        list(process_map(os._exit, [1, 1], jobs=2))


def test_workers_end_when_their_parent_is_killed() -> None:
    parent, workers = sleepers(600.0)
    parent.kill()
    parent.wait()
    _, alive = psutil.wait_procs(workers, timeout=30)
    assert not alive


def test_only_the_parent_handles_an_interrupt_and_it_ends_at_once() -> None:
    parent, workers = sleepers(600.0)
    assert all(ignores_interrupts(worker) for worker in workers)
    os.killpg(parent.pid, signal.SIGINT)
    _, errors = parent.communicate(timeout=60)
    assert errors.count("Traceback") == 1
    _, alive = psutil.wait_procs(workers, timeout=30)
    assert not alive


def test_an_interrupt_during_the_distribution_of_work_is_not_lost() -> None:
    code = """if True:
        import os, signal, time
        from episodes.authoring.processes import process_map

        class Items(list):
            def __iter__(self):
                for item in super().__iter__():
                    yield item
                    os.kill(os.getpid(), signal.SIGINT)

        try:
            list(process_map(time.sleep, Items([600.0] * 4), 2))
        except KeyboardInterrupt:
            print("interrupted")
    """
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert done.stdout.split() == ["interrupted"], done.stderr
