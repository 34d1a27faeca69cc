"""Providers of models, and the specification of a model: its provider, its name and its settings."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, Literal

from msgspec import Meta

from dronecats.agent.action import AxisOrder
from foundation.errors import UsageError
from foundation.wording import suggestion

Wire = Literal["openai", "gemini", "anthropic"]  # names of formats; `wire_formats` has a class for each
PAPERS_TEMPERATURE = 0.4
LOOPBACK = "http://127."  # addresses on this machine, which need no key
_EFFORT = {"reasoning_effort": "medium"}, {"reasoning_effort": "none"}
_TEMPLATE = {"chat_template_kwargs": {"enable_thinking": True}}, {"chat_template_kwargs": {"enable_thinking": False}}


@dataclass(frozen=True, slots=True)
class Provider:
    """A family of endpoints.

    Its settings are the defaults of a model without a row in models.toml, so they must suit all models of the provider.
    `thinking` and `quick` are merged into the request body to switch extended reasoning on or off (for Gemini, into
    generationConfig). Both are empty if no switch suits all models; a model without a row then reasons as the server
    decides.
    """

    name: str
    base_url: str | None  # None: must be given with --base-url
    key_variable: str | None  # environment variable that holds the key
    thinking: Mapping[str, Any] = field(default_factory=dict)
    quick: Mapping[str, Any] = field(default_factory=dict)
    temperature: float | None = PAPERS_TEMPERATURE  # None: not sent, since some models reject it
    tokens_field: str = "max_tokens"  # request field that limits the tokens of a reply, in the OpenAI chat format
    root_choice: bool = True  # the server accepts a choice (anyOf) as a schema's root
    wire: Wire = "openai"
    top_p: float | None = None  # None: not sent
    top_k: int | None = None
    effort: tuple[str, ...] = ("reasoning_effort",)  # path of keys to the reasoning effort in the request
    effort_in_capitals: bool = False


PROVIDERS = {
    provider.name: provider
    for provider in (
        Provider(
            "openai",
            "https://api.openai.com/v1",
            "OPENAI_API_KEY",
            temperature=None,  # reasoning models reject it
            tokens_field="max_completion_tokens",
            root_choice=False,
        ),
        Provider(
            "openrouter",
            "https://openrouter.ai/api/v1",
            "OPENROUTER_API_KEY",
            thinking={"reasoning": {"enabled": True}},
            quick={"reasoning": {"enabled": False}},
            root_choice=False,  # because it also serves OpenAI's models
            effort=("reasoning", "effort"),
        ),
        Provider(
            "gemini",
            "https://generativelanguage.googleapis.com/v1",
            "GEMINI_API_KEY",
            # `thinking` and `quick` are empty: Gemini up to 2.5 needs a thinkingBudget, Gemini 3 a thinkingLevel
            wire="gemini",
            top_p=0.95,
            top_k=40,
            effort=("thinkingConfig", "thinkingLevel"),  # from Gemini 3 on
            effort_in_capitals=True,
        ),
        Provider(
            "anthropic",
            "https://api.anthropic.com/v1",
            "ANTHROPIC_API_KEY",
            # Claude Opus 4.7 and later reject a temperature, and also a thinking budget, so `thinking` is empty
            temperature=None,
            wire="anthropic",
            effort=("output_config", "effort"),
        ),
        Provider("vllm", "http://127.0.0.1:8000/v1", "VLLM_API_KEY", *_TEMPLATE),
        Provider("sglang", "http://127.0.0.1:30000/v1", "SGLANG_API_KEY", *_TEMPLATE),
        Provider("llamacpp", "http://127.0.0.1:8080/v1", "LLAMA_API_KEY", *_TEMPLATE),
        Provider("ollama", "http://127.0.0.1:11434/v1", "OLLAMA_API_KEY", *_EFFORT),
        Provider("lmstudio", "http://127.0.0.1:1234/v1", "LMSTUDIO_API_KEY"),
        Provider("litellm", "http://127.0.0.1:4000/v1", "LITELLM_API_KEY", *_EFFORT, root_choice=False),
        Provider("local", None, None),
    )
}


def provider_of(name: str) -> Provider:
    """Return a provider by its name. Raises UsageError with the nearest name."""
    if name in PROVIDERS:
        return PROVIDERS[name]
    raise UsageError(f"model provider '{name}' is not known: {suggestion(name, PROVIDERS, cutoff=0.6)}")


NO_EFFORT = "none"
TEMPERATURE_MAX = 2.0
COUNT_MAX = 100_000_000  # tokens; limit of a setting
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
Dollars = Annotated[  # $ per million tokens
    float, Meta(ge=0.0, le=PRICE_MAX, extra={"wrong": f"is not a number from 0 to {PRICE_MAX:,g}"})
]
Root = Annotated[Literal["object", "array"], Meta(extra={"wrong": 'is not "object", "array" or "none"'})]


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelSpec:
    """A model and its settings. The sampling defaults are the paper's ("Model Serving and Decoding")."""

    provider: Text  # a key of PROVIDERS
    name: Text  # as the provider writes it
    base_url: Text | None = None  # None: the provider's own
    axis_order: AxisOrder = "xy"
    temperature: Temperature | None = PAPERS_TEMPERATURE  # None: not sent, for models that reject it
    top_p: Annotated[float, Meta(ge=0.0, le=1.0)] | None = None  # None: the provider's, if it has one
    top_k: TokenCount | None = None  # None: the provider's, if it has one
    max_tokens: TokenCount = 8192  # limit of a reply with its reasoning
    schema: Root | None = None  # root of the schema that the server enforces; None: none is sent
    thinking: dict[str, Any] | None = None  # request fields with extended reasoning; None: the provider's
    quick: dict[str, Any] | None = None  # request fields without extended reasoning; None: the provider's
    input_usd: Dollars | None = None  # price of questions; None: not known
    output_usd: Dollars | None = None  # price of replies, including reasoning; None: not known
    # request field for `max_tokens` in the OpenAI chat format; None: the provider's
    tokens_field: Literal["max_tokens", "max_completion_tokens"] | None = None
    context_tokens: TokenCount | None = None  # limit of question and reply together; None: not known

    @property
    def title(self) -> str:
        """PROVIDER/NAME, as on the command line."""
        return f"{self.provider}/{self.name}"


def reasoning_fields(spec: ModelSpec, lifted: bool) -> Mapping[str, Any]:
    """Return the fields of a request that switch extended reasoning on (`lifted`) or off."""
    provider = provider_of(spec.provider)
    own, of_provider = (spec.thinking, provider.thinking) if lifted else (spec.quick, provider.quick)
    return of_provider if own is None else own


def with_effort(spec: ModelSpec, effort: str) -> ModelSpec:
    """Return a model that reasons with this effort on every step except the one after a `think`.

    `effort` is the vendor's own word, such as low or none. The request also has the fields of `quick` if the word is
    none, and the fields of `thinking` for any other word.
    """
    provider = provider_of(spec.provider)
    value: Any = effort.upper() if provider.effort_in_capitals else effort
    for key in reversed(provider.effort):
        value = {key: value}
    return replace(spec, quick={**reasoning_fields(spec, lifted=effort != NO_EFFORT), **value})


def spec_of(model: str) -> ModelSpec:
    """Return the model that 'PROVIDER/NAME' names. Raises UsageError for any other form."""
    head, slash, name = model.partition("/")
    if not (slash and name):
        raise UsageError(f"--model must be PROVIDER/NAME, got '{model}'. Known providers: {', '.join(PROVIDERS)}")
    provider = provider_of(head)
    return ModelSpec(provider=provider.name, name=name, temperature=provider.temperature)
