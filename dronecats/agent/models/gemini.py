"""Gemini's own format, generateContent: a text part, then the frames. Paper, "API Request Format", second listing."""

import base64
from typing import Any
from urllib.parse import quote

from dronecats.agent.models.endpoint import KeyHeader
from dronecats.agent.models.http_model import HttpModel, ReadAnswer, count, finish_of, list_of, text_of
from dronecats.agent.models.model import Request

_WITHHELD = ("SAFETY", "RECITATION", "BLOCKLIST", "PROHIBITED_CONTENT", "SPII", "IMAGE_SAFETY")
_FINISH = {"STOP": None, "MAX_TOKENS": "length", **dict.fromkeys(_WITHHELD, "filtered")}


class GeminiModel(HttpModel):
    """A model behind the Gemini API."""

    answer = "Gemini content"
    key_header = KeyHeader("x-goog-api-key")
    unknown = ("exclusiveMinimum",)  # of responseJsonSchema, by the vendor's list of what it knows

    @property
    def path(self) -> str:
        """Where requests go: the model's name is part of it."""
        return f"models/{quote(self.name, safe='')}:generateContent"

    def body(self, request: Request) -> dict[str, Any]:
        """Return the request as the endpoint gets it. The reasoning's fields are those of generationConfig."""
        images: list[dict[str, Any]] = []
        for label, jpeg in request.pictures:
            images += [{"text": label}] if label else []
            images.append({"inlineData": {"data": base64.urlsafe_b64encode(jpeg).decode(), "mimeType": "image/jpeg"}})
        config: dict[str, Any] = {
            **self.sampling("temperature", "topP", "topK"),
            "maxOutputTokens": self._spec.max_tokens,
            **self.reasoning(request.thinking),
        }
        if schema := self.schema(request):
            config["responseMimeType"] = "application/json"
            config["responseJsonSchema"] = schema
        return {
            "contents": [{"parts": [{"text": request.text}, *images], "role": "user"}],
            "generationConfig": config,
        }

    def read(self, data: Any) -> ReadAnswer:
        """Return what an answer holds. Thoughts count as tokens and are no text."""
        usage = data.get("usageMetadata") or {}
        tokens_out = count(usage.get("candidatesTokenCount"), usage.get("thoughtsTokenCount"))
        text, finish = _text(data)
        return ReadAnswer(
            text,
            count(usage.get("promptTokenCount")),
            tokens_out,
            finish,
            (data.get("modelVersion"),),
            count(usage.get("cachedContentTokenCount")),
            count(usage.get("thoughtsTokenCount")),
        )


def _text(data: dict[str, Any]) -> tuple[str, str | None]:
    """Return what the model says, and why it ends. What was withheld, or cut off before the first word, is empty."""
    if not data.get("candidates"):
        text_of(data["promptFeedback"]["blockReason"])
        return "", "filtered"
    candidate = data["candidates"][0]
    content = candidate.get("content") or {}
    finish = finish_of(candidate.get("finishReason"), _FINISH)
    if "parts" not in content:
        text_of(candidate["finishReason"])
        return "", finish
    parts = list_of(content["parts"])
    return "".join(text_of(part["text"]) for part in parts if "text" in part and not part.get("thought")), finish
