"""Prints tables, lines and progress. A closed pipe or a full disk does not stop the verb.

`dronecats fly … | head -1` closes the output during the flight. The flight continues to its end, and its result still
sets the exit status.

`printable` escapes control characters in all printed text, because the text may come from a model, a server or a file.
Only data for another program is written unchanged (`write_data`).
"""

import contextlib
import errno
import io
import os
import shutil
import sys
import textwrap
import time
from collections.abc import Callable
from typing import Any, TextIO

from dronecats.report.table import ReportTable
from dronecats.report.writers import as_terminal
from foundation.wording import printable

LOG_PERIOD_S = 10.0  # wall s between two progress lines in a log
BAR = "{bar:10} {desc}"  # tqdm truncates it to the terminal's width


def show(*tables: ReportTable, file: TextIO | None = None) -> None:
    """Print tables, separated by empty lines, wrapped at the terminal's width.

    In a file or pipe each row is one line, for tools such as grep.
    """
    file = file or sys.stdout
    columns = max(40, shutil.get_terminal_size().columns) if file.isatty() else None
    print("\n\n".join(as_terminal(table, columns) for table in tables), file=file, flush=True)


def print_wrapped(*lines: str, indent: str = "  ") -> None:
    """Print lines on standard output. In a terminal they are wrapped, with `indent` before continuation lines."""
    columns = max(40, shutil.get_terminal_size().columns) if sys.stdout.isatty() else None
    for line in lines:
        parts = textwrap.wrap(line, columns, subsequent_indent=indent, break_long_words=False) if columns else [line]
        print(*parts, sep="\n", flush=True)


def print_line(line: str) -> None:
    """Print a line on standard output and flush it."""
    print(line, flush=True)


def write_data(text: str) -> None:
    """Write data for another program on standard output. A terminal gets no control characters."""
    if isinstance(sys.stdout, Printing) and not sys.stdout.isatty():
        sys.stdout.draw(text)
    else:
        sys.stdout.write(text)


def print_note(line: str) -> None:
    """Print a line that is not a result on standard error."""
    print(line, file=sys.stderr, flush=True)


class Printing(io.TextIOWrapper):
    """A text stream that writes no control characters, so that no text can control the terminal, and that never fails.

    After a failed write the file descriptor becomes the null device, and `on_loss` is called once. `fault` is the
    error, but None if the reader (for example `head`) closed the pipe. The stream below this class has no Python code,
    because Ctrl-C could interrupt such code between the write and its return, and the text would be written twice.
    """

    def __init__(
        self,
        descriptor: int,
        encoding: str,
        errors: str,
        *,
        by_line: bool = False,
        on_loss: Callable[[], None] = lambda: None,
    ) -> None:
        raw = io.FileIO(descriptor, "wb", closefd=False)
        super().__init__(io.BufferedWriter(raw), encoding, errors, line_buffering=by_line)
        self._on_loss = on_loss
        self.fault: OSError | None = None

    def write(self, text: str, /) -> int:
        """Write a text without control characters. Return the number of characters in `text`."""
        self.draw(printable(text))
        return len(text)

    def draw(self, text: str) -> None:
        """Write text unchanged. A terminal may get only text of this program."""
        try:
            super().write(text)
        except OSError as error:
            self._lose(error)

    def flush(self) -> None:
        """Write what is buffered."""
        try:
            super().flush()
        except OSError as error:
            self._lose(error)

    def _lose(self, error: OSError) -> None:
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, self.fileno())
        os.close(null)
        self.fault = error if error.errno != errno.EPIPE else None
        with contextlib.suppress(OSError):
            self._on_loss()


class Drawing:
    """Writes control characters, which a progress bar needs, to standard error. Only for text of this program."""

    def write(self, text: str) -> int:
        """Write a text unchanged. Return the number of characters."""
        (sys.stderr.draw if isinstance(sys.stderr, Printing) else sys.stderr.write)(text)
        return len(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(sys.stderr, name)


class Output:
    """Replaces standard output and standard error while a verb runs: `with Output(note) as output`."""

    def __init__(self, note: str | None = None) -> None:
        """`note` is printed on standard error if standard output loses its reader."""
        self._note = note
        self._stdout: Printing | None = None
        self._before = (sys.stdout, sys.stderr)

    def __enter__(self) -> "Output":
        # keep the streams if a test, or a program that imports this module, has replaced them
        if sys.__stderr__ is not None and sys.stderr is sys.__stderr__:
            sys.stderr = _text(sys.stderr, "backslashreplace")
        if sys.__stdout__ is not None and sys.stdout is sys.__stdout__:
            # a terminal without ° or ≤ shows a question mark
            sys.stdout = self._stdout = _text(sys.stdout, "replace", self._print_note)
        return self

    def __exit__(self, *_: object) -> None:
        self._flush()
        sys.stdout, sys.stderr = self._before

    def _flush(self) -> None:
        for stream in (sys.stdout, sys.stderr):
            if stream is not None:  # None: closed by the shell, as with `>&-`
                stream.flush()

    def fault(self) -> str | None:
        """Return why writing the output failed, such as a full disk; None for no failure and for a closed pipe."""
        self._flush()
        error = self._stdout.fault if self._stdout else None
        return (error.strerror or str(error)) if error else None

    def _print_note(self) -> None:
        if self._note:
            print(self._note, file=sys.stderr)


def _text(stream: Any, errors: str, on_loss: Callable[[], None] = lambda: None) -> Printing:
    stream.flush()
    by_line = stream.line_buffering or stream.write_through  # write_through: Python runs unbuffered
    return Printing(stream.fileno(), stream.encoding, errors, by_line=by_line, on_loss=on_loss)


class Live:
    """Shows progress on standard error: a bar in a terminal, a line every LOG_PERIOD_S in a log."""

    def __init__(self, total: int) -> None:
        from tqdm import tqdm

        self._bar: Any = None
        self._file = Drawing()  # one object for bar and lines: tqdm clears only the bars of the same file object
        if sys.stderr.isatty():
            self._bar = tqdm(total=total, file=self._file, bar_format=BAR, dynamic_ncols=True, leave=False)
        self._due_s, self._last = 0.0, ""

    def say(self, line: str) -> None:
        """Print a permanent line."""
        if self._bar is not None:
            self._bar.write(printable(line), file=self._file)
        else:
            print_note(line)

    def now(self, line: str, done: int) -> None:
        """Show the current state. A terminal replaces the last state; a log gets a line at most every LOG_PERIOD_S."""
        if self._bar is not None:
            self._bar.n = done
            self._bar.set_description_str(printable(line))
        elif time.monotonic() >= self._due_s:
            self._print(line)

    def close(self, line: str = "") -> None:
        """Remove the bar, and print the last state unless the log already has it."""
        if self._bar is not None:
            self._bar.close()
            self._bar = None
        if line and line != self._last:
            self._print(line)

    def _print(self, line: str) -> None:
        self._due_s, self._last = time.monotonic() + LOG_PERIOD_S, line
        print_note(line)


def progress_bar(total: int, done: int, unit: str, log_period_s: float) -> Any:
    """Return a tqdm bar on standard error. In a log it adds a line only every `log_period_s`."""
    from tqdm import tqdm

    period_s = 0.1 if sys.stderr.isatty() else log_period_s
    return tqdm(total=total, initial=done, unit=unit, dynamic_ncols=True, mininterval=period_s, file=Drawing())
