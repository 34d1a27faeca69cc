"""What a long run says of itself: one line that changes on a terminal, and a line now and then where there is none."""

import time
from typing import Any, TextIO

EVERY_S = 10.0  # wall s between two lines in a log


class Live:
    """Says the newest of what it is told."""

    def __init__(self, stream: TextIO) -> None:
        from tqdm import tqdm

        self._stream, self._tty = stream, stream.isatty()
        self._bar: Any = tqdm(file=stream, bar_format="{desc}", dynamic_ncols=True) if self._tty else None
        self._due_s, self._last = 0.0, ""

    def say(self, line: str) -> None:
        """Say a line that stays."""
        if self._bar is not None:
            self._bar.write(line, file=self._stream)
        else:
            print(line, file=self._stream, flush=True)

    def now(self, line: str) -> None:
        """Say how it stands, in the place of what was said last; in a log not too often."""
        if self._bar is not None:
            self._bar.set_description_str(line)
        elif time.monotonic() >= self._due_s:
            self._print(line)

    def close(self, line: str = "") -> None:
        """Say how it stood in the end, and let go of the line."""
        if self._bar is not None:
            if line:
                self._bar.set_description_str(line)
            self._bar.close()
            self._bar, line = None, ""
        if line and line != self._last:
            self._print(line)

    def _print(self, line: str) -> None:
        self._due_s, self._last = time.monotonic() + EVERY_S, line
        print(line, file=self._stream, flush=True)
