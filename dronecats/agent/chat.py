"""A model behind an OpenAI-compatible endpoint: one user message, text first, then the frames. Paper, Listing 2."""

import base64
import json
import os
import time
from typing import Any

import httpx

from dronecats.agent.model import Reply, Request
from dronecats.agent.providers import Provider
from dronecats.border.errors import ModelError, UsageError
from dronecats.border.redaction import redacted

ATTEMPTS = 3  # for answers that ask to be tried again: 408, 429 and 5xx
TIMEOUT = httpx.Timeout(300.0, connect=10.0)  # s; extended reasoning takes minutes


class ChatModel:
    """`ask` blocks for one HTTP exchange. Keys come from the environment and go nowhere but into the header."""

    def __init__(self, provider: Provider, name: str, base_url: str | None = None) -> None:
        url = base_url or provider.base_url
        if url is None:
            raise UsageError(f"--model {provider.name}/{name} needs --base-url http://HOST:PORT/v1")
        self.name = name
        self.provider = provider
        self.base_url = url.rstrip("/")
        key = os.environ.get(provider.key_variable) if provider.key_variable else None
        if provider.key_variable and key is None and base_url is None and not self.base_url.startswith("http://127."):
            raise UsageError(f"{provider.name} needs an API key in the environment variable {provider.key_variable}")
        self._key = key
        headers = {"Authorization": f"Bearer {key}"} if key else {}
        try:
            self._http = httpx.Client(headers=headers, timeout=TIMEOUT)
            httpx.URL(self.base_url)
        except (httpx.InvalidURL, ValueError) as error:
            raise UsageError(f"--base-url '{redacted(url)}' is not a URL: {error}") from None

    def close(self) -> None:
        self._http.close()

    def check(self) -> None:
        """Raise UsageError when nothing answers at the endpoint; what it answers does not matter here."""
        try:
            self._http.get(f"{self.base_url}/models", timeout=10.0)
        except httpx.UnsupportedProtocol:
            raise UsageError(f"--base-url '{self._where}' must start with http:// or https://") from None
        except (httpx.HTTPError, httpx.InvalidURL) as error:
            raise UsageError(f"the model endpoint {self._where} cannot be reached: {self._reason(error)}") from None

    @property
    def _where(self) -> str:
        return redacted(self.base_url)

    def _reason(self, error: Exception) -> str:
        return redacted(str(error), self._key) or type(error).__name__

    def _said(self, response: httpx.Response) -> str:
        return redacted(" ".join(response.text.split()), self._key)[:200] or "(empty)"

    def body(self, request: Request) -> dict[str, Any]:
        """Return the request as the endpoint gets it."""
        images = [
            {"type": "image_url", "image_url": {"url": "data:image/jpeg;base64," + base64.b64encode(jpeg).decode()}}
            for jpeg in request.images_jpeg
        ]
        return {
            "model": self.name,
            "messages": [{"role": "user", "content": [{"type": "text", "text": request.text}, *images]}],
            "temperature": request.temperature,
            self.provider.tokens_field: request.max_tokens,
            **(self.provider.thinking if request.thinking else self.provider.quick),
        }

    def ask(self, request: Request) -> Reply:
        content = json.dumps(self.body(request)).encode()
        started = time.monotonic()  # model latency is the one thing measured on the wall clock here
        for attempt in range(1, ATTEMPTS + 1):
            try:
                response = self._http.post(
                    f"{self.base_url}/chat/completions", content=content, headers={"Content-Type": "application/json"}
                )
            except httpx.HTTPError as error:
                raise ModelError(f"the model endpoint {self._where} broke off: {self._reason(error)}") from None
            latency_s = time.monotonic() - started
            if response.status_code == 200:
                return self._reply(response, latency_s)
            again = response.status_code in (408, 429) or response.status_code >= 500
            if not again or attempt == ATTEMPTS:
                break
            time.sleep(_pause_s(response, attempt))
        raise ModelError(
            f"the model endpoint {self._where} answered {response.status_code}: {self._said(response)}"
        ) from None

    def _reply(self, response: httpx.Response, latency_s: float) -> Reply:
        try:
            data = response.json()
            text = data["choices"][0]["message"]["content"]
            usage = data.get("usage") or {}
            tokens = [usage.get(key) for key in ("prompt_tokens", "completion_tokens")]
            if text is None:  # everything went into reasoning: an empty answer of the model, not a fault of the wire
                text = ""
            if not isinstance(text, str):
                raise TypeError
        except (ValueError, KeyError, IndexError, TypeError, AttributeError, RecursionError):
            said = self._said(response)
            raise ModelError(f"the model endpoint {self._where} answered no chat completion but: {said}") from None
        counted = [count if isinstance(count, int) and not isinstance(count, bool) else None for count in tokens]
        return Reply(text, latency_s, *counted)


def _pause_s(response: httpx.Response, attempt: int) -> float:
    try:
        return min(60.0, max(0.0, float(response.headers["retry-after"])))
    except (KeyError, ValueError):
        return 2.0**attempt
