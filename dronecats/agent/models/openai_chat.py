"""The OpenAI chat format: one user message, text first, then the frames, of a fleet each behind its label.

Paper, "API Request Format", first listing.
"""

import base64
from typing import Any

from dronecats.agent.models.endpoint import DEFAULT, RetryPolicy
from dronecats.agent.models.http_model import HttpModel, ReadAnswer, count, finish_of, table_of, text_of
from dronecats.agent.models.model import Request
from dronecats.agent.models.reply_schema import response_format
from dronecats.agent.models.spec import ModelSpec
from dronecats.agent.models.turns import Limiters
from foundation.errors import UsageError

_FINISH = {"stop": None, "length": "length", "content_filter": "filtered"}


class ChatModel(HttpModel):
    """A model behind an OpenAI-compatible endpoint."""

    answer = "chat completion"
    path = "chat/completions"

    def __init__(self, spec: ModelSpec, patience: RetryPolicy = DEFAULT, limiters: Limiters | None = None) -> None:
        """Raises UsageError as every model, and for a root that the vendor refuses at its own address."""
        super().__init__(spec, patience, limiters)
        own = spec.base_url in (None, self._provider.base_url)
        if spec.provider == "openai" and own and spec.schema == "array":
            raise UsageError(
                f"{spec.title} cannot be held to an array of actions: OpenAI wants an object; --schema object holds one"
                " drone's, and a fleet's commander"
            )

    def body(self, request: Request) -> dict[str, Any]:
        """Return the request as the endpoint gets it."""
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
            **self.reasoning(request.thinking),
            **({"response_format": response_format(schema)} if schema else {}),
        }

    def read(self, data: Any) -> ReadAnswer:
        """Return what an answer holds. Of a refusal the text is the model's words for it."""
        choice = data["choices"][0]
        message = choice["message"]
        usage = data.get("usage") or {}
        finish = finish_of(choice.get("finish_reason"), _FINISH)
        text = message["content"]
        if text is None:  # everything went into reasoning, or it refuses: the model's, not a fault of the wire
            text = message.get("refusal") or ""
            finish = finish or ("refusal" if text else None)
        tokens = count(usage.get("prompt_tokens")), count(usage.get("completion_tokens"))
        return ReadAnswer(
            text_of(text),
            *tokens,
            finish,
            (data.get("model"), data.get("system_fingerprint")),
            count(table_of(usage.get("prompt_tokens_details")).get("cached_tokens")),
            count(table_of(usage.get("completion_tokens_details")).get("reasoning_tokens")),
            data.get("provider"),  # OpenRouter's word for who answered
        )
