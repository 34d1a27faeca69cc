"""Who serves models in the OpenAI chat format, where, with which key, and how each switches extended reasoning."""

import difflib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from dronecats.agent.models.spec import ModelSpec
from foundation.errors import UsageError


@dataclass(frozen=True, slots=True)
class Provider:
    """One endpoint family. `thinking` and `quick` are merged into the request body."""

    name: str
    base_url: str | None  # None: must be given with --base-url
    key_variable: str | None  # environment variable that holds the key
    thinking: Mapping[str, Any] = field(default_factory=dict)
    quick: Mapping[str, Any] = field(default_factory=dict)
    tokens_field: str = "max_tokens"


PROVIDERS = {
    provider.name: provider
    for provider in (
        Provider(
            "openai",
            "https://api.openai.com/v1",
            "OPENAI_API_KEY",
            thinking={"reasoning_effort": "medium"},
            quick={"reasoning_effort": "minimal"},
            tokens_field="max_completion_tokens",
        ),
        Provider(
            "openrouter",
            "https://openrouter.ai/api/v1",
            "OPENROUTER_API_KEY",
            thinking={"reasoning": {"enabled": True}},
            quick={"reasoning": {"enabled": False}},
        ),
        Provider(
            "vllm",
            "http://127.0.0.1:8000/v1",
            "VLLM_API_KEY",
            thinking={"chat_template_kwargs": {"enable_thinking": True}},
            quick={"chat_template_kwargs": {"enable_thinking": False}},
        ),
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


def spec_of(model: str, base_url: str | None = None) -> ModelSpec:
    """Return the model that 'PROVIDER/NAME' names. Raises UsageError for what has no such form."""
    head, slash, name = model.partition("/")
    if not (slash and name):
        raise UsageError(f"--model wants PROVIDER/NAME, got '{model}'; known providers: {', '.join(PROVIDERS)}")
    return ModelSpec(provider=provider_of(head).name, name=name, base_url=base_url)
