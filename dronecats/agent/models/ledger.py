"""What a run has spent, and whose turn it is at an address: one file that all of its processes share."""

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import msgspec

from dronecats.agent.models.http_model import tokens_of
from dronecats.agent.models.model import Model, Reply, Request
from dronecats.agent.models.spec import ModelSpec
from dronecats.agent.models.turns import Allowance, Limiter, Turns
from foundation.errors import BudgetError, UsageError
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


MILLION = 1e6
CHARACTERS_PER_TOKEN = 4  # of a reply whose tokens nobody tells


@dataclass(frozen=True, slots=True)
class Budget:
    """What a run may spend, all that its ledger holds included. None: no limit."""

    cost_usd: float | None = None
    tokens: int | None = None

    def check(self, spent: Spent) -> None:
        """Raise BudgetError when it is spent."""
        far = f"{told(spent)}, {spent.questions:,} questions"
        if self.cost_usd is not None and spent.usd >= self.cost_usd:
            raise BudgetError(f"the cost limit of ${self.cost_usd:g} is spent ({far}); raise --cost-limit to fly on")
        if self.tokens is not None and spent.tokens >= self.tokens:
            raise BudgetError(f"the limit of {self.tokens:,} tokens is spent ({far}); raise --token-limit to fly on")

    def check_prices(self, spec: ModelSpec) -> None:
        """Raise UsageError for a limit that nobody can hold a model to."""
        if self.cost_usd is not None and (spec.input_usd is None or spec.output_usd is None):
            said = f"--cost-limit cannot hold {spec.title}, whose prices are not known"
            raise UsageError(f"{said}: declare input_usd and output_usd for it, or give a --token-limit")


def cost_limit(said: str | float) -> float:
    """Return the $ that a limit says. Raises UsageError for what is none."""
    try:
        usd = float(said)
    except ValueError:
        usd = math.nan
    if not 0.0 < usd < math.inf:
        raise UsageError(f"--cost-limit wants a number of $ above 0, got {_short(said)}; without a limit, leave it out")
    return usd


def token_limit(said: str | int) -> int:
    """Return the tokens that a limit says. Raises UsageError for what is none."""
    try:
        tokens = int(said)
    except ValueError:
        tokens = 0
    if tokens < 1:
        asked = "a whole number of tokens, 1 or more"
        raise UsageError(f"--token-limit wants {asked}, got {_short(said)}; without a limit, leave it out")
    return tokens


def _short(said: object) -> str:
    return f"'{str(said)[:40]}'"


def told(spent: Spent) -> str:
    """Return what has been spent in a few words."""
    return f"{spent.tokens:,} tokens" + (f", ${spent.usd:.4f}" if spent.usd else "")


def cost(spec: ModelSpec, tokens_in: int, tokens_out: int) -> float:
    """Return the $ of a question and its reply, as far as prices are known."""
    return (tokens_in * (spec.input_usd or 0.0) + tokens_out * (spec.output_usd or 0.0)) / MILLION


def spent_on(spec: ModelSpec, request: Request, reply: Reply) -> Spent:
    """Return what a question and its reply have cost. Tokens that an endpoint does not count are estimated."""
    tokens_in = tokens_of(request) if reply.tokens_in is None else reply.tokens_in
    tokens_out = len(reply.text) // CHARACTERS_PER_TOKEN if reply.tokens_out is None else reply.tokens_out
    return Spent(1, tokens_in, tokens_out, cost(spec, tokens_in, tokens_out))


class BudgetedModel:
    """Asks a model while there is something left. Questions under way together may overshoot by one each."""

    def __init__(self, model: Model, spec: ModelSpec, budget: Budget, ledger: Books) -> None:
        self.name = model.name
        self._model, self._spec, self._budget, self._ledger = model, spec, budget, ledger

    def ask(self, request: Request) -> Reply:
        """Return the reply, with what it costs in the ledger. Raises BudgetError, ModelError, InfrastructureError."""
        self._budget.check(self._ledger.spent())
        reply = self._model.ask(request)
        self._ledger.spend(self._spec.title, spent_on(self._spec, request, reply))
        return reply

    def check(self) -> None:
        self._model.check()

    def close(self) -> None:
        self._model.close()
