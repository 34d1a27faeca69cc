"""A model behind an endpoint: what the wire formats share, from the key in its header to an answer that is none."""

import difflib
import hashlib
import json
import os
from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from dronecats.agent.models.endpoint import BEARER, DEFAULT, HEADERS, NOT_FOUND, Endpoint, KeyHeader, RetryPolicy
from dronecats.agent.models.model import Reply, Request
from dronecats.agent.models.providers import LOOPBACK, PROVIDERS, provider_of
from dronecats.agent.models.reply_schema import known_part, orders_schema, reply_schema
from dronecats.agent.models.spec import ModelSpec
from dronecats.agent.models.turns import Limiters
from foundation.errors import ModelError, ModelRejectedError, UsageError
from foundation.redaction import keyless, redacted_url

CHARACTERS_PER_TOKEN = 4  # rule of thumb for English text
IMAGE_TOKENS = 425  # a 640 × 360 frame by OpenAI's published rule
MAX_FINISH_CHARS = 40
MAX_SERVED_CHARS = 100  # of each word by which a vendor names what answers
TOKENS_MAX = 1_000_000_000  # of one question: an endpoint that tells more, or less than none, has not counted


@dataclass(frozen=True, slots=True)
class ReadAnswer:
    """What an answer holds."""

    text: str
    tokens_in: int | None = None
    tokens_out: int | None = None
    finish: str | None = None  # why it ends there: length, filtered, refusal, or a vendor's word; None: it was done
    served: tuple[Any, ...] = ()  # the model's name, and the version of what serves it, as far as they are told
    tokens_cached: int | None = None  # as in `Reply`, and both below
    tokens_reasoning: int | None = None
    endpoint: Any = None


class HttpModel(ABC):
    """`ask` blocks for one HTTP exchange. Keys come from the environment and go nowhere but into the header."""

    answer: ClassVar[str]  # what a proper answer is called
    key_header: ClassVar[KeyHeader] = BEARER
    unknown: ClassVar[Collection[str]] = ()  # keywords of JSON Schema that the format does not know

    def __init__(self, spec: ModelSpec, patience: RetryPolicy = DEFAULT, limiters: Limiters | None = None) -> None:
        """`limiters` are those of all that share an address.

        Raises UsageError for an unknown provider, and where an address or a key is missing.
        """
        provider = provider_of(spec.provider)
        if not spec.name.isprintable():
            raise UsageError(f"the model's name {ascii(spec.name)[:80]} holds a character that is none of a name")
        url = spec.base_url or provider.base_url
        if url is None:
            raise UsageError(f"--model {spec.title} needs --base-url http://HOST:PORT/v1")
        self.name = spec.name
        self._spec, self._provider = spec, provider
        variables = [known.key_variable for known in PROVIDERS.values() if known.key_variable]
        keys = {variable: os.environ.get(variable, "").strip() for variable in variables}
        key = keys.get(provider.key_variable or "")
        if provider.key_variable and not key and spec.base_url is None and not url.startswith(LOOPBACK):
            raise UsageError(f"{provider.name} needs an API key in the environment variable {provider.key_variable}")
        headers = {**HEADERS, **self.headers()}
        self._address = keyless(url)
        limiter = limiters(redacted_url(url), spec.name) if limiters else None
        self._endpoint = Endpoint(
            url, key, tuple(keys.values()), patience, self.key_header, headers, limiter, provider.key_variable
        )

    def close(self) -> None:
        self._endpoint.close()

    def check(self) -> None:
        """Raise UsageError when nothing answers at the endpoint; what it answers does not matter here."""
        self._endpoint.check()

    @property
    def address(self) -> str:
        """Where requests go, as it may be shown."""
        base, mark, query = self._endpoint.shown.partition("?")
        return f"{base.rstrip('/')}/{self.path}{mark}{query}"

    def headers(self) -> dict[str, str]:
        """Return the headers of this format, beside those of every request and the key."""
        return {}

    @property
    @abstractmethod
    def path(self) -> str:
        """Where requests go, below the base URL and without a slash before it."""

    @abstractmethod
    def body(self, request: Request) -> dict[str, Any]:
        """Return the request as the endpoint gets it."""

    @abstractmethod
    def read(self, data: Any) -> ReadAnswer:
        """Return what an answer holds; the text is empty where the model says nothing.

        Raises KeyError, IndexError, TypeError, AttributeError or ValueError for what is no answer of this format.
        """

    def fingerprint(self, request: Request) -> str:
        """Return what tells a question from every other: SHA-256 of the exact body, its format and its address.

        No key is in it: whoever asks the same with another one is answered the same.
        """
        asked = [self._address, self.answer, self.headers(), self.body(request)]
        return hashlib.sha256(json.dumps(asked, sort_keys=True).encode()).hexdigest()

    def ask(self, request: Request) -> Reply:
        """Return the reply, without any key of ours that is echoed in it. Raises ModelError, ModelRejectedError."""
        try:
            answer = self._endpoint.post(self.path, json.dumps(self.body(request)).encode(), tokens_of(request))
        except ModelRejectedError as rejected:
            raise ModelRejectedError(f"{rejected}{self._near(rejected.status)}", rejected.status) from None
        try:
            said = self.read(json.loads(answer.body))
        except (ValueError, KeyError, IndexError, TypeError, AttributeError, RecursionError):
            what = f"answered no {self.answer} but: {self._endpoint.brief(answer.body)}"
            raise ModelError(f"the model endpoint {self._endpoint.shown} {what}") from None
        text, finish = self._endpoint.hide(said.text), said.finish and self._endpoint.hide(said.finish)
        return Reply(
            text,
            answer.latency_s,
            said.tokens_in,
            said.tokens_out,
            answer.waited_s,
            finish,
            self._served(said.served),
            said.tokens_cached,
            said.tokens_reasoning,
            self._words((said.endpoint,)) or None,
        )

    def listed(self) -> list[str]:
        """Return the models that the endpoint lists, by the names that it has for them. Raises ModelError."""
        body = self._endpoint.get("models")
        try:
            data = json.loads(body)
            names = [entry["id"] for entry in data["data"]] if "data" in data else [m["name"] for m in data["models"]]
            shown = [self._endpoint.hide(text_of(name)).removeprefix("models/") for name in names]
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
            what = f"answered no list of models but: {self._endpoint.brief(body)}"
            raise ModelError(f"the model endpoint {self._endpoint.shown} {what}") from None
        return [name for name in shown if name.isprintable()]

    def _near(self, status: int) -> str:
        """Return which models of the endpoint have a name like this one's, where it may be unknown there."""
        if status != NOT_FOUND:
            return ""
        try:
            names = self.listed()
        except ModelError:
            return ""
        near = difflib.get_close_matches(self.name, names, cutoff=0.5) if self.name not in names else []
        return f"; did you mean {' or '.join(near)}?" if near else ""

    def _served(self, told: tuple[Any, ...]) -> str | None:
        """Return what answered, in one line; None where it told nothing but the name that was asked for."""
        words = self._words(told)
        return None if words in ("", self.name) else words

    def _words(self, told: tuple[Any, ...]) -> str:
        """Return what a vendor tells in one line, without what is no text."""
        named = (self._endpoint.hide(each) for each in told if isinstance(each, str) and each.isprintable())
        return " ".join(each[:MAX_SERVED_CHARS] for each in named).strip()

    def reasoning(self, lifted: bool) -> Mapping[str, Any]:
        """Return the fields of the request that switch extended reasoning on or off."""
        own, of_provider = (
            (self._spec.thinking, self._provider.thinking) if lifted else (self._spec.quick, self._provider.quick)
        )
        return of_provider if own is None else own

    def schema(self, request: Request) -> dict[str, Any] | None:
        """Return the schema that the reply is held to; None where none is sent, or none describes it.

        A commander has a schema of its own, and a single action cannot answer for a fleet.
        """
        root, drones = self._spec.schema, len(request.images_jpeg)
        if root is None or (request.role == "pilot" and root == "object" and drones != 1):
            return None
        orders = request.role == "commander"
        schema = orders_schema(drones) if orders else reply_schema(root, self._provider.root_choice)
        return known_part(schema, self.unknown)

    def sampling(self, temperature: str, top_p: str, top_k: str) -> dict[str, float]:
        """Return the sampling that is declared, under the names that the format has for it."""
        spec, provider = self._spec, self._provider
        declared = {
            temperature: spec.temperature,
            top_p: provider.top_p if spec.top_p is None else spec.top_p,
            top_k: provider.top_k if spec.top_k is None else spec.top_k,
        }
        return {name: value for name, value in declared.items() if value is not None}


def tokens_of(request: Request) -> int:
    """Return about how many tokens a question has, for those who have to know before it is answered."""
    return len(request.text) // CHARACTERS_PER_TOKEN + IMAGE_TOKENS * len(request.images_jpeg)


def finish_of(value: Any, words: Mapping[str, str | None]) -> str | None:
    """Return why an answer ends, by the format's `words` for it; a word that it has not as the vendor has it."""
    if not isinstance(value, str):
        return None
    return words.get(value, value[:MAX_FINISH_CHARS])


def table_of(value: Any) -> dict[str, Any]:
    """Return a table; an empty one in the place of anything else."""
    return value if isinstance(value, dict) else {}


def text_of(value: Any) -> str:
    """Return a text. Raises TypeError for anything else."""
    if not isinstance(value, str):
        raise TypeError
    return value


def list_of(value: Any) -> list[Any]:
    """Return a list. Raises TypeError for anything else."""
    if not isinstance(value, list):
        raise TypeError
    return value


def count(*values: Any) -> int | None:
    """Return the sum of those that are numbers of tokens, 0 … TOKENS_MAX; None where none is."""
    counts = [value for value in values if type(value) is int and 0 <= value <= TOKENS_MAX]
    return sum(counts) if counts else None
