"""A model as a value: who serves it, under which name, and everything that is declared about it."""

from dataclasses import dataclass
from typing import Any, Literal

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
