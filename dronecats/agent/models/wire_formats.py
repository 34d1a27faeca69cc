"""The wire formats of models: OpenAI chat, Gemini and Anthropic. `open_model` returns the client of a model."""

import base64
from typing import Any
from urllib.parse import quote

from dronecats.agent.models.endpoint import DEFAULT, KeyHeader, RetryPolicy
from dronecats.agent.models.http_model import HttpModel, count, finish_of, list_of, table_of, text_of
from dronecats.agent.models.model import Reply, Request
from dronecats.agent.models.rate_limits import Limiters
from dronecats.agent.models.reply_schema import response_format
from dronecats.agent.models.spec import ModelSpec, Wire, provider_of, reasoning_fields
from foundation.errors import UsageError

_CHAT_FINISH = {"stop": None, "length": "length", "content_filter": "filtered"}


class ChatModel(HttpModel):
    """A model behind an OpenAI-compatible endpoint. Source: paper, "API Request Format", first listing."""

    answer = "chat completion"
    path = "chat/completions"

    def __init__(self, spec: ModelSpec, patience: RetryPolicy = DEFAULT, limiters: Limiters | None = None) -> None:
        """Raises UsageError in the cases of `HttpModel`, and for a schema whose root OpenAI rejects."""
        super().__init__(spec, patience, limiters)
        own = spec.base_url in (None, self._provider.base_url)
        if spec.provider == "openai" and own and spec.schema == "array":
            raise UsageError(
                f"{spec.title} cannot enforce an array of actions, because OpenAI requires an object."
                " Use --schema object for one drone or a commander, else --schema none"
            )

    def body(self, request: Request) -> dict[str, Any]:
        """Return the request body."""
        images: list[dict[str, Any]] = []
        for label, jpeg in request.pictures:
            images += [{"type": "text", "text": label}] if label else []
            url = "data:image/jpeg;base64," + base64.b64encode(jpeg).decode()
            images.append({"type": "image_url", "image_url": {"url": url}})
        schema = self.schema(request)
        return {
            "model": self.name,
            "messages": [{"role": "user", "content": [{"type": "text", "text": request.text}, *images]}],
            **self.sampling("temperature", "top_p", "top_k"),
            self._spec.tokens_field or self._provider.tokens_field: self._spec.max_tokens,
            **reasoning_fields(self._spec, request.thinking),
            **({"response_format": response_format(schema)} if schema else {}),
        }

    def tokens(self, data: Any) -> tuple[int | None, int | None]:
        usage = data.get("usage") or {}
        return count(usage.get("prompt_tokens")), count(usage.get("completion_tokens"))

    def read(self, data: Any) -> Reply:
        """Return the content of an answer. If the model refuses, its refusal is the text."""
        choice = data["choices"][0]
        message = choice["message"]
        usage = data.get("usage") or {}
        finish = finish_of(choice.get("finish_reason"), _CHAT_FINISH)
        text = message.get("content")
        if text is None:  # a valid answer with only reasoning or a refusal; some servers omit the key
            text = message.get("refusal") or ""
            finish = finish or ("refusal" if text else None)
        return Reply(
            text_of(text),
            0.0,
            *self.tokens(data),
            finish=finish,
            served=self.served(data.get("model"), data.get("system_fingerprint")),
            tokens_cached=count(table_of(usage.get("prompt_tokens_details")).get("cached_tokens")),
            tokens_reasoning=count(table_of(usage.get("completion_tokens_details")).get("reasoning_tokens")),
            endpoint=self.words(data.get("provider")) or None,  # OpenRouter's field
        )


_WITHHELD = ("SAFETY", "RECITATION", "BLOCKLIST", "PROHIBITED_CONTENT", "SPII", "IMAGE_SAFETY")
_GEMINI_FINISH = {"STOP": None, "MAX_TOKENS": "length", **dict.fromkeys(_WITHHELD, "filtered")}


class GeminiModel(HttpModel):
    """A model behind the Gemini API, generateContent. Source: paper, "API Request Format", second listing."""

    answer = "Gemini content"
    key_header = KeyHeader("x-goog-api-key")
    listing = "models?pageSize=1000"
    unknown = ("exclusiveMinimum",)  # not in the vendor's list of keywords for responseJsonSchema

    @property
    def path(self) -> str:
        """Path of requests. The model's name is part of it."""
        return f"models/{quote(self.name, safe='')}:generateContent"

    def body(self, request: Request) -> dict[str, Any]:
        """Return the request body. The reasoning fields are part of generationConfig."""
        images: list[dict[str, Any]] = []
        for label, jpeg in request.pictures:
            images += [{"text": label}] if label else []
            images.append({"inlineData": {"data": base64.urlsafe_b64encode(jpeg).decode(), "mimeType": "image/jpeg"}})
        config: dict[str, Any] = {
            **self.sampling("temperature", "topP", "topK"),
            "maxOutputTokens": self._spec.max_tokens,
            **reasoning_fields(self._spec, request.thinking),
        }
        if schema := self.schema(request):
            config["responseMimeType"] = "application/json"
            config["responseJsonSchema"] = schema
        return {"contents": [{"parts": [{"text": request.text}, *images], "role": "user"}], "generationConfig": config}

    def tokens(self, data: Any) -> tuple[int | None, int | None]:
        usage = data.get("usageMetadata") or {}
        tokens_out = count(usage.get("candidatesTokenCount"), usage.get("thoughtsTokenCount"))
        return count(usage.get("promptTokenCount")), tokens_out

    def read(self, data: Any) -> Reply:
        """Return the content of an answer. Thoughts count as tokens, but are not part of the text."""
        usage = data.get("usageMetadata") or {}
        text, finish = _gemini_text(data)
        return Reply(
            text,
            0.0,
            *self.tokens(data),
            finish=finish,
            served=self.served(data.get("modelVersion")),
            tokens_cached=count(usage.get("cachedContentTokenCount")),
            tokens_reasoning=count(usage.get("thoughtsTokenCount")),
        )


def _gemini_text(data: dict[str, Any]) -> tuple[str, str | None]:
    """Return the text and the finish reason. The text is empty if it was withheld, or cut off before its first word."""
    if not data.get("candidates"):
        text_of(data["promptFeedback"]["blockReason"])
        return "", "filtered"
    candidate = data["candidates"][0]
    content = candidate.get("content") or {}
    finish = finish_of(candidate.get("finishReason"), _GEMINI_FINISH)
    if "parts" not in content:
        text_of(candidate["finishReason"])
        return "", finish
    blocks = list_of(content["parts"])
    return "".join(text_of(part["text"]) for part in blocks if "text" in part and not part.get("thought")), finish


ANTHROPIC_VERSION = "2026-10-21"  # newest version of the API, which rejects all sampling parameters
ANTHROPIC_SAMPLING_VERSION = "2023-06-01"  # the last version that accepts sampling parameters
_REASONS = ("enabled", "adaptive")  # types of `thinking` with which the vendor rejects sampling parameters
_TABLES = ("thinking", "output_config")  # reasoning fields that must be tables
_ANTHROPIC_FINISH = {
    "end_turn": None,
    "stop_sequence": None,
    "max_tokens": "length",
    "model_context_window_exceeded": "length",
}


class AnthropicModel(HttpModel):
    """A model behind the Anthropic API, Messages."""

    answer = "Anthropic message"
    path = "messages"
    key_header = KeyHeader("x-api-key")
    listing = "models?limit=1000"
    # keywords of JSON Schema that output_config does not support, according to the vendor's SDK
    unknown = ("minimum", "maximum", "exclusiveMinimum", "minItems", "maxItems")

    def __init__(self, spec: ModelSpec, patience: RetryPolicy = DEFAULT, limiters: Limiters | None = None) -> None:
        """Raises UsageError in the cases of `HttpModel`, and for settings that the vendor rejects.

        The vendor rejects an array as the root of the schema, malformed reasoning fields, and a reasoning budget that
        is not below max_tokens.
        """
        super().__init__(spec, patience, limiters)
        if spec.schema == "array":
            raise UsageError(
                f"{spec.title} cannot enforce an array of actions, because Anthropic requires an object. Use"
                " --schema object or --schema none"
            )
        for lifted in (False, True):
            for name, value in reasoning_fields(spec, lifted).items():
                if name in _TABLES and not isinstance(value, dict):
                    raise UsageError(
                        f"{spec.title} needs a table for {name}, which sets its reasoning; got {value!r:.40}"
                    )
        budget = reasoning_fields(spec, lifted=True).get("thinking", {}).get("budget_tokens", 0)
        if not isinstance(budget, int):
            raise UsageError(f"{spec.title} needs a whole number as budget_tokens, got {budget!r:.40}")
        if budget >= spec.max_tokens:
            limits = (
                f"{spec.title} has budget_tokens = {budget} for reasoning, but max_tokens = {spec.max_tokens}"
                " for the reply with its reasoning"
            )
            raise UsageError(f"{limits}. Raise max_tokens")

    def headers(self) -> dict[str, str]:
        """Return the version header. Requests with sampling parameters need an older version, which accepts them."""
        return {"anthropic-version": ANTHROPIC_SAMPLING_VERSION if self._sampling() else ANTHROPIC_VERSION}

    def _sampling(self) -> dict[str, float]:
        return self.sampling("temperature", "top_p", "top_k")

    def body(self, request: Request) -> dict[str, Any]:
        """Return the request body."""
        images: list[dict[str, Any]] = []
        for label, jpeg in request.pictures:
            images += [{"type": "text", "text": label}] if label else []
            data = base64.b64encode(jpeg).decode()
            source = {"type": "base64", "media_type": "image/jpeg", "data": data}
            images.append({"type": "image", "source": source})
        reasoning = reasoning_fields(self._spec, request.thinking)
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

    def tokens(self, data: Any) -> tuple[int | None, int | None]:
        usage = data.get("usage") or {}
        cached = usage.get("cache_creation_input_tokens"), usage.get("cache_read_input_tokens")  # not in input_tokens
        return count(usage.get("input_tokens"), *cached), count(usage.get("output_tokens"))

    def read(self, data: Any) -> Reply:
        """Return the content of an answer. If the model refuses, the text is usually empty."""
        if data["type"] != "message":
            raise ValueError
        usage = data.get("usage") or {}
        text = "".join(text_of(block["text"]) for block in list_of(data["content"]) if block["type"] == "text")
        finish = finish_of(data.get("stop_reason"), _ANTHROPIC_FINISH)
        cached = count(usage.get("cache_read_input_tokens"))
        served = self.served(data.get("model"))
        return Reply(text, 0.0, *self.tokens(data), finish=finish, served=served, tokens_cached=cached)


_FORMATS: dict[Wire, type[HttpModel]] = {"openai": ChatModel, "gemini": GeminiModel, "anthropic": AnthropicModel}


def open_model(spec: ModelSpec, patience: RetryPolicy = DEFAULT, limiters: Limiters | None = None) -> HttpModel:
    """Return the client of a model, in the format of its provider. Nothing is sent yet.

    `limiters` returns the shared rate limiter of an address; None: no limit. Raises UsageError for an unknown provider,
    a missing address or key, and settings that the provider does not support.
    """
    return _FORMATS[provider_of(spec.provider).wire](spec, patience, limiters)
