"""Standard output and standard error that may lose their reader: what is lost are the words, never the work.

`dronecats fly … | head -1` closes the output in mid-flight. The flight goes on to its end, its results are in the run
folder, and the exit status is the flight's own.

All that a verb prints passes here, whoever's words they are: `printable` holds for every one of them.
"""

import contextlib
import errno
import io
import os
import shutil
import sys
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TextIO

from foundation.wording import printable

if TYPE_CHECKING:
    from dronecats.report.table import ReportTable


def show(*tables: "ReportTable", file: TextIO | None = None) -> None:
    """Print tables with a free line between two: as wide as the terminal, or as wide as they are into a file or pipe.

    So a search in a pipe finds a row, its words included, on one line.
    """
    from dronecats.report.writers import as_terminal

    file = file or sys.stdout
    columns = max(40, shutil.get_terminal_size().columns) if file.isatty() else None
    print("\n\n".join(as_terminal(table, columns) for table in tables), file=file, flush=True)


class Lossy(io.FileIO):
    """A file descriptor of ours that goes on as the null device once nobody takes what is written.

    `on_loss` is called once, with the error. `fault` is that error, unless a reader just went away, as `head` does:
    then it had what it wanted.
    """

    def __init__(self, descriptor: int, on_loss: Callable[[OSError], None] = lambda error: None) -> None:
        super().__init__(descriptor, "wb", closefd=False)
        self._on_loss = on_loss
        self.fault: OSError | None = None

    def write(self, data: Any, /) -> int:
        """Return how many bytes were taken: all of them, when nobody takes any more."""
        try:
            return super().write(data)
        except OSError as error:
            null = os.open(os.devnull, os.O_WRONLY)
            os.dup2(null, self.fileno())
            os.close(null)
            self.fault = error if error.errno != errno.EPIPE else None
            with contextlib.suppress(OSError):
                self._on_loss(error)
            return memoryview(data).nbytes


class Printing(io.TextIOWrapper):
    """A stream of text that nobody's words can steer a terminal by."""

    def write(self, text: str, /) -> int:
        """Write a text, made printable; return how many characters it has."""
        super().write(printable(text))
        return len(text)

    def draw(self, text: str) -> None:
        """Write words of our own as they are."""
        super().write(text)


class Drawing:
    """Standard error for a bar of progress, which goes back to the beginning of its line. For our words only."""

    def write(self, text: str) -> int:
        """Write a text as it is; return how many characters it has."""
        (sys.stderr.draw if isinstance(sys.stderr, Printing) else sys.stderr.write)(text)
        return len(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(sys.stderr, name)


class Output:
    """Standard output and error of this process while a verb is at work: `with Output(note) as output`."""

    def __init__(self, note: str | None = None) -> None:
        """`note` is said on standard error when the reader of the output goes away."""
        self._note = note
        self._raw: Lossy | None = None
        self._before = (sys.stdout, sys.stderr)

    def __enter__(self) -> "Output":
        # a test, or whoever imports us, may have put something of its own in their place
        if sys.__stderr__ is not None and sys.stderr is sys.__stderr__:
            sys.stderr = _text(sys.stderr, Lossy(sys.stderr.fileno()), "backslashreplace")
        if sys.__stdout__ is not None and sys.stdout is sys.__stdout__:
            self._raw = Lossy(sys.stdout.fileno(), self._tell)
            sys.stdout = _text(sys.stdout, self._raw, "replace")  # a terminal without ° or ≤ shows a question mark
        return self

    def __exit__(self, *_: object) -> None:
        self._flush()
        sys.stdout, sys.stderr = self._before

    def _flush(self) -> None:
        for stream in (sys.stdout, sys.stderr):
            if stream is not None:  # as after `>&-`
                stream.flush()

    def fault(self) -> str | None:
        """Return why the output could not be written, such as a full disk; None when it was, or its reader left."""
        self._flush()
        error = self._raw.fault if self._raw else None
        return (error.strerror or str(error)) if error else None

    def _tell(self, error: OSError) -> None:
        if self._note:
            print(self._note, file=sys.stderr)


def _text(stream: Any, raw: Lossy, errors: str) -> Printing:
    stream.flush()
    by_line = stream.line_buffering or stream.write_through  # the latter where Python runs unbuffered
    return Printing(io.BufferedWriter(raw), stream.encoding, errors, line_buffering=by_line)
