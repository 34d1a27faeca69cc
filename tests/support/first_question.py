"""The short question to a model before take-off, which tests answer separately from the flight's questions."""

from collections.abc import Callable

from dronecats.agent.models.endpoint import RetryPolicy
from dronecats.agent.models.http_model import HttpModel
from dronecats.agent.models.rate_limits import Limiters
from dronecats.agent.models.spec import ModelSpec
from dronecats.agent.models.wire_formats import open_model
from dronecats.flight.run.accounts import TEXT

Pilot = Callable[[str, list[bytes]], str]


def is_first_question(text: str) -> bool:
    """Return whether the text of a question, or the JSON of a request, contains the question before take-off."""
    return TEXT in text or TEXT.replace('"', '\\"') in text


def after_first_question(pilot: Pilot) -> Pilot:
    """Return a pilot that answers the question before take-off at once, and every other as `pilot` does."""
    return lambda prompt, images: '{"action": "think"}' if is_first_question(prompt) else pilot(prompt, images)


def opened_without_pauses(
    spec: ModelSpec, patience: RetryPolicy | None = None, limiters: Limiters | None = None
) -> HttpModel:
    """Open a model as `open_model` does, but retry without a pause. `patience` is ignored."""
    return open_model(spec, RetryPolicy(pause_s=0.0), limiters)
