"""The small question to a model before take-off, answered separately from those of the flight."""

from collections.abc import Callable

from dronecats.agent.models.endpoint import RetryPolicy
from dronecats.agent.models.http_model import HttpModel
from dronecats.agent.models.spec import ModelSpec
from dronecats.agent.models.turns import Limiters
from dronecats.agent.models.wire_formats import open_model
from dronecats.flight.run.accounts import TEXT

Pilot = Callable[[str, list[bytes]], str]


def is_first_question(text: str) -> bool:
    """Return whether a question's text, or the JSON of a whole request, is the one before take-off."""
    return TEXT in text or TEXT.replace('"', '\\"') in text


def after_first_question(pilot: Pilot) -> Pilot:
    """Return a pilot that answers the question before take-off at once, and every other as `pilot` does."""
    return lambda prompt, images: '{"action": "think"}' if is_first_question(prompt) else pilot(prompt, images)


def opened_without_pauses(
    spec: ModelSpec, patience: RetryPolicy | None = None, limiters: Limiters | None = None
) -> HttpModel:
    """Open a model as `open_model` does, but retry without a pause, for any requested patience."""
    return open_model(spec, RetryPolicy(pause_s=0.0), limiters)
