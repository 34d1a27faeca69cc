"""The model of a flight, opened with all that stands between it and the wire: ledger, limiter, budget and cache."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from dronecats.agent.models.cache import CachedModel, ReplyCache
from dronecats.agent.models.ledger import Books, Budget, BudgetedModel, Ledger, Spent, told
from dronecats.agent.models.model import Model, ModelSpec
from dronecats.agent.models.open import open_model
from dronecats.flight.spec.flight_spec import ON_CLUSTER, Accounts
from foundation.errors import BudgetError
from foundation.run_folder.layout import LEDGER


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
        yield AccountedModel(model, lambda: told(ledger.spent()))


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
        from dronecats.flight.run.ledger_actor import RemoteLedger

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
