"""Opens a flight's models with ledger, budget, rate limiter and reply cache, and asks them a test question.

The ledger records the cost of each question. On a Ray cluster (extra `cluster`), one actor keeps it for all workers.
`Accounts.ledger` is then ON_CLUSTER followed by the actor's name.
"""

from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from typing import Any

from dronecats.agent.models.endpoint import GIVE_UP_S, RetryPolicy
from dronecats.agent.models.ledger import Budget, BudgetedModel, Ledger, LedgerInterface, Spent, spent_on, spent_text
from dronecats.agent.models.model import Model, Request, ending_reason
from dronecats.agent.models.probe import marked_picture
from dronecats.agent.models.rate_limits import Allowance
from dronecats.agent.models.replay import CachedModel, ReplyCache
from dronecats.agent.models.spec import ModelSpec
from dronecats.agent.models.wire_formats import open_model
from dronecats.flight.spec.flight_spec import ON_CLUSTER, Accounts, FlightSpec
from foundation.errors import BudgetError, InfrastructureError, ModelRejectedError, UsageError
from foundation.run_folder.layout import LEDGER


class LedgerKeeper(Ledger):
    """The actor that keeps the ledger. It serves one call at a time, so two workers never claim the same allowance."""

    def ready(self) -> bool:
        """Return True. Callers wait for this answer, because it comes only after the actor has started."""
        return True

    def limit(self, method: str, address: str, model: str, *arguments: object) -> Any:
        """Call a method of the rate limiter of an address, because the limiter itself cannot leave the actor."""
        return getattr(self.limiter(address, model), method)(*arguments)


class RemoteLedger:
    """A worker's access to the ledger of the cluster."""

    def __init__(self, name: str) -> None:
        """`name`: the actor's name without ON_CLUSTER. Raises InfrastructureError if there is no such actor."""
        import ray

        try:
            self._keeper = ray.get_actor(name)
        except ValueError:
            raise InfrastructureError(f"the cluster has no ledger {name}, so its benchmark has ended") from None

    def spend(self, model: str, spent: Spent) -> None:
        """Add the cost of a question. Raises InfrastructureError."""
        self._call("spend", model, spent)

    def spent(self) -> Spent:
        """Return the cost of all models. Raises InfrastructureError."""
        spent = self._call("spent")
        assert isinstance(spent, Spent)
        return spent

    def limiter(self, address: str, model: str) -> "RemoteLimiter":
        return RemoteLimiter(self._call, address, model)

    def close(self) -> None:
        """Do nothing, because the actor outlives its users."""

    def _call(self, method: str, *arguments: object) -> Any:
        import ray

        try:
            return ray.get(getattr(self._keeper, method).remote(*arguments))
        except ray.exceptions.RayError as gone:
            raise InfrastructureError(f"the cluster's ledger cannot be reached: {type(gone).__name__}") from None


class RemoteLimiter:
    """The rate limiter of an address for a whole cluster, a `dronecats.agent.models.rate_limits.Limiter`."""

    def __init__(self, call: Callable[..., Any], address: str, model: str) -> None:
        self._call, self._address, self._model = call, address, model

    def claim(self, tokens: int) -> float:
        """Count a request as sent and return 0, or return the seconds to wait. Raises InfrastructureError."""
        return float(self._call("limit", "claim", self._address, self._model, tokens))

    def update(self, allowances: tuple[Allowance, ...]) -> None:
        """Record the allowances that an answer reported. Raises InfrastructureError."""
        self._call("limit", "update", self._address, self._model, allowances)

    def hold(self, seconds: float) -> None:
        """Block all requests to the address for `seconds`. Raises InfrastructureError."""
        self._call("limit", "hold", self._address, self._model, seconds)


@contextmanager
def accounted(spec: ModelSpec, accounts: Accounts, run: Path) -> Iterator[tuple[Model, Callable[[], str]]]:
    """Open a model for a flight in the run folder `run`; yield the model and a function that returns the run's cost.

    Raises UsageError, BudgetError, InfrastructureError.
    """
    with ExitStack() as opened:
        ledger = opened.enter_context(closing(_books(accounts, run)))
        budget = _budget(accounts)
        budget.check(ledger.spent())
        served = open_model(spec, limiters=ledger.limiter)
        opened.callback(served.close)
        budgeted = BudgetedModel(served, spec, budget, ledger)
        opened.callback(budgeted.book_open)
        model: Model = budgeted
        if accounts.cache is not None:
            cache = opened.enter_context(closing(ReplyCache(Path(accounts.cache))))
            model = CachedModel(model, served.fingerprint, cache)
        yield model, lambda: spent_text(ledger.spent())


def check_budget(accounts: Accounts, run: Path) -> None:
    """Raise BudgetError if the budget of a run is spent. Call it before anything is started."""
    if accounts.cost_limit_usd is None and accounts.token_limit is None:
        return
    with closing(_books(accounts, run)) as ledger:
        _budget(accounts).check(ledger.spent())


def is_spent(accounts: Accounts, run: Path | None) -> bool:
    """Return whether the budget of a run is spent; `run` None: a new run."""
    kept = accounts.ledger or (run and run / LEDGER)
    if kept is None or not Path(kept).exists():
        return False
    try:
        check_budget(accounts, Path(kept).parent)
    except BudgetError:
        return True
    return False


def _books(accounts: Accounts, run: Path) -> LedgerInterface:
    if accounts.ledger is not None and accounts.ledger.startswith(ON_CLUSTER):
        return RemoteLedger(accounts.ledger.removeprefix(ON_CLUSTER))
    return Ledger(run / LEDGER if accounts.ledger is None else Path(accounts.ledger))


def _budget(accounts: Accounts) -> Budget:
    return Budget(accounts.cost_limit_usd, accounts.token_limit)


def spent_in(folder: Path) -> Spent | None:
    """Return the cost of all runs of a benchmark; None if it has no ledger yet. Raises InfrastructureError."""
    if not (folder / LEDGER).exists():
        return None
    try:
        with closing(Ledger(folder / LEDGER)) as ledger:
            return ledger.spent()
    except UsageError as unreadable:  # no usage error: the ledger was written by a run, not named by the user
        raise InfrastructureError(str(unreadable)) from None


Notify = Callable[[str], None]

TEXT = 'The picture does not matter. Answer with this JSON object and nothing else: {"action": "think"}'


class FirstQuestions:
    """Asks each model one small test question before take-off, to find a wrong key or address.

    The answers are not decisions, but the ledger records their cost.
    """

    def __init__(self, flights: Iterable[FlightSpec], run: Path | None, notify: Notify) -> None:
        """`run` is the folder with the ledger; None: a new folder, with nothing spent."""
        self._flights, self._run, self._notify = list(flights), run, notify
        self._costs: list[tuple[str, Spent, Accounts]] = []  # PROVIDER/NAME, cost of the question, accounts

    def ask(self) -> None:
        """Ask each model once. Raises UsageError if a model rejects the question, ModelError if it gives no answer.

        Skips replays, flights whose budget is spent, and flights whose reply cache is not empty.
        """
        models: list[ModelSpec] = []
        for flight in self._flights:
            for model in flight.models:
                if model not in models and not is_spent(flight.accounts, self._run) and not _is_cached(flight.accounts):
                    models.append(model)
                    self._costs.append(self._question(model, flight))

    def book(self, run: Path) -> None:
        """Add the cost of the questions to the ledger of the run folder `run`. Raises InfrastructureError."""
        for model, spent, accounts in self._costs:
            with closing(_books(accounts, run)) as ledger:
                ledger.spend(model, spent)

    def _question(self, spec: ModelSpec, flight: FlightSpec) -> tuple[str, Spent, Accounts]:
        self._notify(f"{spec.title}: test question before take-off …")
        patience_s = GIVE_UP_S if flight.patience_s is None else min(flight.patience_s, GIVE_UP_S)
        model, request = open_model(spec, RetryPolicy(give_up_s=patience_s)), Request(TEXT, (marked_picture(),), False)
        try:
            model.check()
            reply = model.ask(request)
        except ModelRejectedError as rejected:
            raise UsageError(f"{rejected}; there was no flight") from None
        finally:
            model.close()
        why = ending_reason(reply.finish, reply.tokens_out)
        self._notify(f"{spec.title}: answered in {reply.latency_s:.2f} s{f', {why}' if why else ''}")
        return spec.title, spent_on(spec, request, reply), flight.accounts


def _is_cached(accounts: Accounts) -> bool:
    """Return whether a cache has replies, which may answer the whole flight without an endpoint."""
    if accounts.cache is None:
        return False
    with closing(ReplyCache(Path(accounts.cache))) as cache:
        return not cache.is_empty
