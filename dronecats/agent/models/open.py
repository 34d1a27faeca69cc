"""The one place where a model is opened."""

from dronecats.agent.models.anthropic import AnthropicModel
from dronecats.agent.models.endpoint import DEFAULT, RetryPolicy
from dronecats.agent.models.gemini import GeminiModel
from dronecats.agent.models.http_model import HttpModel
from dronecats.agent.models.openai_chat import ChatModel
from dronecats.agent.models.providers import Wire, provider_of
from dronecats.agent.models.spec import ModelSpec
from dronecats.agent.models.turns import Limiters

_FORMATS: dict[Wire, type[HttpModel]] = {"openai": ChatModel, "gemini": GeminiModel, "anthropic": AnthropicModel}


def open_model(spec: ModelSpec, patience: RetryPolicy = DEFAULT, limiters: Limiters | None = None) -> HttpModel:
    """Return the client of a model, in the format of its provider; nothing is sent yet.

    `limiters` are those of all that ask where it asks; None: it asks alone.

    Raises UsageError for an unknown provider, where an address or a key is missing, and for what the provider lacks.
    """
    return _FORMATS[provider_of(spec.provider).wire](spec, patience, limiters)
