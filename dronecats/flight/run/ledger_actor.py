"""The ledger of a cluster: one actor keeps the file, and whoever asks a model anywhere books and waits there.

`Accounts.ledger` names it, behind ON_CLUSTER. Needs the extra `cluster`.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from dronecats.agent.models.ledger import Ledger, Spent
from dronecats.agent.models.turns import Allowance
from foundation.errors import InfrastructureError


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

    def heard(self, address: str, model: str, allowances: tuple[Allowance, ...]) -> None:
        self._ledger.limiter(address, model).heard(allowances)

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

    def heard(self, allowances: tuple[Allowance, ...]) -> None:
        """Take in what an answer allows. Raises InfrastructureError."""
        self._ask("heard", self._address, self._model, allowances)

    def hold(self, seconds: float) -> None:
        """Let nobody ask there for so long. Raises InfrastructureError."""
        self._ask("hold", self._address, self._model, seconds)
