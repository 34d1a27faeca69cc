"""Starts the child processes of a flight, watches them, and ends them all."""

import contextlib
import json
import math
import os
import select
import signal
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

import msgspec

from foundation.errors import DronecatsError, InfrastructureError, UsageError
from foundation.redaction import keyless_environment

HEARTBEAT_PERIOD_S = 1.0  # wall s from the answer to one heartbeat request until the next request
CHECK_MAX_S = 0.5  # wall s; each check adds at most this to the measured wait, so a pause of this process adds little


class Heartbeat:
    """Tracks the heartbeat of a process. The caller passes all times, in seconds of one monotonic clock."""

    def __init__(self, patience_s: float) -> None:
        """After `patience_s` without an answer, the process counts as hanging."""
        self.patience_s = patience_s
        self.is_pending = False
        self._answered_s: float | None = None
        self._looked_s: float | None = None
        self._waited_s = 0.0

    def is_due(self, now_s: float) -> bool:
        """Return whether the next request is due. No request is due while an answer is pending."""
        return not self.is_pending and (self._answered_s is None or now_s >= self._answered_s + HEARTBEAT_PERIOD_S)

    def sent(self, now_s: float) -> None:
        self.is_pending, self._looked_s, self._waited_s = True, now_s, 0.0

    def answered(self, now_s: float) -> None:
        self.is_pending, self._answered_s = False, now_s

    def pending_s(self, now_s: float) -> float:
        """Update and return how long (s) the answer has been pending; 0 if no answer is pending.

        Each call adds CHECK_MAX_S at most. So a pause by Ctrl-Z, or while the machine is suspended, hardly counts.
        """
        if not self.is_pending or self._looked_s is None:
            return 0.0
        self._waited_s += min(now_s - self._looked_s, CHECK_MAX_S)
        self._looked_s = now_s
        return self._waited_s

    def hangs(self, now_s: float) -> bool:
        """Update and return whether the answer has been pending for longer than `patience_s`."""
        return self.pending_s(now_s) > self.patience_s


READY_S = 600.0  # wall seconds; longest start of a child. In the first run the child compiles, slowly on a busy machine
ANSWER_S = 30.0  # wall seconds; longest wait for the answer to a command
# Longest wait for a heartbeat, wall seconds. A child answers between two calls of `Part.turn`. One call takes
# milliseconds, or seconds on a busy machine. A flight with a longer silence cannot be judged, because the socket of the
# silent process overflows. The agent waits longer for a picture, so this check reports first, and its error names the
# process.
HANG_S = 15.0
CAUSE_S = 10.0  # wall seconds; after an error, longest wait for a heartbeat of a process that may be the cause
CLOSE_S = 5.0  # wall seconds; longest wait for the end of a process before it is killed
C = TypeVar("C")


@dataclass(frozen=True, slots=True)
class ChildKind(Generic[C]):
    name: str  # used in messages and in the name of the log file
    part: str  # MODULE:NAME of a class or function that makes the `Part` from `config`; only the child imports it
    config: type[C]  # a frozen dataclass of JSON values
    needs_keys: bool = False  # whether the environment of the process has the API keys, for models


class ChildProcess:
    """One supervised process. The methods raise InfrastructureError if the process has ended or hangs."""

    def __init__(self, kind: ChildKind[C], config: C, log: Path, answer_s: float = HANG_S) -> None:
        """After `answer_s` without a heartbeat, the process counts as hanging."""
        self.kind, self.log, self._answer_s = kind.name, log, answer_s
        with log.open("ab") as errors:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "dronecats.flight.processes.child", kind.part],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=errors,
                env=None if kind.needs_keys else keyless_environment(os.environ),
                start_new_session=True,  # a Ctrl-C in the terminal reaches only the parent
            )
        self._buffer = b""
        self._answers: deque[dict[str, Any]] = deque()
        self._heartbeat: Heartbeat | None = None  # None until the process is ready, because it may compile for minutes
        self._silent_s = 0.0  # wall s without an answer; above 0: the process hangs, so no call waits for it
        self._send(msgspec.to_builtins(config))

    @property
    def pid(self) -> int:
        return self._process.pid

    def ready(self, waiting: Callable[[], None] = lambda: None) -> dict[str, Any]:
        """Wait until the child is ready and return its facts; `waiting` is called twice a second."""
        answer = self._answer(READY_S, waiting)
        if "ready" not in answer:
            raise self._fault(answer)
        self._heartbeat = Heartbeat(self._answer_s)
        return dict(answer["ready"])

    def do(self, command: str, timeout_s: float | None = ANSWER_S, /, **arguments: Any) -> Any:
        """Send a command and return its answer. `timeout_s` None: wait as long as the process lives.

        If a former call found that the process hangs, raise at once.
        """
        if self._silent_s:
            raise self._silence(0.0)
        self._send({"do": command, **arguments})
        answer = self._answer(math.inf if timeout_s is None else timeout_s, lambda: None)
        if "done" not in answer:
            raise self._fault(answer)
        return answer["done"]

    def check(self) -> None:
        """Raise InfrastructureError if the process has ended or no longer answers. Never waits.

        Call it repeatedly: one call requests a heartbeat, and a later call checks for the answer.
        """
        status = self._process.poll()
        if status is not None:
            raise self._end(status)
        beat, now_s = self._heartbeat, time.monotonic()
        if beat is None:
            return
        if beat.is_due(now_s):
            beat.sent(now_s)
            self._send({"alive": True})  # one request at a time, so that the pipe is never full
        elif self._has_output(0.0):
            self._take()
        if self._silent_s or beat.hangs(now_s):
            raise self._silence(beat.patience_s)

    def prove_alive(self, within_s: float) -> None:
        """Raise InfrastructureError if the process has ended, or gives no heartbeat within `within_s`.

        Waits only while an answer is pending. A healthy process answers within milliseconds.
        """
        self.check()
        beat = self._heartbeat
        while beat is not None and beat.is_pending:
            if self._has_output(0.1):
                self._take()
            elif beat.pending_s(time.monotonic()) > within_s:
                raise self._silence(within_s)

    def kill(self) -> None:
        """Kill the process immediately. May be called from another thread."""
        self._process.kill()
        self._process.wait()

    def close(self) -> None:
        """End the process. A process that hangs is killed at once."""
        close_process(self._process, 0.0 if self._silent_s else CLOSE_S)
        if self._process.stdout:
            self._process.stdout.close()

    def _send(self, value: dict[str, Any]) -> None:
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(json.dumps(value).encode() + b"\n")
            self._process.stdin.flush()
        except OSError:
            raise self._end(self._process.wait(CLOSE_S)) from None

    def _answer(self, timeout_s: float, waiting: Callable[[], None]) -> dict[str, Any]:
        waited_s = 0.0
        while not self._answers:
            if self._has_output(0.5):
                self._take()
                continue
            waited_s += 0.5
            waiting()
            if waited_s >= timeout_s:
                raise self._silence(timeout_s)
        return self._answers.popleft()

    def _has_output(self, timeout_s: float) -> bool:
        """Return whether output, or the end of the output, arrives within `timeout_s`."""
        assert self._process.stdout is not None
        return bool(select.select([self._process.stdout], [], [], timeout_s)[0])

    def _take(self) -> None:
        """Read output: handle heartbeats, keep other answers. Raises InfrastructureError if the process has ended."""
        assert self._process.stdout is not None
        data = os.read(self._process.stdout.fileno(), 65536)
        if not data:
            raise self._end(self._process.wait(CLOSE_S))
        self._parse(data)

    def _parse(self, data: bytes) -> None:
        *lines, self._buffer = (self._buffer + data).split(b"\n")
        for answer in map(json.loads, lines):
            if "alive" not in answer:
                self._answers.append(answer)
            elif self._heartbeat is not None:
                self._heartbeat.answered(time.monotonic())

    def _silence(self, seconds: float) -> InfrastructureError:
        """Return the error of a process that hangs, and store the length of the silence."""
        self._silent_s = max(self._silent_s, seconds)
        return InfrastructureError(f"the {self.kind} process hangs: no answer for {self._silent_s:g} s; see {self.log}")

    def _end(self, status: int) -> InfrastructureError:
        """Return the error of a process that has ended: the error that it reported, or else its exit status."""
        if (words := self._last_words()) is not None:
            return InfrastructureError(f"{self.kind}: {words}")
        when = " in flight" if self._heartbeat is not None else ""
        return InfrastructureError(f"the {self.kind} process ended{when} ({_ending(status)}); see {self.log}")

    def _last_words(self) -> str | None:
        """Return the error that the process reported before its end; None if it was killed or crashed."""
        assert self._process.stdout is not None
        while self._has_output(0.0) and (data := os.read(self._process.stdout.fileno(), 65536)):
            self._parse(data)
        return next((str(answer["error"]) for answer in self._answers if "error" in answer), None)

    def _fault(self, answer: dict[str, Any]) -> Exception:
        text = str(answer.get("error", "unexpected answer"))
        return UsageError(text) if answer.get("status") == 2 else InfrastructureError(f"{self.kind}: {text}")


def close_process(process: "subprocess.Popen[bytes]", wait_s: float = CLOSE_S) -> None:
    """End a process by closing its standard input. Kill it if it has not ended within `wait_s` (wall s)."""
    if process.stdin:
        with contextlib.suppress(OSError):
            process.stdin.close()
    try:
        process.wait(wait_s)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


class Supervisor:
    """The child processes of one flight. `close` ends all, the newest first."""

    def __init__(self, log_dir: Path, answer_s: float = HANG_S) -> None:
        self._log_dir, self._answer_s = log_dir, answer_s
        self.children: list[ChildProcess] = []

    def start(self, kind: ChildKind[C], config: C) -> ChildProcess:
        child = ChildProcess(kind, config, self._log_dir / f"{kind.name}.log", self._answer_s)
        self.children.append(child)
        return child

    def check(self) -> None:
        """Raise InfrastructureError if any child has ended or hangs. Never waits."""
        for child in self.children:
            child.check()

    def cause(self, error: DronecatsError, within_s: float = CAUSE_S) -> DronecatsError:
        """Return the error of a child that has ended or gives no heartbeat within `within_s`, or else `error`.

        For example, a process that hangs may cause a silent vehicle or a camera without pictures.
        """
        for child in self.children:
            try:
                child.prove_alive(within_s)
            except InfrastructureError as fault:
                return fault
        return error

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
