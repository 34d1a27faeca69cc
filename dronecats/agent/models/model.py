"""A model as the agent needs it: text and pictures in, text out."""

from dataclasses import dataclass
from typing import Literal, Protocol

REASONS = {  # of `Reply.finish`; {tokens} is the length of the reply
    "length": "cut off at {tokens} tokens: raise max_tokens or lower the reasoning",
    "refusal": "the model refused to answer",
    "filtered": "the provider's filter withheld the reply",
}


def ending_reason(finish: object, tokens_out: int | None) -> str | None:
    """Return why a reply is not all that the model had to say; None where its server gave no reason that is known."""
    reason = REASONS.get(finish) if isinstance(finish, str) else None
    return reason and reason.format(tokens="its limit of" if tokens_out is None else f"{tokens_out:,}")


@dataclass(frozen=True, slots=True)
class Request:
    """One step's question."""

    text: str
    images_jpeg: tuple[bytes, ...]  # one per drone, in a fixed order
    thinking: bool  # extended reasoning for this call only
    labels: tuple[str, ...] = ()  # the line of text before each image; empty: none has one
    # whose question it is, which no format sends: a recorded flight is replayed by it
    step: int = 0  # questions for these drones, or of the commander, before it; under one context the step
    drone: int = 0  # the first of those that are asked for
    role: Literal["pilot", "commander"] = "pilot"
    taken_us: tuple[int, ...] = ()  # µs, vehicle clock, of each picture; empty: now. For pilots that are told the truth

    @property
    def pictures(self) -> list[tuple[str | None, bytes]]:
        """Each image with its label, None where it has none. Raises ValueError where only some have one."""
        labels: tuple[str | None, ...] = self.labels or (None,) * len(self.images_jpeg)
        return list(zip(labels, self.images_jpeg, strict=True))


@dataclass(frozen=True, slots=True)
class Reply:
    """One step's answer."""

    text: str
    latency_s: float  # wall seconds from sending the request that was answered to having the answer
    tokens_in: int | None = None
    tokens_out: int | None = None
    waited_s: float = 0.0  # wall seconds before that request: its turn, earlier ones that failed, and the pauses
    finish: str | None = None  # why it ends there: length, filtered, refusal, or a vendor's word; None: it was done
    served: str | None = None  # what answered, in the vendor's words; None: it told nothing but the name asked for
    tokens_cached: int | None = None  # of tokens_in, those that the vendor had from before; None: not told
    tokens_reasoning: int | None = None  # of tokens_out, those that it reasoned with; None: not told
    endpoint: str | None = None  # whom a router had answer, in its words, as OpenRouter's provider; None: not told

    @property
    def share(self) -> float:
        """Return which part, 0 … 1, of the time until the answer was the model's own."""
        return self.latency_s / (self.latency_s + self.waited_s) if self.waited_s > 0.0 else 1.0


class Model(Protocol):
    """A pilot behind an interface that any multimodal model fits."""

    name: str

    def ask(self, request: Request) -> Reply:
        """Return the reply. Raises ModelError when there is none to be had."""
        ...

    def check(self) -> None:
        """Raise UsageError when nothing answers where the model should be."""
        ...

    def close(self) -> None: ...
