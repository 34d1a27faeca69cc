"""A pseudo-terminal for a program, and the final lines of its screen."""

import fcntl
import os
import struct
import subprocess
import termios
from collections.abc import Sequence
from pathlib import Path


def in_terminal(command: Sequence[str], columns: int = 80, cwd: Path | None = None) -> tuple[int, str]:
    """Run a command in a terminal of this width; return its exit status and the characters it printed."""
    reading, writing = os.openpty()
    fcntl.ioctl(writing, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
    with subprocess.Popen(command, stdin=writing, stdout=writing, stderr=writing, cwd=cwd) as process:
        os.close(writing)
        received = b""
        with open(reading, "rb", buffering=0) as terminal:
            while part := _part(terminal.fileno()):
                received += part
        return process.wait(), received.decode()


def _part(terminal: int) -> bytes:
    try:
        return os.read(terminal, 65536)
    except OSError:  # EIO: no process holds the other end any more
        return b""


def screen(received: str) -> list[str]:
    """Return the lines on the screen. Text after a carriage return overwrites the line from its beginning."""
    lines = []
    for line in received.replace("\r\n", "\n").split("\n"):
        shown = ""
        for part in line.split("\r"):
            shown = part + shown[len(part) :]
        lines.append(shown.rstrip())
    return lines
