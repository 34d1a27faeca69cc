"""A model behind an OpenAI-compatible endpoint: one user message, text first, then the frames. Paper, Listing 2."""

import base64
import json
import os
from collections.abc import Mapping
from typing import Any

from dronecats.agent.models.endpoint import DEFAULT, Endpoint, RetryPolicy
from dronecats.agent.models.model import Reply, Request
from dronecats.agent.models.providers import PROVIDERS, provider_of
from dronecats.agent.models.reply_schema import response_format
from dronecats.agent.models.spec import ModelSpec
from foundation.errors import ModelError, UsageError


class ChatModel:
    """`ask` blocks for one HTTP exchange. Keys come from the environment and go nowhere but into the header."""

    def __init__(self, spec: ModelSpec, patience: RetryPolicy = DEFAULT) -> None:
        """Raises UsageError for an unknown provider, and where an address or a key is missing."""
        provider = provider_of(spec.provider)
        url = spec.base_url or provider.base_url
        if url is None:
            raise UsageError(f"--model {spec.title} needs --base-url http://HOST:PORT/v1")
        self.name = spec.name
        self._spec, self._provider = spec, provider
        variables = [known.key_variable for known in PROVIDERS.values() if known.key_variable]
        keys = {variable: os.environ.get(variable, "").strip() for variable in variables}
        key = keys.get(provider.key_variable or "")
        if provider.key_variable and not key and spec.base_url is None and not url.startswith("http://127."):
            raise UsageError(f"{provider.name} needs an API key in the environment variable {provider.key_variable}")
        self._endpoint = Endpoint(url, key, tuple(keys.values()), patience)

    def close(self) -> None:
        self._endpoint.close()

    def check(self) -> None:
        """Raise UsageError when nothing answers at the endpoint; what it answers does not matter here."""
        self._endpoint.check()

    def body(self, request: Request) -> dict[str, Any]:
        """Return the request as the endpoint gets it."""
        images = [
            {"type": "image_url", "image_url": {"url": "data:image/jpeg;base64," + base64.b64encode(jpeg).decode()}}
            for jpeg in request.images_jpeg
        ]
        return {
            "model": self.name,
            "messages": [{"role": "user", "content": [{"type": "text", "text": request.text}, *images]}],
            "temperature": self._spec.temperature,
            self._provider.tokens_field: self._spec.max_tokens,
            **self._reasoning(request.thinking),
            **({"response_format": response_format(self._spec.schema)} if self._spec.schema else {}),
        }

    def _reasoning(self, lifted: bool) -> Mapping[str, Any]:
        """Return the fields that switch extended reasoning on or off."""
        own, of_provider = (
            (self._spec.thinking, self._provider.thinking) if lifted else (self._spec.quick, self._provider.quick)
        )
        return of_provider if own is None else own

    def ask(self, request: Request) -> Reply:
        """Return the reply, without any key of ours that is echoed in it. Raises ModelError."""
        answer = self._endpoint.post("chat/completions", json.dumps(self.body(request)).encode())
        try:
            data = json.loads(answer.body)
            text = data["choices"][0]["message"]["content"]
            usage = data.get("usage") or {}
            tokens_in, tokens_out = (usage.get(key) for key in ("prompt_tokens", "completion_tokens"))
            if text is None:  # everything went into reasoning: an empty answer of the model, not a fault of the wire
                text = ""
            if not isinstance(text, str):
                raise TypeError
        except (ValueError, KeyError, IndexError, TypeError, AttributeError, RecursionError):
            said = f"answered no chat completion but: {self._endpoint.brief(answer.body)}"
            raise ModelError(f"the model endpoint {self._endpoint.shown} {said}") from None
        return Reply(
            self._endpoint.hide(text), answer.latency_s, _count(tokens_in), _count(tokens_out), answer.waited_s
        )


def _count(value: Any) -> int | None:
    return value if isinstance(value, int) and not isinstance(value, bool) else None
