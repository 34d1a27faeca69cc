"""The one place where a model is opened."""

from dronecats.agent.models.anthropic import AnthropicModel
from dronecats.agent.models.endpoint import DEFAULT, RetryPolicy
from dronecats.agent.models.gemini import GeminiModel
from dronecats.agent.models.http_model import HttpModel
from dronecats.agent.models.model import Model
from dronecats.agent.models.openai_chat import ChatModel
from dronecats.agent.models.providers import Wire, provider_of
from dronecats.agent.models.spec import ModelSpec

_FORMATS: dict[Wire, type[HttpModel]] = {"openai": ChatModel, "gemini": GeminiModel, "anthropic": AnthropicModel}


def open_model(spec: ModelSpec, patience: RetryPolicy = DEFAULT) -> Model:
    """Return the client of a model, in the format of its provider; nothing is sent yet.

    Raises UsageError for an unknown provider, where an address or a key is missing, and for what the provider lacks.
    """
    return open_http(spec, patience)


def open_http(spec: ModelSpec, patience: RetryPolicy = DEFAULT) -> HttpModel:
    """Return the same as what it is behind the interface, whose requests can be looked at."""
    return _FORMATS[provider_of(spec.provider).wire](spec, patience)
