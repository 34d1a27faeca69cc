"""What a run has spent, and whose turn it is at an address: one file that all of its processes share."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import msgspec

from dronecats.agent.models.limiter import Limiter
from dronecats.agent.models.rate_headers import Allowance
from dronecats.agent.models.turns import Turns
from foundation.sqlite_file import FileKind, SqliteFile

KIND = FileKind(
    "ledger",
    0x44434C45,
    1,
    """
    CREATE TABLE spent (model TEXT PRIMARY KEY, questions INTEGER NOT NULL, tokens_in INTEGER NOT NULL,
                        tokens_out INTEGER NOT NULL, usd REAL NOT NULL) STRICT;
    CREATE TABLE turns (address TEXT PRIMARY KEY, state TEXT NOT NULL) STRICT;
    """,
)


@dataclass(frozen=True, slots=True)
class Spent:
    """What has been spent, of all models together or of one."""

    questions: int = 0
    tokens_in: int = 0
    tokens_out: int = 0
    usd: float = 0.0  # $ of those whose prices are known

    @property
    def tokens(self) -> int:
        """Tokens of questions and replies together."""
        return self.tokens_in + self.tokens_out


class Books(Protocol):
    """A ledger, wherever it is kept: the file itself, or what speaks for it on another machine."""

    def spend(self, model: str, spent: Spent) -> None: ...

    def spent(self) -> Spent: ...

    def limiter(self, address: str, model: str) -> Limiter: ...

    def close(self) -> None: ...


class Ledger:
    """The open file. Every call is a transaction: a process that is killed takes nothing with it but its question."""

    def __init__(self, path: Path, now_s: Callable[[], float] = time.time) -> None:
        """`now_s` is a clock that all processes share, wall s of the epoch. Raises UsageError."""
        self._file, self._now_s = SqliteFile(path, KIND), now_s

    def close(self) -> None:
        self._file.close()

    def spend(self, model: str, spent: Spent) -> None:
        """Add what a question has cost. Raises InfrastructureError."""
        with self._file.transaction() as db:
            db.execute(
                "INSERT INTO spent VALUES (?, ?, ?, ?, ?) ON CONFLICT (model) DO UPDATE SET"
                " questions = questions + excluded.questions, tokens_in = tokens_in + excluded.tokens_in,"
                " tokens_out = tokens_out + excluded.tokens_out, usd = usd + excluded.usd",
                (model, spent.questions, spent.tokens_in, spent.tokens_out, spent.usd),
            )

    def spent(self) -> Spent:
        """Return what all models have cost. Raises InfrastructureError."""
        row = self._file.row("SELECT SUM(questions), SUM(tokens_in), SUM(tokens_out), SUM(usd) FROM spent")
        return Spent(*(each or 0 for each in row or ()))  # type: ignore[arg-type]

    def limiter(self, address: str, model: str) -> "SharedLimiter":
        """Return the limiter of an address, as it may be shown, for those that ask a model there."""
        return SharedLimiter(self._file, address, model, self._now_s)


class SharedLimiter:
    """The limiter of all that share a ledger (`limiter.Limiter`)."""

    def __init__(self, file: SqliteFile, address: str, model: str, now_s: Callable[[], float]) -> None:
        self._file, self._address, self._model, self._now_s = file, address, model, now_s

    def claim(self, tokens: int) -> float:
        """Count a request as sent and return 0, or return the s to wait. Raises InfrastructureError."""
        with self._turns() as turns:
            wait_s, turns.now = turns.now.claim(self._model, tokens, self._now_s())
            return wait_s

    def heard(self, allowances: tuple[Allowance, ...]) -> None:
        """Take in what an answer allows. Raises InfrastructureError."""
        with self._turns() as turns:
            for told in allowances:
                turns.now = turns.now.heard(self._model, told, self._now_s())

    def hold(self, seconds: float) -> None:
        """Let nobody ask there for so long. Raises InfrastructureError."""
        with self._turns() as turns:
            turns.now = turns.now.held(seconds, self._now_s())

    @contextmanager
    def _turns(self) -> Iterator["_Kept"]:
        with self._file.transaction() as db:
            row = db.execute("SELECT state FROM turns WHERE address = ?", (self._address,)).fetchone()
            kept = _Kept(msgspec.json.decode(row[0], type=Turns) if row else Turns())
            yield kept
            state = msgspec.json.encode(kept.now).decode()
            db.execute("INSERT OR REPLACE INTO turns VALUES (?, ?)", (self._address, state))


@dataclass(slots=True)
class _Kept:
    now: Turns
