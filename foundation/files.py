"""Files that stay intact after a kill or on a full disk: text and JSON written atomically, and SQLite files."""

import contextlib
import json
import os
import sqlite3
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from foundation.errors import InfrastructureError, UsageError


@contextlib.contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Give the path of a draft beside `path`, which takes its place when the block ends well, and else is removed.

    Threads and processes that write the same file have drafts of their own: the one that ends last stays. Raises
    OSError.
    """
    draft = path.with_name(f"{path.name}.{os.getpid()}.{threading.get_ident()}.part")
    try:
        yield draft
        draft.replace(path)
    except BaseException:
        with contextlib.suppress(OSError):
            draft.unlink()
        raise


def write_text(path: Path, text: str, *, errors: str = "strict") -> None:
    """Write a text file in UTF-8, its line ends as they are, whole or not at all. Raises OSError."""
    with whole_file(path) as draft:
        draft.write_text(text, encoding="utf-8", errors=errors, newline="\n")


def write_json(path: Path, value: Any) -> None:
    """Write a JSON file beside its place and move it there. Raises OSError, and leaves no draft behind then."""
    text = json.dumps(value, indent=2, ensure_ascii=False) + "\n"
    write_text(path, text, errors="backslashreplace")  # half a surrogate pair: JSON has it


BUSY_S = 30.0  # wall s that another process may hold the file


@dataclass(frozen=True, slots=True)
class FileKind:
    """What a file is for."""

    name: str  # as a sentence calls it
    application_id: int  # in the file's header
    version: int  # of the tables
    tables: str  # SQL that makes them


class SqliteFile:
    """One open file. A statement, or a transaction, at a time, whichever thread asks."""

    def __init__(self, path: Path, kind: FileKind) -> None:
        """Open the file, and make it where there is none.

        Raises UsageError for one that is damaged, of something else or of a newer version, and leaves it as it is.
        """
        self._path, self._kind, self._lock = path, kind, threading.Lock()
        try:
            if not path.exists():
                make(path, kind)
            self._db = _connected(path)
        except (OSError, sqlite3.OperationalError) as error:
            said = error.strerror if isinstance(error, OSError) else error
            raise UsageError(f"the {kind.name} {path} cannot be opened: {said}") from None
        try:
            self._check()
            self._db.execute("PRAGMA synchronous=NORMAL")  # a kill loses nothing; a power cut may, of the last moment
        except sqlite3.DatabaseError as error:
            self._db.close()
            raise UsageError(f"{path} is no {kind.name}: {error}; move it away, or name another file") from None
        except UsageError:
            self._db.close()
            raise

    def _check(self) -> None:
        kind, path = self._kind, self._path
        (application,) = self._db.execute("PRAGMA application_id").fetchone()
        (version,) = self._db.execute("PRAGMA user_version").fetchone()
        if application != kind.application_id:
            raise UsageError(f"{path} is no {kind.name} but another database; name another file")
        if version != kind.version:
            raise UsageError(f"the {kind.name} {path} is of version {version}, not {kind.version}; name another file")
        (said,) = self._db.execute("PRAGMA quick_check(1)").fetchone()
        if said != "ok":
            raise UsageError(f"the {kind.name} {path} is damaged: {said}; move it away, or name another file")

    @contextmanager
    def transaction(self) -> Iterator[sqlite3.Connection]:
        """Have the file to oneself: all that is written is there at the end, or none. Raises InfrastructureError."""
        with self._lock, self._faults():
            self._db.execute("BEGIN IMMEDIATE")
            try:
                yield self._db
            except BaseException:
                self._db.execute("ROLLBACK")
                raise
            self._db.execute("COMMIT")

    def row(self, question: str, *values: object) -> tuple[object, ...] | None:
        """Return the first row that a question has. Raises InfrastructureError."""
        with self._lock, self._faults():
            found: tuple[object, ...] | None = self._db.execute(question, values).fetchone()
            return found

    @contextmanager
    def _faults(self) -> Iterator[None]:
        try:
            yield
        except sqlite3.Error as error:
            raise InfrastructureError(f"the {self._kind.name} {self._path} cannot be used: {error}") from None

    def close(self) -> None:
        """Close it; may be called more than once."""
        with self._lock:
            self._db.close()


def _connected(path: Path) -> sqlite3.Connection:
    return sqlite3.connect(path, timeout=BUSY_S, isolation_level=None, check_same_thread=False)


def make(path: Path, kind: FileKind) -> None:
    """Make the file beside its place and link it there: whoever comes second finds a whole one and keeps it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = path.with_name(f"{path.name}.{os.getpid()}.{threading.get_ident()}.part")
    try:
        db = _connected(draft)
        try:
            db.execute("PRAGMA journal_mode=WAL")
            db.execute(f"PRAGMA application_id={kind.application_id}")
            db.execute(f"PRAGMA user_version={kind.version}")
            db.executescript(kind.tables)
        finally:
            db.close()
        with contextlib.suppress(FileExistsError):
            os.link(draft, path)
    finally:
        for left in (draft, *(draft.with_name(draft.name + end) for end in ("-wal", "-shm"))):
            left.unlink(missing_ok=True)
