"""Starts the processes a flight stands on, watches them, and never leaves one behind."""

import contextlib
import json
import math
import os
import select
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from dronecats.border.errors import InfrastructureError, UsageError

READY_S = 600.0  # wall seconds; covers the first run's compilation on a slow and busy machine
ANSWER_S = 30.0
CLOSE_S = 5.0


class ChildProcess:
    """One supervised process. Raises InfrastructureError, in one sentence, when it is not what it should be."""

    def __init__(self, kind: str, config: dict[str, Any], log: Path) -> None:
        self.kind, self.log = kind, log
        with log.open("ab") as errors:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "dronecats.run.child", kind],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=errors,
                start_new_session=True,  # a Ctrl-C in the terminal reaches the parent alone
            )
        self._buffer = b""
        self._say(config)

    @property
    def pid(self) -> int:
        return self._process.pid

    def ready(self, waiting: Callable[[], None] = lambda: None) -> dict[str, Any]:
        """Wait until the child is ready and return what it announced; `waiting` is called twice a second."""
        answer = self._answer(READY_S, waiting)
        if "ready" not in answer:
            raise self._fault(answer)
        return dict(answer["ready"])

    def do(self, command: str, timeout_s: float | None = ANSWER_S, /, **arguments: Any) -> Any:
        """Have a command carried out and return its answer; a `timeout_s` of None waits for as long as it lives."""
        self._say({"do": command, **arguments})
        answer = self._answer(math.inf if timeout_s is None else timeout_s, lambda: None)
        if "done" not in answer:
            raise self._fault(answer)
        return answer["done"]

    def check(self) -> None:
        """Raise InfrastructureError if the process has ended."""
        status = self._process.poll()
        if status is not None:
            raise InfrastructureError(f"the {self.kind} process ended in flight ({_ending(status)}); see {self.log}")

    def kill(self) -> None:
        """End the process at once, whatever it is doing. May be called from another thread."""
        self._process.kill()
        self._process.wait()

    def close(self) -> None:
        """End the process: its standard input closes, which it obeys; a deaf one is killed."""
        if self._process.stdin:
            with contextlib.suppress(OSError):
                self._process.stdin.close()
        try:
            self._process.wait(CLOSE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        if self._process.stdout:
            self._process.stdout.close()

    def _say(self, value: dict[str, Any]) -> None:
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(json.dumps(value).encode() + b"\n")
            self._process.stdin.flush()
        except OSError:
            self._process.wait(CLOSE_S)
            self.check()

    def _answer(self, timeout_s: float, waiting: Callable[[], None]) -> dict[str, Any]:
        assert self._process.stdout is not None
        descriptor, waited_s = self._process.stdout.fileno(), 0.0
        while b"\n" not in self._buffer:
            if not select.select([descriptor], [], [], 0.5)[0]:
                waited_s += 0.5
                waiting()
                if waited_s >= timeout_s:
                    raise InfrastructureError(f"the {self.kind} process does not answer for {timeout_s:g} s")
                continue
            data = os.read(descriptor, 65536)
            if not data:
                status = self._process.wait(CLOSE_S)
                raise InfrastructureError(f"the {self.kind} process ended ({_ending(status)}); see {self.log}")
            self._buffer += data
        line, _, self._buffer = self._buffer.partition(b"\n")
        return dict(json.loads(line))

    def _fault(self, answer: dict[str, Any]) -> Exception:
        text = str(answer.get("error", "an answer it should not give"))
        return UsageError(text) if answer.get("status") == 2 else InfrastructureError(f"{self.kind}: {text}")


class Supervisor:
    """The children of one flight, closed together, the newest first."""

    def __init__(self, log_dir: Path) -> None:
        self._log_dir = log_dir
        self.children: list[ChildProcess] = []

    def start(self, kind: str, config: dict[str, Any]) -> ChildProcess:
        child = ChildProcess(kind, config, self._log_dir / f"{kind}.log")
        self.children.append(child)
        return child

    def check(self) -> None:
        """Raise InfrastructureError if any child has ended."""
        for child in self.children:
            child.check()

    def close(self) -> None:
        while self.children:
            self.children.pop().close()


def _ending(status: int) -> str:
    if status >= 0:
        return f"exit status {status}"
    try:
        return f"killed by {signal.Signals(-status).name}"
    except ValueError:
        return f"killed by signal {-status}"
