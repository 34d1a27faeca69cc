"""Writes files that stay intact after a kill or on a full disk: atomic text and JSON files, and SQLite files."""

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

from foundation.errors import DronecatsError, InfrastructureError, UsageError


@contextlib.contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Yield the path of a draft file. The draft replaces `path` if the block succeeds, and is removed otherwise.

    Each thread and process has its own draft of a file; the last one to finish wins. Raises OSError.
    """
    draft = path.with_name(f"{path.name}.{os.getpid()}.{threading.get_ident()}.part")
    try:
        yield draft
        draft.replace(path)
    except BaseException:
        with contextlib.suppress(OSError):
            draft.unlink()
        raise


@contextlib.contextmanager
def file_errors_as(kind: type[DronecatsError], failure: str, advice: str = "") -> Iterator[None]:
    """Raise `kind` instead of an OSError of the block, with the text `failure: reason` and then `advice`."""
    try:
        yield
    except OSError as error:
        raise kind(f"{failure}: {error.strerror or error}{advice}") from None


def check_folder(path: Path) -> None:
    """Raise UsageError if the path of `--out` is a file."""
    if path.exists() and not path.is_dir():
        raise UsageError(f"--out {path} is a file. Name a folder")


def write_text(path: Path, text: str, *, errors: str = "strict") -> None:
    """Write a UTF-8 text file atomically, with its line ends unchanged. Raises OSError."""
    with whole_file(path) as draft:
        draft.write_text(text, encoding="utf-8", errors=errors, newline="\n")


def write_json(path: Path, value: Any) -> None:
    """Write a JSON file atomically. Raises OSError."""
    text = json.dumps(value, indent=2, ensure_ascii=False) + "\n"
    write_text(path, text, errors="backslashreplace")  # half a surrogate pair is valid in JSON but not in UTF-8


BUSY_S = 30.0  # s of wall time that a statement waits while another process writes to the file


@dataclass(frozen=True, slots=True)
class FileKind:
    """One kind of SQLite file."""

    name: str  # name of the kind in messages
    application_id: int  # number in the file's header that marks the kind
    version: int  # version of the tables, also in the header
    tables: str  # SQL that creates the tables


class SqliteFile:
    """An open SQLite file that processes and threads share. One statement or transaction runs at a time."""

    def __init__(self, path: Path, kind: FileKind) -> None:
        """Open the file, or create it.

        Raises UsageError for a damaged file, and for a file of another kind or version. Leaves such a file unchanged.
        """
        self._path, self._kind, self._lock = path, kind, threading.Lock()
        try:
            if not path.exists():
                make(path, kind)
            self._db = _connected(path)
        except (OSError, sqlite3.OperationalError) as error:
            reason = error.strerror if isinstance(error, OSError) else error
            raise UsageError(f"the {kind.name} {path} cannot be opened: {reason}") from None
        try:
            self._check()
            self._db.execute("PRAGMA synchronous=NORMAL")  # a kill loses nothing; a power cut may lose the last writes
        except sqlite3.DatabaseError as error:
            self._db.close()
            raise UsageError(f"{path} is not a {kind.name}: {error}. Move it away, or name another file") from None
        except UsageError:
            self._db.close()
            raise

    def _check(self) -> None:
        kind, path = self._kind, self._path
        (application,) = self._db.execute("PRAGMA application_id").fetchone()
        (version,) = self._db.execute("PRAGMA user_version").fetchone()
        if application != kind.application_id:
            raise UsageError(f"{path} is another database, not a {kind.name}. Name another file")
        if version != kind.version:
            raise UsageError(
                f"the {kind.name} {path} has version {version} instead of {kind.version}. Name another file"
            )
        (fault,) = self._db.execute("PRAGMA quick_check(1)").fetchone()
        if fault != "ok":
            raise UsageError(f"the {kind.name} {path} is damaged: {fault}. Move it away, or name another file")

    @contextmanager
    def transaction(self) -> Iterator[sqlite3.Connection]:
        """Yield the connection in an exclusive transaction. Raises InfrastructureError."""
        with self._lock, self._faults():
            self._db.execute("BEGIN IMMEDIATE")
            try:
                yield self._db
            except BaseException:
                self._db.execute("ROLLBACK")
                raise
            self._db.execute("COMMIT")

    def row(self, question: str, *values: object) -> tuple[object, ...] | None:
        """Return the first row of a query. Raises InfrastructureError."""
        with self._lock, self._faults():
            row: tuple[object, ...] | None = self._db.execute(question, values).fetchone()
            return row

    @contextmanager
    def _faults(self) -> Iterator[None]:
        try:
            yield
        except sqlite3.Error as error:
            raise InfrastructureError(f"the {self._kind.name} {self._path} cannot be used: {error}") from None

    def close(self) -> None:
        """Close the file. May be called more than once."""
        with self._lock:
            self._db.close()


def _connected(path: Path) -> sqlite3.Connection:
    return sqlite3.connect(path, timeout=BUSY_S, isolation_level=None, check_same_thread=False)


def make(path: Path, kind: FileKind) -> None:
    """Create the file as a draft and link it to `path`. If another process was first, that process's file stays."""
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
