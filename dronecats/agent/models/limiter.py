"""Who may ask an address now: the border behind which all that ask there, in this process or others, take turns."""

from collections.abc import Callable
from typing import Protocol

from dronecats.agent.models.rate_headers import Allowance


class Limiter(Protocol):
    """One address's turns. Whatever keeps them (a file, a service, a cluster's actor) is this interface."""

    def claim(self, tokens: int) -> float:
        """Count a request of about so many tokens as sent and return 0, or return the s to wait and ask again."""
        ...

    def heard(self, allowances: tuple[Allowance, ...]) -> None:
        """Take in what the headers of an answer allow."""
        ...

    def hold(self, seconds: float) -> None:
        """Let nobody ask there for so long: it has said that it is too much."""
        ...


Limiters = Callable[[str, str], Limiter]  # (address as it may be shown, model) → its limiter


class Unlimited:
    """The limiter of one who asks alone."""

    def claim(self, tokens: int) -> float:
        return 0.0

    def heard(self, allowances: tuple[Allowance, ...]) -> None:
        pass

    def hold(self, seconds: float) -> None:
        pass
