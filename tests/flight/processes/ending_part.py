"""A child process that ends soon after its start, as if its cable were pulled, or runs until it is closed."""

import time
from dataclasses import dataclass
from typing import Any

from foundation.errors import LinkError


@dataclass(frozen=True, slots=True, kw_only=True)
class EndingConfig:
    """The number of turns until the part ends."""

    turns: int | None = None  # None: it runs until it is closed


class EndingPart:
    """Raises LinkError after its last turn."""

    def __init__(self, config: EndingConfig) -> None:
        self._left = config.turns

    def ready(self) -> dict[str, Any]:
        return {}

    def do(self, command: str, arguments: dict[str, Any]) -> Any:
        return None

    def turn(self) -> None:
        if self._left is None:
            time.sleep(0.01)
            return
        self._left -= 1
        if self._left < 0:
            raise LinkError("the wire is out")

    def close(self) -> None:
        pass
