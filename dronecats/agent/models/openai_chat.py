"""The OpenAI chat format: one user message, text first, then the frames. Paper, "API Request Format", first listing."""

import base64
from typing import Any

from dronecats.agent.models.http_model import HttpModel, count, text_of
from dronecats.agent.models.model import Request
from dronecats.agent.models.reply_schema import response_format


class ChatModel(HttpModel):
    """A model behind an OpenAI-compatible endpoint."""

    answer = "chat completion"
    path = "chat/completions"

    def body(self, request: Request) -> dict[str, Any]:
        """Return the request as the endpoint gets it."""
        images = [
            {"type": "image_url", "image_url": {"url": "data:image/jpeg;base64," + base64.b64encode(jpeg).decode()}}
            for jpeg in request.images_jpeg
        ]
        root = self.root(request)
        return {
            "model": self.name,
            "messages": [{"role": "user", "content": [{"type": "text", "text": request.text}, *images]}],
            **self.sampling("temperature", "top_p", "top_k"),
            self._spec.tokens_field or self._provider.tokens_field: self._spec.max_tokens,
            **self.reasoning(request.thinking),
            **({"response_format": response_format(root)} if root else {}),
        }

    def read(self, data: Any) -> tuple[str, int | None, int | None]:
        """Return (text, tokens in, tokens out) of an answer."""
        text = data["choices"][0]["message"]["content"]
        usage = data.get("usage") or {}
        tokens = count(usage.get("prompt_tokens")), count(usage.get("completion_tokens"))
        if text is None:  # everything went into reasoning: an empty answer of the model, not a fault of the wire
            text = ""
        return (text_of(text), *tokens)
