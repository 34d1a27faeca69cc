"""Replies kept in a file: what was asked before, letter by letter, is not sent again."""

import json
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path

import msgspec

from dronecats.agent.models.model import Model, Reply, Request
from foundation.errors import InfrastructureError
from foundation.sqlite_file import FileKind, SqliteFile

KIND = FileKind(
    "cache",
    0x44434341,
    1,
    "CREATE TABLE replies (question TEXT PRIMARY KEY, model TEXT NOT NULL, reply TEXT NOT NULL) STRICT;",
)
_READ = "SELECT reply FROM replies WHERE question = ?"


class ReplyCache:
    """The open file: replies, without a secret in them, by the fingerprint of their question."""

    def __init__(self, path: Path) -> None:
        """Raises UsageError."""
        self._file = SqliteFile(path, KIND)

    def reply(self, question: str) -> Reply | None:
        """Return the reply to a question, None where it was never asked. Raises InfrastructureError."""
        row = self._file.row(_READ, question)
        return _reply(str(row[0])) if row else None

    def keep(self, question: str, model: str, reply: Reply) -> Reply:
        """Keep a reply, and return the one that is kept: the first, where two asked at once. InfrastructureError."""
        told = json.dumps(asdict(replace(reply, waited_s=0.0)))  # escaped: half a surrogate pair is no UTF-8
        with self._file.transaction() as db:
            db.execute("INSERT OR IGNORE INTO replies VALUES (?, ?, ?)", (question, model, told))
            (kept,) = db.execute(_READ, (question,)).fetchone()
        return reply if kept == told else _reply(kept)

    @property
    def is_empty(self) -> bool:
        """Whether it holds no reply. Raises InfrastructureError."""
        return self._file.row("SELECT 1 FROM replies LIMIT 1") is None

    def close(self) -> None:
        self._file.close()


def _reply(told: str) -> Reply:
    try:
        return msgspec.convert(json.loads(told), Reply)
    except (ValueError, msgspec.ValidationError):
        raise InfrastructureError("the cache holds what is no reply; move it away, or name another file") from None


class CachedModel:
    """Asks a model what it was not asked before. What is kept comes at once, with the latency that it had."""

    def __init__(self, model: Model, fingerprint: Callable[[Request], str], cache: ReplyCache) -> None:
        self.name = model.name
        self._model, self._fingerprint, self._cache = model, fingerprint, cache

    def ask(self, request: Request) -> Reply:
        """Return the reply. Raises ModelError, and InfrastructureError for a cache that cannot be used."""
        question = self._fingerprint(request)
        if (kept := self._cache.reply(question)) is not None:
            return kept
        return self._cache.keep(question, self.name, self._model.ask(request))

    def check(self) -> None:
        self._model.check()

    def close(self) -> None:
        self._model.close()
