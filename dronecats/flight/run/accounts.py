"""The model of a flight, opened with all that stands between it and the wire: ledger, limiter, budget and cache.

In a cluster, one actor keeps the ledger (extra `cluster`): every model asked anywhere books and waits there.
`Accounts.ledger` names it, behind ON_CLUSTER.
"""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dronecats.agent.models.ledger import Books, Budget, BudgetedModel, Ledger, Spent, spent_text
from dronecats.agent.models.model import Model
from dronecats.agent.models.replay import CachedModel, ReplyCache
from dronecats.agent.models.spec import ModelSpec
from dronecats.agent.models.turns import Allowance
from dronecats.agent.models.wire_formats import open_model
from dronecats.flight.spec.flight_spec import ON_CLUSTER, Accounts
from foundation.errors import BudgetError, InfrastructureError
from foundation.run_folder.layout import LEDGER


class LedgerKeeper:
    """The actor. One call at a time, so that a claim is one transaction for the whole cluster."""

    def __init__(self, path: str) -> None:
        self._ledger = Ledger(Path(path))

    def ready(self) -> bool:
        """Return that it stands."""
        return True

    def spend(self, model: str, spent: Spent) -> None:
        self._ledger.spend(model, spent)

    def spent(self) -> Spent:
        return self._ledger.spent()

    def claim(self, address: str, model: str, tokens: int) -> float:
        return self._ledger.limiter(address, model).claim(tokens)

    def update(self, address: str, model: str, allowances: tuple[Allowance, ...]) -> None:
        self._ledger.limiter(address, model).update(allowances)

    def hold(self, address: str, model: str, seconds: float) -> None:
        self._ledger.limiter(address, model).hold(seconds)


class RemoteLedger:
    """The same ledger, as a worker of the cluster has it."""

    def __init__(self, name: str) -> None:
        """`name`: of the actor, without the prefix. Raises InfrastructureError when there is none."""
        import ray

        try:
            self._keeper = ray.get_actor(name)
        except ValueError:
            raise InfrastructureError(f"the cluster has no ledger {name}; its benchmark is gone") from None

    def spend(self, model: str, spent: Spent) -> None:
        """Add what a question has cost. Raises InfrastructureError."""
        self._told("spend", model, spent)

    def spent(self) -> Spent:
        """Return what all models have cost. Raises InfrastructureError."""
        told = self._told("spent")
        assert isinstance(told, Spent)
        return told

    def limiter(self, address: str, model: str) -> "RemoteLimiter":
        """Return the limiter of an address for the whole cluster."""
        return RemoteLimiter(self._told, address, model)

    def close(self) -> None:
        """Leave it to the others."""

    def _told(self, method: str, *arguments: object) -> Any:
        import ray

        try:
            return ray.get(getattr(self._keeper, method).remote(*arguments))
        except ray.exceptions.RayError as gone:
            raise InfrastructureError(f"the cluster's ledger cannot be reached: {type(gone).__name__}") from None


class RemoteLimiter:
    """The limiter of all that share a cluster's ledger (`dronecats.agent.models.turns.Limiter`)."""

    def __init__(self, ask: Callable[..., Any], address: str, model: str) -> None:
        self._ask, self._address, self._model = ask, address, model

    def claim(self, tokens: int) -> float:
        """Count a request as sent and return 0, or return the s to wait. Raises InfrastructureError."""
        return float(self._ask("claim", self._address, self._model, tokens))

    def update(self, allowances: tuple[Allowance, ...]) -> None:
        """Take in what an answer allows. Raises InfrastructureError."""
        self._ask("update", self._address, self._model, allowances)

    def hold(self, seconds: float) -> None:
        """Let nobody ask there for so long. Raises InfrastructureError."""
        self._ask("hold", self._address, self._model, seconds)


@dataclass(frozen=True, slots=True)
class AccountedModel:
    """A model that can be asked, and what the run has spent so far, in a few words."""

    model: Model
    spent: Callable[[], str]


@contextmanager
def accounted(spec: ModelSpec, accounts: Accounts, run: Path) -> Iterator[AccountedModel]:
    """Open a model for a flight of the run in a folder. Raises UsageError, BudgetError, InfrastructureError."""
    with ExitStack() as opened:
        ledger = _books(accounts, run)
        opened.callback(ledger.close)
        budget = _budget(accounts)
        budget.check(ledger.spent())
        served = open_model(spec, limiters=ledger.limiter)
        opened.callback(served.close)
        model: Model = BudgetedModel(served, spec, budget, ledger)
        if accounts.cache is not None:
            cache = ReplyCache(Path(accounts.cache))
            opened.callback(cache.close)
            model = CachedModel(model, served.fingerprint, cache)
        yield AccountedModel(model, lambda: spent_text(ledger.spent()))


def check_budget(accounts: Accounts, run: Path) -> None:
    """Raise BudgetError when a run has nothing left to fly on with: before anything is started."""
    if accounts.cost_limit_usd is None and accounts.token_limit is None:
        return
    ledger = _books(accounts, run)
    try:
        _budget(accounts).check(ledger.spent())
    finally:
        ledger.close()


def is_spent(accounts: Accounts, run: Path | None) -> bool:
    """Return whether a run has nothing left to fly on with; `run` None: a new one."""
    kept = accounts.ledger or (run and run / LEDGER)
    if kept is None or not Path(kept).exists():
        return False
    try:
        check_budget(accounts, Path(kept).parent)
    except BudgetError:
        return True
    return False


def book(model: str, spent: Spent, accounts: Accounts, run: Path) -> None:
    """Add what a model (PROVIDER/NAME) has cost to the ledger of the run in a folder. Raises InfrastructureError."""
    ledger = _books(accounts, run)
    try:
        ledger.spend(model, spent)
    finally:
        ledger.close()


def _books(accounts: Accounts, run: Path) -> Books:
    if accounts.ledger is not None and accounts.ledger.startswith(ON_CLUSTER):
        from dronecats.flight.run.accounts import RemoteLedger

        return RemoteLedger(accounts.ledger.removeprefix(ON_CLUSTER))
    return Ledger(run / LEDGER if accounts.ledger is None else Path(accounts.ledger))


def _budget(accounts: Accounts) -> Budget:
    return Budget(accounts.cost_limit_usd, accounts.token_limit)


class Spending:
    """What all runs of a benchmark have spent together, as their ledger says; nothing where nobody is paid."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / LEDGER
        self._ledger: Ledger | None = None

    def spent(self) -> Spent | None:
        """Return it, None while there is no ledger. Raises InfrastructureError."""
        if self._ledger is None and self._path.exists():
            self._ledger = Ledger(self._path)
        return self._ledger.spent() if self._ledger else None

    def close(self) -> None:
        """Let go of the file."""
        if self._ledger is not None:
            self._ledger.close()
