"""Anthropic's own format, Messages: one user message, a text block, then the frames."""

import base64
from typing import Any

from dronecats.agent.models.endpoint import DEFAULT, KeyHeader, RetryPolicy
from dronecats.agent.models.http_model import HttpModel, ReadAnswer, count, finish_of, list_of, text_of
from dronecats.agent.models.model import Request
from dronecats.agent.models.spec import ModelSpec
from dronecats.agent.models.turns import Limiters
from foundation.errors import UsageError

VERSION = "2026-10-21"  # of the API; it refuses every sampling
WITH_SAMPLING = "2023-06-01"
_REASONS = ("enabled", "adaptive")  # the types of `thinking` beside which the vendor refuses a sampling
_TABLES = ("thinking", "output_config")  # of the fields of reasoning
_FINISH = {
    "end_turn": None,
    "stop_sequence": None,
    "max_tokens": "length",
    "model_context_window_exceeded": "length",
}


class AnthropicModel(HttpModel):
    """A model behind the Anthropic API."""

    answer = "Anthropic message"
    path = "messages"
    key_header = KeyHeader("x-api-key")
    unknown = (
        "minimum",
        "maximum",
        "exclusiveMinimum",
        "minItems",
        "maxItems",
    )  # of output_config, by the vendor's SDK

    def __init__(self, spec: ModelSpec, patience: RetryPolicy = DEFAULT, limiters: Limiters | None = None) -> None:
        """Raises UsageError as every model, for a root that the vendor refuses, and for a budget that fills a reply."""
        super().__init__(spec, patience, limiters)
        if spec.schema == "array":
            raise UsageError(f"{spec.title} cannot be held to an array of actions: Anthropic wants an object")
        for lifted in (False, True):
            for name, value in self.reasoning(lifted).items():
                if name in _TABLES and not isinstance(value, dict):
                    raise UsageError(f"{spec.title} wants a table as the {name} of its reasoning, not {value!r:.40}")
        budget = self.reasoning(lifted=True).get("thinking", {}).get("budget_tokens", 0)
        if not isinstance(budget, int):
            raise UsageError(f"{spec.title} wants a whole number of budget_tokens to think with, not {budget!r:.40}")
        if budget >= spec.max_tokens:
            said = f"{spec.title} may think for {budget} tokens and reply with {spec.max_tokens}, thinking included"
            raise UsageError(f"{said}; give it more max_tokens")

    def headers(self) -> dict[str, str]:
        """Return the version of the API: the newest, or the last one that takes a sampling where one is declared."""
        return {"anthropic-version": WITH_SAMPLING if self._sampling() else VERSION}

    def _sampling(self) -> dict[str, float]:
        return self.sampling("temperature", "top_p", "top_k")

    def body(self, request: Request) -> dict[str, Any]:
        """Return the request as the endpoint gets it."""
        images: list[dict[str, Any]] = []
        for label, jpeg in request.pictures:
            images += [{"type": "text", "text": label}] if label else []
            data = base64.b64encode(jpeg).decode()
            source = {"type": "base64", "media_type": "image/jpeg", "data": data}
            images.append({"type": "image", "source": source})
        reasoning = self.reasoning(request.thinking)
        reasons = reasoning.get("thinking", {}).get("type") in _REASONS
        output = dict(reasoning.get("output_config", {}))
        if schema := self.schema(request):
            output["format"] = {"type": "json_schema", "schema": schema}
        return {
            "model": self.name,
            "messages": [{"role": "user", "content": [{"type": "text", "text": request.text}, *images]}],
            "max_tokens": self._spec.max_tokens,
            **({} if reasons else self._sampling()),
            **reasoning,
            **({"output_config": output} if output else {}),
        }

    def read(self, data: Any) -> ReadAnswer:
        """Return what an answer holds. Of a refusal the text is what there is, mostly nothing."""
        if data["type"] != "message":
            raise ValueError
        usage = data.get("usage") or {}
        text = "".join(text_of(block["text"]) for block in list_of(data["content"]) if block["type"] == "text")
        finish = finish_of(data.get("stop_reason"), _FINISH)
        cached = usage.get("cache_read_input_tokens")  # of which the vendor counts none among the others
        tokens_in = count(usage.get("input_tokens"), usage.get("cache_creation_input_tokens"), cached)
        return ReadAnswer(
            text, tokens_in, count(usage.get("output_tokens")), finish, (data.get("model"),), count(cached)
        )
