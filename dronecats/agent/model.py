"""What the agent needs of a model: text and pictures in, text out."""

from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True, slots=True)
class Request:
    """One step's question."""

    text: str
    images_jpeg: tuple[bytes, ...]  # one per drone, in a fixed order
    thinking: bool  # extended reasoning for this call only
    temperature: float = 0.4
    max_tokens: int = 8192


@dataclass(frozen=True, slots=True)
class Reply:
    """One step's answer."""

    text: str
    latency_s: float  # wall seconds from sending the request to having the answer
    tokens_in: int | None = None
    tokens_out: int | None = None


class Model(Protocol):
    """A pilot behind an interface that any multimodal model fits."""

    name: str

    def ask(self, request: Request) -> Reply:
        """Return the reply. Raises ModelError when there is none to be had."""
        ...

    def close(self) -> None: ...
