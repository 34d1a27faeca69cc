"""The one place where a model is opened."""

from dronecats.agent.models.endpoint import DEFAULT, RetryPolicy
from dronecats.agent.models.model import Model
from dronecats.agent.models.openai_chat import ChatModel
from dronecats.agent.models.spec import ModelSpec


def open_model(spec: ModelSpec, patience: RetryPolicy = DEFAULT) -> Model:
    """Return the client of a model; nothing is sent yet.

    Raises UsageError for an unknown provider, and where an address or a key is missing.
    """
    return ChatModel(spec, patience)
