"""Runs one example against one fresh simulator, in the network of this process. The test starts it as a subprocess.

Argument: a JSON object (see `main`). The last line of output is a JSON object {outcome, seconds, lines, hits}. `hits`
are the vehicle's contacts as reported on the truth bus. In its own network namespace, the process first brings the
loopback interface up.
"""

import contextlib
import json
import os
import queue
import re
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

from pymavlink import mavutil

READY = "Ctrl-C ends it"
OPEN_FIELD = Path(__file__).with_name("open_field.py")
START_S = 240.0  # the first start of an installation compiles
GROUND_STATION, ARM = 18570, 400  # the simulator's port for ground stations; MAV_CMD_COMPONENT_ARM_DISARM
TRUTH = 19410  # the simulator sends the truth here
SETTLE_S = 15.0  # time after a flight, to disarm and to close the log


class Script:
    """A child process whose lines can be awaited."""

    def __init__(self, command: list[str], where: Path) -> None:
        environment = {**os.environ, "PYTHONUNBUFFERED": "1", "PYTHONWARNINGS": "ignore"}
        self.process = subprocess.Popen(
            command, cwd=where, env=environment, text=True, errors="replace", start_new_session=True,
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )  # fmt: skip
        self.lines: list[str] = []
        self._new: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        assert self.process.stdout
        for line in self.process.stdout:
            self._new.put(line.rstrip("\n"))
        self._new.put(None)

    def next(self, timeout_s: float) -> str | None:
        """Return the next line; None at the end of the output. Raises queue.Empty."""
        line = self._new.get(timeout=max(timeout_s, 0.0))
        if line is not None:
            self.lines.append(line)
        return line

    def end(self) -> None:
        """Interrupt the process, as Ctrl-C does. Then kill it if it still runs, and its remaining children."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGINT)
            with contextlib.suppress(subprocess.TimeoutExpired):
                self.process.wait(10)
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait(10)


def follow(script: Script, shows: dict[str, int], limit_s: float, endless: bool, linger_s: float) -> str:
    """Wait until a script has printed every expected line. Return "ok", or a short description of the fault."""
    missing = dict(shows)
    deadline = time.monotonic() + limit_s
    shown = False
    while True:
        try:
            line = script.next(deadline - time.monotonic())
        except queue.Empty:
            if shown:
                return "ok"
            wanted = ", ".join(f"{count} x {pattern!r}" for pattern, count in missing.items())
            return f"not within {limit_s:.0f} s: {wanted or 'the end of the script'}"
        if line is None:
            break
        for pattern in [pattern for pattern in missing if re.search(pattern, line)]:
            missing[pattern] -= 1
            if not missing[pattern]:
                del missing[pattern]
        if endless and not missing and not shown:
            shown = True
            deadline = time.monotonic() + linger_s
    status = script.process.wait(10)
    if endless or status:
        return f"ended with exit status {status}"
    return "never printed " + ", ".join(map(repr, missing)) if missing else "ok"


def arm_and_disarm(ended: threading.Event) -> None:
    """Act as a ground station that causes events with a STATUSTEXT."""
    link = mavutil.mavlink_connection(f"udpout:127.0.0.1:{GROUND_STATION}", source_system=255)
    armed = 0
    while not ended.wait(2.0):
        armed = 1 - armed
        link.mav.heartbeat_send(6, 8, 0, 0, 4)
        link.mav.command_long_send(1, 1, ARM, 0, armed, 0, 0, 0, 0, 0, 0)
    link.close()


def listen(ended: threading.Event, hits: list[str]) -> None:
    """Record the vehicle's contacts, as reported on the truth bus."""
    bus = mavutil.mavlink_connection(f"udpin:127.0.0.1:{TRUTH}")
    while not ended.is_set():
        message = bus.recv_match(type="STATUSTEXT", blocking=True, timeout=0.2)
        if message is not None:
            hits.append(message.text)
    bus.close()


def main() -> int:
    """Run the task in argv[1]. Keys: python, folder, example (see example_table), where, state, isolated."""
    task = json.loads(sys.argv[1])
    if task["isolated"]:
        subprocess.run(["ip", "link", "set", "lo", "up"], check=True)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # the finally block ends running scripts
    example, where = task["example"], Path(task["where"])
    running: list[Script] = []
    ended = threading.Event()
    hits: list[str] = []

    def start(*command: str) -> Script:
        running.append(Script(list(command), where))
        return running[-1]

    def example_script(name: str) -> list[str]:
        return [task["python"], str(Path(task["folder"]) / name)]

    try:
        threading.Thread(target=listen, args=(ended, hits)).start()
        # the examples expect PX4's default home
        words = ["--episode", "residential-approaching-01", "--state", task["state"]]
        simulator = start(sys.executable, str(OPEN_FIELD), *words)
        outcome = follow(simulator, {READY: 1}, START_S, endless=True, linger_s=0.0)
        lines, began = simulator.lines, time.monotonic()
        if outcome == "ok" and example["after"]:
            flight = start(*example_script(example["after"]))
            outcome = follow(flight, {}, example["limit_s"], endless=False, linger_s=0.0)
            lines = flight.lines
            time.sleep(SETTLE_S)
        if outcome == "ok":
            if example["server"]:
                server = "import mavsdk.bin, importlib.resources as r; print(r.files(mavsdk.bin) / 'mavsdk_server')"
                located = subprocess.run(
                    [task["python"], "-W", "ignore", "-c", server], check=True, capture_output=True, text=True
                )
                start(located.stdout.strip(), "-p", "50051", example["server"])
            if example["eventful"]:
                threading.Thread(target=arm_and_disarm, args=(ended,)).start()
            began = time.monotonic()
            script = start(*example_script(example["script"]), *example["arguments"])
            outcome = follow(script, example["shows"], example["limit_s"], example["endless"], example["linger_s"])
            lines = script.lines
        answer = {"outcome": outcome, "seconds": time.monotonic() - began, "lines": lines, "hits": hits}
    finally:
        ended.set()
        for script in reversed(running):
            script.end()
    sys.stdout.write(json.dumps(answer) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
