"""Who serves models, where, in which format, with which key, and how each switches extended reasoning."""

import difflib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from foundation.errors import UsageError

Wire = Literal["openai", "gemini", "anthropic"]  # a file of this folder each
PAPERS_TEMPERATURE = 0.4
LOOPBACK = "http://127."  # where an address begins that wants no key
_EFFORT = {"reasoning_effort": "medium"}, {"reasoning_effort": "none"}
_TEMPLATE = {"chat_template_kwargs": {"enable_thinking": True}}, {"chat_template_kwargs": {"enable_thinking": False}}


@dataclass(frozen=True, slots=True)
class Provider:
    """One endpoint family.

    What stands here is sent to a model of which no row in models.toml says otherwise, so it is what all of its models
    take, of whatever generation. `thinking` and `quick` are merged into the request body, with Gemini into its
    generationConfig. Where both are empty there is no switch that all know, and a model without a row reasons as it
    likes.
    """

    name: str
    base_url: str | None  # None: must be given with --base-url
    key_variable: str | None  # environment variable that holds the key
    thinking: Mapping[str, Any] = field(default_factory=dict)
    quick: Mapping[str, Any] = field(default_factory=dict)
    temperature: float | None = PAPERS_TEMPERATURE  # None: none is sent, since some refuse any
    tokens_field: str = "max_tokens"  # in the OpenAI chat format
    root_choice: bool = True  # whether a schema may be a choice (anyOf) at its root
    wire: Wire = "openai"
    top_p: float | None = None  # None: none is sent
    top_k: int | None = None
    effort: tuple[str, ...] = ("reasoning_effort",)  # keys of the request that lead to the effort of its reasoning
    effort_in_capitals: bool = False


PROVIDERS = {
    provider.name: provider
    for provider in (
        Provider(
            "openai",
            "https://api.openai.com/v1",
            "OPENAI_API_KEY",
            temperature=None,  # which those that reason refuse
            tokens_field="max_completion_tokens",
            root_choice=False,
        ),
        Provider(
            "openrouter",
            "https://openrouter.ai/api/v1",
            "OPENROUTER_API_KEY",
            thinking={"reasoning": {"enabled": True}},
            quick={"reasoning": {"enabled": False}},
            root_choice=False,  # like OpenAI's, which are among its models
            effort=("reasoning", "effort"),
        ),
        Provider(
            "gemini",
            "https://generativelanguage.googleapis.com/v1",
            "GEMINI_API_KEY",
            wire="gemini",  # whose models know a thinkingBudget up to 2.5, and a thinkingLevel from 3 on
            top_p=0.95,
            top_k=40,
            effort=("thinkingConfig", "thinkingLevel"),  # of Gemini 3 and later
            effort_in_capitals=True,
        ),
        Provider(
            "anthropic",
            "https://api.anthropic.com/v1",
            "ANTHROPIC_API_KEY",
            temperature=None,  # which is refused from Claude Opus 4.7 on, as is a budget of thinking
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
    """Return a provider by its name. Raises UsageError with the nearest one."""
    if name in PROVIDERS:
        return PROVIDERS[name]
    near = difflib.get_close_matches(name, PROVIDERS, n=1)
    hint = f"did you mean '{near[0]}/…'?" if near else f"known providers: {', '.join(PROVIDERS)}"
    raise UsageError(f"there is no model provider '{name}'; {hint}")
