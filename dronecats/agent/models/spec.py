"""A model as a value: who serves it, under which name, and everything that is declared about it."""

from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal

from msgspec import Meta

from dronecats.agent.action import AxisOrder
from dronecats.agent.models.providers import PAPERS_TEMPERATURE, PROVIDERS, provider_of
from foundation.errors import UsageError

NO_EFFORT = "none"
TEMPERATURE_MAX = 2.0
COUNT_MAX = 100_000_000  # of tokens
PRICE_MAX = 100_000.0

Text = Annotated[str, Meta(pattern=r"\S", extra={"wrong": "is not a text"})]
Temperature = Annotated[
    float,
    Meta(
        ge=0.0,
        le=TEMPERATURE_MAX,
        extra={"wrong": f'is not a number from 0 to {TEMPERATURE_MAX:g}, or "none" where none may be sent'},
    ),
]
TokenCount = Annotated[int, Meta(ge=1, le=COUNT_MAX, extra={"wrong": f"is not a whole number from 1 to {COUNT_MAX:,}"})]
Dollars = Annotated[  # per million tokens
    float, Meta(ge=0.0, le=PRICE_MAX, extra={"wrong": f"is not a number from 0 to {PRICE_MAX:,g}"})
]
Root = Annotated[Literal["object", "array"], Meta(extra={"wrong": 'is not "object", "array" or "none"'})]


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelSpec:
    """What `open_model` opens. Sampling is the paper's ("Model Serving and Decoding") unless said otherwise."""

    provider: Text  # a key of providers.PROVIDERS
    name: Text  # as the provider calls it
    base_url: Text | None = None  # None: the provider's own
    axis_order: AxisOrder = "xy"
    temperature: Temperature | None = PAPERS_TEMPERATURE  # None: none is sent, for models that refuse one
    top_p: Annotated[float, Meta(ge=0.0, le=1.0)] | None = None  # None: the provider's, if it has one
    top_k: TokenCount | None = None  # … likewise
    max_tokens: TokenCount = 8192  # of a reply
    schema: Root | None = None  # the root that the server holds replies to; None: none is sent
    thinking: dict[str, Any] | None = None  # fields while reasoning is lifted; None: the provider's
    quick: dict[str, Any] | None = None  # … and while it is not
    input_usd: Dollars | None = None  # of a question; None: not known
    output_usd: Dollars | None = None  # … of a reply, reasoning included
    # what the OpenAI chat format calls max_tokens; None: as the provider calls it
    tokens_field: Literal["max_tokens", "max_completion_tokens"] | None = None
    context_tokens: TokenCount | None = None  # that a question and its reply may have together; None: not known

    @property
    def title(self) -> str:
        """PROVIDER/NAME, as the command line has it."""
        return f"{self.provider}/{self.name}"


def with_effort(spec: ModelSpec, effort: str) -> ModelSpec:
    """Return a model that reasons with this effort on every step but the one after a `think`.

    `effort` is the vendor's own word, as low or none. A chat template's switch is on for all words but none.
    """
    provider = provider_of(spec.provider)
    lifted, quick = (
        of_provider if own is None else own
        for own, of_provider in ((spec.thinking, provider.thinking), (spec.quick, provider.quick))
    )
    value: Any = effort.upper() if provider.effort_in_capitals else effort
    for key in reversed(provider.effort):
        value = {key: value}
    return replace(spec, quick={**(quick if effort == NO_EFFORT else lifted), **value})


def spec_of(model: str, base_url: str | None = None, option: str = "--model") -> ModelSpec:
    """Return the model that 'PROVIDER/NAME' names. Raises UsageError for what has no such form."""
    head, slash, name = model.partition("/")
    if not (slash and name):
        raise UsageError(f"{option} wants PROVIDER/NAME, got '{model}'; known providers: {', '.join(PROVIDERS)}")
    provider = provider_of(head)
    return ModelSpec(provider=provider.name, name=name, base_url=base_url, temperature=provider.temperature)
