"""A PX4 that the user's command starts for us: in a folder of its own, its output in a file, never orphaned."""

import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

from foundation.compiled import ROOT
from foundation.errors import UsageError
from foundation.redaction import keyless_environment

MODEL = "none_iris"  # PX4's airframe for a simulator that is somebody else's; rotors in the order of our quadrotors
CLOSE_S = 5.0
INSTANCE = "{instance}"  # what stands for the instance's number in a command


class Px4Process:
    """One PX4. Its parameters and logs stay in its folder; what it prints is added to `log`."""

    def __init__(self, command: str, instance: int, folder: Path, log: Path, speed: float) -> None:
        """Start it. Raises UsageError for a command that cannot be run."""
        self.folder, self.log = folder, log
        self._arguments = arguments(command, instance)
        self._environment = environment(instance, speed)
        self._process = self._start()

    def poll(self) -> int | None:
        """Return the exit status of a PX4 that has ended, None while it runs."""
        return self._process.poll()

    def restart(self) -> None:
        """Start a PX4 that has ended once more, in the same folder."""
        self.close()
        self._process = self._start()

    def close(self) -> None:
        """End PX4 and whatever the command has started beside it."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        try:
            self._process.wait(CLOSE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _start(self) -> "subprocess.Popen[bytes]":
        self.folder.mkdir(parents=True, exist_ok=True)
        with self.log.open("ab") as log:
            return subprocess.Popen(
                [sys.executable, "-m", "dronecats.flight.processes.guard", *self._arguments],
                cwd=self.folder,
                env=self._environment,
                stdin=subprocess.PIPE,
                stdout=log,
                stderr=log,
                start_new_session=True,  # a Ctrl-C in the terminal reaches us alone
            )


def arguments(command: str, instance: int) -> list[str]:
    """Return a command's words, with the instance filled in and paths that exist made absolute. Raises UsageError."""
    try:
        words = [word.replace(INSTANCE, str(instance)) for word in shlex.split(command)]
    except ValueError as error:
        raise UsageError(f"--px4 {command!r} cannot be split into words: {error}") from None
    if not words or shutil.which(words[0]) is None:
        raise UsageError(f"--px4 {command!r} names no program that can be run; give the path of PX4 or a script")
    return [os.path.abspath(word) if os.sep in word and os.path.exists(word) else word for word in words]


def environment(instance: int, speed: float) -> dict[str, str]:
    """Return the environment of a PX4: ours without keys, and what its start script asks for."""
    ours = keyless_environment(os.environ)
    if "PX4_SYS_AUTOSTART" not in ours:
        ours.setdefault("PX4_SIM_MODEL", MODEL)
    ours["PX4_INSTANCE"] = str(instance)
    if speed > 1.0:  # PX4 stretches its timeouts with it, so that they last as long for a client of real time
        ours["PX4_SIM_SPEED_FACTOR"] = f"{speed:g}"
    ours["PYTHONPATH"] = os.pathsep.join(filter(None, (str(ROOT), ours.get("PYTHONPATH"))))
    return ours
