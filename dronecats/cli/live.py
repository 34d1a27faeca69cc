"""The progress of a long run on standard error: a bar on a terminal, a line now and then elsewhere."""

import sys
import time
from typing import Any

from dronecats.cli.output import Drawing
from foundation.wording import printable

EVERY_S = 10.0  # wall s between two lines in a log
BAR = "{bar:10} {desc}"  # tqdm cuts it off at the terminal's width


class Live:
    """Shows how many of `total` units are done, with a line of text that changes."""

    def __init__(self, total: int) -> None:
        from tqdm import tqdm

        self._bar: Any = None
        self._file = Drawing()  # the same object for bar and lines: tqdm clears only bars of the file that it writes to
        if sys.stderr.isatty():
            self._bar = tqdm(total=total, file=self._file, bar_format=BAR, dynamic_ncols=True, leave=False)
        self._due_s, self._last = 0.0, ""

    def say(self, line: str) -> None:
        """Print a line that stays."""
        if self._bar is not None:
            self._bar.write(printable(line), file=self._file)
        else:
            print(line, file=sys.stderr, flush=True)

    def now(self, line: str, done: int) -> None:
        """Show the newest state: on a terminal in the place of the one before, in a log at most every `EVERY_S`."""
        if self._bar is not None:
            self._bar.n = done
            self._bar.set_description_str(printable(line))
        elif time.monotonic() >= self._due_s:
            self._print(line)

    def close(self, line: str = "") -> None:
        """Remove the bar and print the last state, unless a log has it already."""
        if self._bar is not None:
            self._bar.close()
            self._bar = None
        if line and line != self._last:
            self._print(line)

    def _print(self, line: str) -> None:
        self._due_s, self._last = time.monotonic() + EVERY_S, line
        print(line, file=sys.stderr, flush=True)
