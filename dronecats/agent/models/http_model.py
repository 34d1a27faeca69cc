"""Base class of models behind an HTTP endpoint. It handles keys, requests, answers and errors for all wire formats."""

import hashlib
import json
import os
from abc import ABC, abstractmethod
from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from typing import Any, ClassVar

from dronecats.agent.models.endpoint import BEARER, DEFAULT, HEADERS, NOT_FOUND, Endpoint, KeyHeader, RetryPolicy
from dronecats.agent.models.model import Reply, Request, tokens_of
from dronecats.agent.models.rate_limits import Limiters
from dronecats.agent.models.reply_schema import known_part, orders_schema, reply_schema
from dronecats.agent.models.spec import LOOPBACK, PROVIDERS, ModelSpec, provider_of
from foundation.errors import ModelError, ModelRejectedError, UsageError
from foundation.redaction import keyless, redacted_url
from foundation.wording import did_you_mean, nearest

MAX_FINISH_CHARS = 40  # longest text of `finish` in a `Reply`
MAX_SERVED_CHARS = 100  # longest text of `served` and of `endpoint` in a `Reply`
TOKENS_MAX = 1_000_000_000  # a larger token count in an answer is invalid


class HttpModel(ABC):
    """A model behind an HTTP endpoint. API keys are read from the environment and sent only in the header."""

    answer: ClassVar[str]  # name of an answer, in the error message "sent something other than a …"
    key_header: ClassVar[KeyHeader] = BEARER
    listing: ClassVar[str] = "models"  # path of the list of models; its query, if any, requests the longest page
    unknown: ClassVar[Collection[str]] = ()  # keywords of JSON Schema that the format does not support

    def __init__(self, spec: ModelSpec, patience: RetryPolicy = DEFAULT, limiters: Limiters | None = None) -> None:
        """Raises UsageError for an unknown provider, and for a missing address or key."""
        provider = provider_of(spec.provider)
        if not spec.name.isprintable():
            raise UsageError(f"the model's name {ascii(spec.name)[:80]} has a character that a name cannot have")
        url = spec.base_url or provider.base_url
        if url is None:
            raise UsageError(f"--model {spec.title} needs --base-url http://HOST:PORT/v1")
        self.name = spec.name
        self._spec, self._provider = spec, provider
        variables = [listed.key_variable for listed in PROVIDERS.values() if listed.key_variable]
        keys = {variable: os.environ.get(variable, "").strip() for variable in variables}
        key = keys.get(provider.key_variable or "")
        if provider.key_variable and not key and spec.base_url is None and not url.startswith(LOOPBACK):
            raise UsageError(
                f"{provider.name} needs an API key, but the environment variable {provider.key_variable} is not set."
                f" Set it: export {provider.key_variable}=…"
            )
        headers = {**HEADERS, **self.headers()}
        self._address = keyless(url)
        limiter = limiters(redacted_url(url), spec.name) if limiters else None
        self._endpoint = Endpoint(
            url, key, tuple(keys.values()), patience, self.key_header, headers, limiter, provider.key_variable
        )

    def close(self) -> None:
        self._endpoint.close()

    def check(self) -> None:
        """Raise UsageError if nothing answers at the endpoint. Any answer is enough."""
        self._endpoint.check()

    @property
    def address(self) -> str:
        """Address of requests, redacted."""
        base, mark, query = self._endpoint.shown.partition("?")
        return f"{base.rstrip('/')}/{self.path}{mark}{query}"

    def headers(self) -> dict[str, str]:
        """Return additional headers of this format."""
        return {}

    @property
    @abstractmethod
    def path(self) -> str:
        """Path of requests below the base URL, without a slash before it."""

    @abstractmethod
    def body(self, request: Request) -> dict[str, Any]:
        """Return the request body."""

    @abstractmethod
    def tokens(self, data: Any) -> tuple[int | None, int | None]:
        """Return the token counts (question, reply) that an answer reports. Raises the errors of `read`."""

    @abstractmethod
    def read(self, data: Any) -> Reply:
        """Return the reply in an answer, without the reply's times. The text and `finish` may still contain API keys.

        Raises KeyError, IndexError, TypeError, AttributeError or ValueError for data in another format.
        """

    def fingerprint(self, request: Request) -> str:
        """Return the identity of a question: the SHA-256 of its address, format, headers and body, without the key."""
        question = [self._address, self.answer, self.headers(), self.body(request)]
        return hashlib.sha256(json.dumps(question, sort_keys=True).encode()).hexdigest()

    def ask(self, request: Request) -> Reply:
        """Return the reply to a question, with the API keys removed. Raises ModelError, ModelRejectedError.

        `lost` of the reply or the error counts the tokens of failed answers, because a vendor may charge for them.
        """
        failed: list[bytes] = []  # bodies of the failed answers
        try:
            reply = self._reply(request, failed)
        except ModelError as error:
            error.lost = self._counted(failed)
            raise
        return replace(reply, lost=self._counted(failed))

    def _reply(self, request: Request, failed: list[bytes]) -> Reply:
        try:
            answer = self._endpoint.post(self.path, json.dumps(self.body(request)).encode(), tokens_of(request), failed)
        except ModelRejectedError as rejected:
            raise ModelRejectedError(f"{rejected}{self._near(rejected.status)}", rejected.status) from None
        if answer.filtered:
            return Reply("", answer.latency_s, 0, 0, answer.waited_s, "filtered")
        try:
            content = self.read(json.loads(answer.body))
        except (ValueError, KeyError, IndexError, TypeError, AttributeError, RecursionError):
            failed.append(answer.body)
            problem = f"sent something other than a {self.answer}: {self._endpoint.brief(answer.body)}"
            raise ModelError(f"the model endpoint {self._endpoint.shown} {problem}") from None
        return replace(
            content,
            text=self._endpoint.hide(content.text),
            finish=content.finish and self._endpoint.hide(content.finish),
            latency_s=answer.latency_s,
            waited_s=answer.waited_s,
        )

    def _counted(self, answers: Iterable[bytes]) -> tuple[int, int]:
        """Return the total token counts (questions, replies) that these answers report."""
        tokens_in = tokens_out = 0
        for body in answers:
            try:
                asked, replied = self.tokens(json.loads(body))
            except (ValueError, KeyError, IndexError, TypeError, AttributeError, RecursionError):
                continue
            tokens_in, tokens_out = tokens_in + (asked or 0), tokens_out + (replied or 0)
        return tokens_in, tokens_out

    def listed(self) -> list[str]:
        """Return the names of the models that the endpoint lists. Raises ModelError."""
        body = self._endpoint.get(self.listing)
        try:
            data = json.loads(body)
            names = [entry["id"] for entry in data["data"]] if "data" in data else [m["name"] for m in data["models"]]
            shown = [self._endpoint.hide(text_of(name)).removeprefix("models/") for name in names]
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
            problem = f"sent something other than a list of models: {self._endpoint.brief(body)}"
            raise ModelError(f"the model endpoint {self._endpoint.shown} {problem}") from None
        return [name for name in shown if name.isprintable()]

    def _near(self, status: int) -> str:
        """Return a hint with similar model names at the endpoint, if the status may mean an unknown model."""
        if status != NOT_FOUND:
            return ""
        try:
            names = self.listed()
        except ModelError:
            return ""
        near = nearest(self.name, names, cutoff=0.5) if self.name not in names else []
        return f"; {did_you_mean(near)}" if near else ""

    def served(self, *names: Any) -> str | None:
        """Return the name of the model that answered, on one line; None if it is empty or the requested name."""
        words = self.words(*names)
        return None if words in ("", self.name) else words

    def words(self, *names: Any) -> str:
        """Return a vendor's texts on one line; other values are left out."""
        named = (self._endpoint.hide(name) for name in names if isinstance(name, str) and name.isprintable())
        return " ".join(name[:MAX_SERVED_CHARS] for name in named).strip()

    def schema(self, request: Request) -> dict[str, Any] | None:
        """Return the schema to send for the reply; None if there is none for this question.

        A commander has its own schema. The schema of a single action does not fit the reply for a fleet.
        """
        root, drones = self._spec.schema, len(request.images_jpeg)
        if root is None or (request.role == "pilot" and root == "object" and drones != 1):
            return None
        orders = request.role == "commander"
        schema = orders_schema(drones) if orders else reply_schema(root, self._provider.root_choice)
        known: dict[str, Any] = known_part(schema, self.unknown)
        return known

    def sampling(self, temperature: str, top_p: str, top_k: str) -> dict[str, float]:
        """Return the sampling settings to send. Arguments: names of their fields in the wire format."""
        spec, provider = self._spec, self._provider
        declared = {
            temperature: spec.temperature,
            top_p: provider.top_p if spec.top_p is None else spec.top_p,
            top_k: provider.top_k if spec.top_k is None else spec.top_k,
        }
        return {name: value for name, value in declared.items() if value is not None}


def finish_of(value: Any, words: Mapping[str, str | None]) -> str | None:
    """Return the finish reason for a vendor's word, by the table `words`; the word itself if it is not in the table."""
    if not isinstance(value, str):
        return None
    return words.get(value, value[:MAX_FINISH_CHARS])


def table_of(value: Any) -> dict[str, Any]:
    """Return `value` if it is a dict, else an empty dict."""
    return value if isinstance(value, dict) else {}


def text_of(value: Any) -> str:
    """Return `value` if it is a text. Raises TypeError for anything else."""
    if not isinstance(value, str):
        raise TypeError
    return value


def list_of(value: Any) -> list[Any]:
    """Return `value` if it is a list. Raises TypeError for anything else."""
    if not isinstance(value, list):
        raise TypeError
    return value


def count(*values: Any) -> int | None:
    """Return the sum of the valid token counts, 0 … TOKENS_MAX; None if none is valid."""
    counts = [value for value in values if type(value) is int and 0 <= value <= TOKENS_MAX]
    return sum(counts) if counts else None
