"""The interface of a model: text and pictures in, text out."""

import math
from dataclasses import dataclass
from typing import Literal, Protocol

REASONS = {  # `Reply.finish` → text; {tokens}: number of tokens, or "its limit of" if it is unknown
    "length": "cut off at {tokens} tokens: raise max_tokens or lower the reasoning",
    "refusal": "the model refused to answer",
    "filtered": "the provider's filter withheld the reply",
}


def ending_reason(finish: object, tokens_out: int | None) -> str | None:
    """Return the reason why a reply is incomplete; None if it is complete or the reason is not known."""
    reason = REASONS.get(finish) if isinstance(finish, str) else None
    return reason and reason.format(tokens="its limit of" if tokens_out is None else f"{tokens_out:,}")


@dataclass(frozen=True, slots=True)
class Request:
    """The question of one step."""

    text: str
    images_jpeg: tuple[bytes, ...]  # one per drone, in a fixed order
    thinking: bool  # extended reasoning for this call only
    labels: tuple[str, ...] = ()  # the line of text before each image; empty: no labels
    # The fields below are not sent. A replay finds the recorded reply by step, drone and role.
    step: int = 0  # from 0: counts the questions to these drones, or to the commander
    drone: int = 0  # first drone of the question
    role: Literal["pilot", "commander"] = "pilot"
    # time of each picture (µs, vehicle clock). The oracle pilot uses the true state at these times; empty: the present
    # state
    taken_us: tuple[int, ...] = ()

    @property
    def pictures(self) -> list[tuple[str | None, bytes]]:
        """Each image with its label or None. Raises ValueError if only some images have a label."""
        labels: tuple[str | None, ...] = self.labels or (None,) * len(self.images_jpeg)
        return list(zip(labels, self.images_jpeg, strict=True))


CHARACTERS_PER_TOKEN = 4  # rule of thumb for English text
IMAGE_TOKENS = 425  # a 640 × 360 frame by OpenAI's published rule: 85 + 170 per 512 px tile, two tiles


def tokens_of_text(text: str) -> int:
    """Return an estimate of the tokens of a text, for a reply without a token count."""
    return math.ceil(len(text) / CHARACTERS_PER_TOKEN)


def tokens_of(request: Request) -> int:
    """Return an estimate of the tokens of a question, before it is sent."""
    return tokens_of_text(request.text) + IMAGE_TOKENS * len(request.images_jpeg)


@dataclass(frozen=True, slots=True)
class Reply:
    """The answer to one question. None stands for a value that the endpoint did not report."""

    text: str
    latency_s: float  # wall seconds of the successful request
    tokens_in: int | None = None
    tokens_out: int | None = None
    waited_s: float = 0.0  # wall seconds before the successful request: rate limit, failed attempts, and pauses
    finish: str | None = None  # reason of an early end: length, filtered, refusal, or a vendor's word; None: complete
    served: str | None = None  # the model that answered, as the vendor names it; None: the requested name
    tokens_cached: int | None = None  # part of tokens_in, from the vendor's cache
    tokens_reasoning: int | None = None  # part of tokens_out, for reasoning
    endpoint: str | None = None  # the provider that a router (OpenRouter) chose
    lost: tuple[int, int] = (0, 0)  # tokens of questions and replies that the vendor counted in failed attempts

    @property
    def share(self) -> float:
        """The successful request's share (0 … 1) of the time from the question to the answer."""
        return self.latency_s / (self.latency_s + self.waited_s) if self.waited_s > 0.0 else 1.0


class Model(Protocol):
    """A multimodal model that answers questions."""

    name: str

    def ask(self, request: Request) -> Reply:
        """Return the reply. Raises ModelError when there is none."""
        ...

    def check(self) -> None:
        """Raise UsageError if the model cannot be reached. A model in this process can always be reached."""
        return

    def close(self) -> None:
        """Release the connection, if there is one."""
        return


class WrappedModel:
    """A model that wraps another one. Subclasses define `ask`."""

    def __init__(self, model: Model) -> None:
        self.name, self._model = model.name, model

    def check(self) -> None:
        """Raise UsageError if the model cannot be reached."""
        self._model.check()

    def close(self) -> None:
        self._model.close()
