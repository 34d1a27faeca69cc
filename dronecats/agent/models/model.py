"""A model as the agent needs it: text and pictures in, text out; and a model as a value."""

from dataclasses import dataclass
from typing import Any, Literal, Protocol

from dronecats.agent.action import AxisOrder

PAPERS_TEMPERATURE = 0.4


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelSpec:
    """What `open_model` opens. Sampling is the paper's ("Model Serving and Decoding") unless said otherwise."""

    provider: str  # a key of providers.PROVIDERS
    name: str  # as the provider calls it
    base_url: str | None = None  # None: the provider's own
    axis_order: AxisOrder = "xy"
    temperature: float | None = PAPERS_TEMPERATURE  # None: none is sent, for models that refuse one
    top_p: float | None = None  # None: the provider's, if it has one
    top_k: int | None = None  # … likewise
    max_tokens: int = 8192  # of a reply
    schema: Literal["object", "array"] | None = None  # the root that the server holds replies to; None: none is sent
    thinking: dict[str, Any] | None = None  # fields while reasoning is lifted; None: the provider's
    quick: dict[str, Any] | None = None  # … and while it is not
    input_usd: float | None = None  # $ per million tokens of a question; None: not known
    output_usd: float | None = None  # … of a reply, reasoning included
    tokens_field: str | None = None  # what the OpenAI chat format calls max_tokens; None: as the provider calls it
    context_tokens: int | None = None  # that a question and its reply may have together; None: not known

    @property
    def title(self) -> str:
        """PROVIDER/NAME, as the command line has it."""
        return f"{self.provider}/{self.name}"


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
