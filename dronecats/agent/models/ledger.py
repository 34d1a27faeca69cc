"""The ledger of runs: money and tokens spent, and the rate limits of addresses, in one file for all processes."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from sqlite3 import Connection
from typing import Protocol

import msgspec

from dronecats.agent.models.model import Model, Reply, Request, WrappedModel, tokens_of, tokens_of_text
from dronecats.agent.models.rate_limits import Allowance, Limiter, RateLimitState
from dronecats.agent.models.spec import ModelSpec
from foundation.conversion import decode
from foundation.errors import BudgetError, ModelError, UsageError
from foundation.files import FileKind, SqliteFile

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
    """Questions, tokens and money spent, on all models or on one."""

    questions: int = 0
    tokens_in: int = 0
    tokens_out: int = 0
    usd: float = 0.0  # $ on models with known prices

    @property
    def tokens(self) -> int:
        """Tokens of questions and replies together."""
        return self.tokens_in + self.tokens_out


class LedgerInterface(Protocol):
    """The interface of a ledger: the open file, or a client on another machine."""

    def spend(self, model: str, spent: Spent) -> None: ...

    def spent(self) -> Spent: ...

    def limiter(self, address: str, model: str) -> Limiter: ...

    def close(self) -> None: ...


class Ledger:
    """The open ledger file. Every call is a transaction: a killed process loses only the cost of an open question."""

    def __init__(self, path: Path, now_s: Callable[[], float] = time.time) -> None:
        """`now_s` returns the time of a clock that all processes share, s since the epoch. Raises UsageError."""
        self._file, self._now_s = SqliteFile(path, KIND), now_s

    def close(self) -> None:
        self._file.close()

    def spend(self, model: str, spent: Spent) -> None:
        """Add the cost of a question. Raises InfrastructureError."""
        with self._file.transaction() as db:
            db.execute(
                "INSERT INTO spent VALUES (?, ?, ?, ?, ?) ON CONFLICT (model) DO UPDATE SET"
                " questions = questions + excluded.questions, tokens_in = tokens_in + excluded.tokens_in,"
                " tokens_out = tokens_out + excluded.tokens_out, usd = usd + excluded.usd",
                (model, spent.questions, spent.tokens_in, spent.tokens_out, spent.usd),
            )

    def spent(self) -> Spent:
        """Return the cost of all models. Raises InfrastructureError."""
        row = self._file.row("SELECT SUM(questions), SUM(tokens_in), SUM(tokens_out), SUM(usd) FROM spent")
        return Spent(*(total or 0 for total in row or ()))  # type: ignore[arg-type]

    def limiter(self, address: str, model: str) -> "SharedLimiter":
        """Return the limiter of an address (redacted) and model."""
        return SharedLimiter(self._file, address, model, self._now_s)


class SharedLimiter:
    """A `rate_limits.Limiter` for all processes that share a ledger."""

    def __init__(self, file: SqliteFile, address: str, model: str, now_s: Callable[[], float]) -> None:
        self._file, self._address, self._model, self._now_s = file, address, model, now_s

    def claim(self, tokens: int) -> float:
        """Count a request as sent and return 0, or return the time (s) to wait. Raises InfrastructureError."""
        with self._file.transaction() as db:
            wait_s, limits = self._read(db).claim(self._model, tokens, self._now_s())
            self._write(db, limits)
        return wait_s

    def update(self, allowances: tuple[Allowance, ...]) -> None:
        """Apply the allowances of an answer. Raises InfrastructureError."""
        with self._file.transaction() as db:
            limits = self._read(db)
            for allowance in allowances:
                limits = limits.updated(self._model, allowance, self._now_s())
            self._write(db, limits)

    def hold(self, seconds: float) -> None:
        """Block all requests to the address for `seconds`. Raises InfrastructureError."""
        with self._file.transaction() as db:
            self._write(db, self._read(db).held(seconds, self._now_s()))

    def _read(self, db: Connection) -> RateLimitState:
        """Return the stored state. A state that cannot be decoded counts as empty: it must not end every later run."""
        row = db.execute("SELECT state FROM turns WHERE address = ?", (self._address,)).fetchone()
        try:
            return decode(row[0], RateLimitState) if row else RateLimitState()
        except (msgspec.DecodeError, UnicodeError, RecursionError):
            return RateLimitState()

    def _write(self, db: Connection, limits: RateLimitState) -> None:
        state = msgspec.json.encode(limits).decode()
        db.execute("INSERT OR REPLACE INTO turns VALUES (?, ?)", (self._address, state))


MILLION = 1e6


@dataclass(frozen=True, slots=True)
class Budget:
    """The limits of a run's spending. All costs in its ledger count, also the costs of earlier runs. None: no limit."""

    cost_usd: float | None = None
    tokens: int | None = None

    def check(self, spent: Spent) -> None:
        """Raise BudgetError when a limit is reached."""
        far = f"{spent_text(spent)}, {spent.questions:,} questions"
        if self.cost_usd is not None and spent.usd >= self.cost_usd:
            raise BudgetError(f"the cost limit of ${self.cost_usd:g} is spent ({far}). Raise --cost-limit to continue")
        if self.tokens is not None and spent.tokens >= self.tokens:
            raise BudgetError(
                f"the limit of {self.tokens:,} tokens is used up ({far}). Raise --token-limit to continue"
            )

    def check_prices(self, spec: ModelSpec) -> None:
        """Raise UsageError if there is a limit in $ and the model's prices are unknown."""
        if self.cost_usd is not None and (spec.input_usd is None or spec.output_usd is None):
            problem = f"--cost-limit cannot limit {spec.title}, whose prices are unknown"
            raise UsageError(f"{problem}. Set input_usd and output_usd in its row of models.toml, or use --token-limit")


def cost_limit(limit: str | float) -> float:
    """Return a cost limit in $. Raises UsageError if it is invalid."""
    try:
        usd = float(limit)
    except ValueError:
        usd = math.nan
    if not 0.0 < usd < math.inf:
        raise UsageError(f"--cost-limit must be a number of $ above 0, got {_short(limit)}. For no limit, leave it out")
    return usd


def token_limit(limit: str | int) -> int:
    """Return a limit in tokens. Raises UsageError if it is invalid."""
    try:
        tokens = int(limit)
    except ValueError:
        tokens = 0
    if tokens < 1:
        wanted = "a whole number of tokens, 1 or more"
        raise UsageError(f"--token-limit must be {wanted}, got {_short(limit)}. For no limit, leave it out")
    return tokens


def _short(value: object) -> str:
    return f"'{str(value)[:40]}'"


def spent_text(spent: Spent) -> str:
    """Return the spent tokens and $ in a few words."""
    return f"{spent.tokens:,} tokens" + (f", ${spent.usd:.4f}" if spent.usd else "")


def cost(spec: ModelSpec, tokens_in: int, tokens_out: int) -> float:
    """Return the $ of a question and its reply; an unknown price (per million tokens) counts as 0."""
    return (tokens_in * (spec.input_usd or 0.0) + tokens_out * (spec.output_usd or 0.0)) / MILLION


def spent_on(spec: ModelSpec, request: Request, reply: Reply) -> Spent:
    """Return the cost of a question with its failed attempts and its reply.

    Tokens that an endpoint does not count are estimated. Failed attempts add only reported tokens.
    """
    tokens_in = tokens_of(request) if reply.tokens_in is None else reply.tokens_in
    tokens_out = tokens_of_text(reply.text) if reply.tokens_out is None else reply.tokens_out
    tokens_in, tokens_out = tokens_in + reply.lost[0], tokens_out + reply.lost[1]
    return Spent(1, tokens_in, tokens_out, cost(spec, tokens_in, tokens_out))


class BudgetedModel(WrappedModel):
    """Asks a model while the budget lasts. n concurrent questions may exceed the budget by the cost of n questions."""

    def __init__(self, model: Model, spec: ModelSpec, budget: Budget, ledger: LedgerInterface) -> None:
        super().__init__(model)
        self._spec, self._budget, self._ledger = spec, budget, ledger
        self._open: dict[object, Request] = {}  # questions without an answer, not booked yet

    def ask(self, request: Request) -> Reply:
        """Return the reply and book its cost. Raises BudgetError, ModelError, InfrastructureError.

        The cost of failed attempts is booked even if there is no reply.
        """
        self._budget.check(self._ledger.spent())
        key = object()
        self._open[key] = request
        spent = None
        try:
            reply = self._model.ask(request)
            spent = spent_on(self._spec, request, reply)
            return reply
        except ModelError as error:
            if any(error.lost):
                spent = Spent(0, *error.lost, cost(self._spec, *error.lost))
            raise
        finally:
            if self._open.pop(key, None) and spent:
                self._ledger.spend(self._spec.title, spent)

    def book_open(self) -> None:
        """Add the cost of questions that are open at the end: the vendor also charges for replies that come too late.

        Each reply is assumed to have the mean length of the run's replies. Raises InfrastructureError.
        """
        for key in list(self._open):
            if request := self._open.pop(key, None):
                run = self._ledger.spent()
                tokens_in, tokens_out = tokens_of(request), round(run.tokens_out / max(run.questions, 1))
                usd = cost(self._spec, tokens_in, tokens_out)
                self._ledger.spend(self._spec.title, Spent(1, tokens_in, tokens_out, usd))
