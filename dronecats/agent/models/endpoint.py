"""Sends requests to an HTTP endpoint that may be slow, busy, broken or hostile.

The result is an answer or a ModelError, within a time limit.
"""

import functools
import json
import re
import ssl
import time
import zlib
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future
from concurrent.futures import TimeoutError as NotInTimeError
from dataclasses import dataclass
from datetime import UTC, datetime
from ipaddress import ip_address
from typing import Any, TypeVar

import httpx

from dronecats.agent.models.rate_limits import Limiter, allowances, http_date
from foundation.errors import ModelError, ModelRejectedError, UsageError
from foundation.machine import is_host
from foundation.redaction import hide_secrets, redacted, redacted_url, secrets_of, worth_hiding
from foundation.threads import COMPUTING, DaemonExecutor
from foundation.wording import printable

BUSY, DOWN, BAD_REQUEST = 429, 503, 400
BROKEN_OFF = "stopped in the middle of its reply"
_WORDS = (
    (BUSY, re.compile(r"rate.?limit|too.?many|resource.?exhausted", re.IGNORECASE)),
    (
        DOWN,
        re.compile(r"overloaded|unavailable|time.?d?.?out|server.?error|internal|api.?error|gateway", re.IGNORECASE),
    ),
)
_EXHAUSTED = re.compile(  # the credit or the daily quota is used up
    rb"insufficient.{0,3}(quota|balance|credits?|funds)|credit balance is too low|billing_(hard_limit|not_active)"
    rb"|per.?day",
    re.IGNORECASE,
)
_DELAY = re.compile(r"(\d{1,6}(?:\.\d{1,9})?)s")  # retryDelay of google.rpc.RetryInfo


def fault_in(body: bytes) -> tuple[int, str] | None:
    """Return the error in the body of an answer with status 200; None if there is none.

    The result is the HTTP status (the vendor's, or derived from its words) and the text for `Exchanged.outcome`.

    The error may be at the top level (Gemini, Anthropic, OpenRouter) or in the first choice (OpenRouter, for an error
    in the middle of a reply).
    """
    try:
        data = json.loads(body)
    except ValueError:
        return (DOWN, BROKEN_OFF) if body.lstrip()[:1] == b"{" else None
    except RecursionError:
        return None
    for error in _errors(data):
        return _status(error), "answered 200 with an error {}"
    return None


def delay_in(body: bytes) -> float | None:
    """Return the retry delay (s) in the details of a Gemini error; None if it has none."""
    try:
        details = json.loads(body)["error"]["details"]
        delays = [_DELAY.fullmatch(detail["retryDelay"]) for detail in details if "retryDelay" in detail]
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None
    return max((float(delay[1]) for delay in delays if delay), default=None)


def _errors(data: Any) -> Iterator[Any]:
    if not isinstance(data, dict):
        return
    choices = data.get("choices")
    first = choices[0] if isinstance(choices, list) and choices else None
    for place in (data, first):
        if isinstance(place, dict) and place.get("error"):
            yield place["error"]


def _status(error: Any) -> int:
    words = [error.get(name) for name in ("code", "status", "type")] if isinstance(error, dict) else [error]
    for word in words:
        digits = str(word) if isinstance(word, int | str) and not isinstance(word, bool) else ""
        if re.fullmatch(r"[45]\d\d", digits):
            return int(digits)
    text = " ".join(word for word in words if isinstance(word, str))
    return next((status for status, word in _WORDS if word.search(text)), BAD_REQUEST)


GIVE_UP_S = 300.0  # wall s for a question with all its attempts and pauses: the length of an episode
CONNECT_S = 10.0  # wall s for each connection, included in GIVE_UP_S
MAX_BODY_BYTES = 4 * 2**20  # longest body of an answer, decompressed; an answer of 8192 tokens has about 40 kB
MAX_READ_CHARS = 100_000  # `brief` reads this many characters of an answer, and shows 200
MAX_PAUSE_S = 60.0  # s, longest pause that an answer may ask for
AGAIN = (408, 425, 429)  # statuses after which a question is sent again, besides 5xx
UNAUTHORIZED, UNPAID, FORBIDDEN, NOT_FOUND = 401, 402, 403, 404  # statuses of errors that every question would get
_VERSION = re.compile(r"/v\d")  # version in the path of an address
HEADERS = {"Accept-Encoding": "identity", "Content-Type": "application/json"}
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class RetryPolicy:
    """The time and the number of attempts for a question."""

    give_up_s: float = GIVE_UP_S  # wall s
    attempts: int = 3
    pause_s: float = 2.0  # wall s before attempt 2; doubles with each attempt. The endpoint may ask for a longer pause


DEFAULT = RetryPolicy()


@dataclass(frozen=True, slots=True)
class KeyHeader:
    """The header that carries the key."""

    name: str
    before: str = ""  # text before the key


BEARER = KeyHeader("Authorization", "Bearer ")


@dataclass(frozen=True, slots=True)
class Answer:
    """The body of an answer: a reply with status 200, or a refusal by the provider's filter."""

    body: bytes  # decompressed
    latency_s: float  # wall s, of the successful attempt
    waited_s: float  # wall s before the successful attempt: waits for the rate limit, and failed attempts
    filtered: bool = False  # the provider refuses this question because of its content; the body has no reply


@dataclass(frozen=True, slots=True)
class Exchanged:
    """The result of one request."""

    status: int  # HTTP status; for an error inside a 200 answer, the status of that error
    body: bytes  # decompressed
    wish_s: float | None  # s that the answer asks to wait before the next attempt
    outcome: str = "answered {}"  # in words; {} stands for the status

    @property
    def filtered(self) -> bool:
        """True if the provider's moderation refuses this question. Source: OpenRouter's documentation, "Errors"."""
        if self.status != FORBIDDEN:
            return False
        try:
            errors = [error for error in _errors(json.loads(self.body)) if isinstance(error, dict)]
        except (ValueError, RecursionError):
            return False
        details = [error.get("metadata") for error in errors]
        return any(isinstance(detail, dict) and {"reasons", "flagged_input"} & detail.keys() for detail in details)

    @property
    def rejects(self) -> bool:
        """True if every question would get the same error: a wrong key, model or path, or no credit."""
        if self.status in (UNAUTHORIZED, UNPAID, FORBIDDEN, NOT_FOUND):
            return True
        return 400 <= self.status < 500 and _EXHAUSTED.search(self.body) is not None


@functools.cache
def _trusted() -> ssl.SSLContext:
    """Return the trusted certificates, shared by all endpoints of the process: loading them takes 20 ms."""
    return httpx.create_ssl_context()


class Endpoint:
    """A base URL with its key. Errors, `shown` and `brief` contain no secrets. `hide` removes those of a body."""

    def __init__(
        self,
        base_url: str,
        key: str | None,
        secrets: tuple[str, ...],
        patience: RetryPolicy,
        key_header: KeyHeader = BEARER,
        headers: Mapping[str, str] = HEADERS,
        limiter: Limiter | None = None,
        key_variable: str | None = None,
    ) -> None:
        """Open no connection yet. `key_variable` is the key's environment variable, for error messages.

        Raises UsageError for an invalid URL, and for a key that cannot be sent.
        """
        self.shown = redacted_url(base_url)
        self._key_hint = f"{'Check' if key else 'Set'} the key in {key_variable}" if key_variable else ""
        self.patience = patience
        self._limiter = limiter  # None: no limit
        self._secrets = worth_hiding(key, *secrets, *secrets_of(base_url))
        if key and not (key.isascii() and key.isprintable()):
            raise UsageError(f"the API key for {self.shown} has a character that cannot be sent. Copy it again")
        signed = {key_header.name: key_header.before + key} if key else {}
        try:
            self._base = httpx.URL(base_url)
            # a proxy (set by HTTP_PROXY, for example) cannot reach this machine's loopback address
            proxied = not _is_loopback(self._base.host)
            self._http = httpx.Client(headers={**headers, **signed}, verify=_trusted(), trust_env=proxied)
        except (httpx.InvalidURL, ValueError):
            raise UsageError(f"--base-url '{self.shown}' is not a URL such as http://HOST:PORT/v1") from None
        if self._base.scheme not in ("http", "https") or not is_host(self._base.host):
            self._http.close()
            raise UsageError(f"--base-url '{self.shown}' must be an address with a host, such as http://HOST:PORT/v1")

    def close(self) -> None:
        self._http.close()

    def url(self, path: str) -> httpx.URL:
        """Return the base URL with `path` (without a first slash) appended, and the queries of both."""
        base, _, base_query = self._base.raw_path.partition(b"?")
        place, _, query = path.encode().partition(b"?")
        queries = b"&".join(filter(None, (query, base_query)))
        raw_path = base.rstrip(b"/") + b"/" + place + (b"?" + queries if queries else b"")
        return self._base.copy_with(raw_path=raw_path, fragment=None)

    def hide(self, text: str) -> str:
        """Return text of an answer without the secrets."""
        return hide_secrets(text, *self._secrets)

    def brief(self, text: str | bytes) -> str:
        """Return the beginning of an answer on one line, redacted."""
        content = text.decode("utf-8", "replace") if isinstance(text, bytes) else text
        line = redacted(" ".join(content[:MAX_READ_CHARS].split()), *self._secrets)
        return printable(line)[:200] or "(empty)"

    def check(self) -> None:
        """Raise UsageError if nothing answers at the address. Any answer is enough."""

        def look(until: float) -> None:
            with self._http.stream("GET", self.url("models"), timeout=CONNECT_S):
                pass

        try:
            self._within(CONNECT_S, look)
        except ModelError:
            raise UsageError(f"the model endpoint {self.shown} has not answered for {CONNECT_S:g} s") from None
        except (httpx.HTTPError, httpx.InvalidURL) as error:
            raise UsageError(f"the model endpoint {self.shown} cannot be reached: {self._reason(error)}") from None

    def get(self, path: str) -> bytes:
        """Return the body of an answer of status 200. Raises ModelError for any other status."""

        def fetch(until: float) -> bytes:
            with self._http.stream("GET", self.url(path), timeout=CONNECT_S, follow_redirects=False) as response:
                body = self._body(response, until)
                if response.status_code != 200:
                    reason = self._rejection(Exchanged(response.status_code, body, None), path, "GET")
                    raise ModelError(f"the model endpoint {self.shown} {reason}")
                return body

        try:
            return self._within(CONNECT_S, fetch)
        except (httpx.HTTPError, httpx.InvalidURL, httpx.StreamError) as error:
            raise ModelError(f"the model endpoint {self.shown} cannot be reached: {self._reason(error)}") from None

    def post(self, path: str, content: bytes, tokens: int, failed: list[bytes]) -> Answer:
        """Send a question until an attempt gives an `Answer`, and return it. `patience` limits the attempts.

        `tokens`: an estimate for the limiter. `failed` receives the bodies of failed answers. Raises ModelError. For an
        error that every question would get, raises the subclass ModelRejectedError without more attempts.
        """
        return self._within(self.patience.give_up_s, lambda until: self._attempts(path, content, tokens, failed, until))

    def _within(self, seconds: float, call: Callable[[float], T]) -> T:
        """Return the result of `call`, which gets the deadline. Raises ModelError when the deadline has passed.

        The call runs on its own thread, because name resolution and slow headers have no timeout.
        """
        coming: Future[T] = DaemonExecutor().submit(call, time.monotonic() + seconds)
        try:
            with COMPUTING.lent():
                return coming.result(seconds)
        except NotInTimeError:
            raise self._silent(seconds) from None

    def _silent(self, seconds: float) -> ModelError:
        return ModelError(f"the model endpoint {self.shown} has not answered for {seconds:g} s")

    def _attempts(self, path: str, content: bytes, tokens: int, failed: list[bytes], until: float) -> Answer:
        url, first = self.url(path), time.monotonic()
        for attempt in range(1, self.patience.attempts + 1):
            pause_s = self.patience.pause_s * 2.0 ** (attempt - 1)
            self._await_limits(tokens, until)
            began = time.monotonic()
            try:
                came = self._exchange(url, content, until)
            except (httpx.ReadTimeout, httpx.WriteTimeout):  # no time is left for another attempt
                raise self._silent(self.patience.give_up_s) from None
            except (httpx.HTTPError, httpx.InvalidURL, httpx.StreamError) as error:
                is_down = isinstance(error, httpx.ConnectError | httpx.ConnectTimeout | httpx.ProxyError)
                what = "cannot be reached" if is_down else BROKEN_OFF
                reason, again = f"{what}: {self._reason(error)}", isinstance(error, httpx.TransportError)
            else:
                if came.status == 200 or came.filtered:
                    latency_s, waited_s = round(time.monotonic() - began, 6), round(began - first, 6)
                    return Answer(came.body, latency_s, waited_s, came.filtered)
                failed.append(came.body)
                if came.rejects:
                    reason = self._rejection(came, path)
                    raise ModelRejectedError(f"the model endpoint {self.shown} {reason}", came.status)
                reason, again = self._refusal(came), came.status in AGAIN or came.status >= 500
                pause_s = max(pause_s, came.wish_s or 0.0)  # a wish of 0 would end all attempts during an overload
                if self._limiter and came.status == BUSY:
                    self._limiter.hold(pause_s)
            if not again or attempt == self.patience.attempts or time.monotonic() + pause_s >= until:
                break
            time.sleep(pause_s)
        raise ModelError(f"the model endpoint {self.shown} {reason}")

    def _await_limits(self, tokens: int, until: float) -> None:
        """Wait for the limiter. Raises ModelError if that would take too long."""
        while self._limiter and (wait_s := self._limiter.claim(tokens)) > 0.0:
            if time.monotonic() + wait_s >= until:
                raise ModelError(
                    f"the model endpoint {self.shown} is at its rate limit, and the wait would take too long. Try"
                    " later, or use fewer --jobs"
                )
            time.sleep(wait_s)

    def _exchange(self, url: httpx.URL, content: bytes, until: float) -> Exchanged:
        """Send one request; report its rate limit headers to the limiter."""
        left_s = max(until - time.monotonic(), 0.001)
        timeout = httpx.Timeout(left_s, connect=min(CONNECT_S, left_s))
        # redirects are not followed, because they would send the key to another address
        with self._http.stream("POST", url, content=content, timeout=timeout, follow_redirects=False) as response:
            if self._limiter and (allowed := allowances(response.headers)):
                self._limiter.update(allowed)
            status, body = response.status_code, self._body(response, until)
            wish_s = retry_after_s(response.headers)
        if wish_s is None and (delay_s := delay_in(body)) is not None:
            wish_s = min(delay_s, MAX_PAUSE_S)
        if status == 200 and (fault := fault_in(body)):
            status, outcome = fault
            return Exchanged(status, body, wish_s, outcome)
        return Exchanged(status, body, wish_s)

    def _body(self, response: httpx.Response, until: float) -> bytes:
        """Return the body, decompressed. Raises ModelError if it is too slow or too long."""
        encoding = response.headers.get("content-encoding", "identity").lower()
        if encoding not in ("identity", "gzip", "deflate"):
            raise ModelError(
                f"the model endpoint {self.shown} sends compressed replies, although the request forbids it"
            )
        inflate = None if encoding == "identity" else zlib.decompressobj(zlib.MAX_WBITS | 32)
        body = bytearray()
        for piece in response.iter_raw():
            if time.monotonic() >= until:
                raise self._silent(self.patience.give_up_s)
            try:
                body += inflate.decompress(piece, MAX_BODY_BYTES + 1 - len(body)) if inflate else piece
            except zlib.error:
                raise ModelError(f"the model endpoint {self.shown} sends a reply that cannot be decompressed") from None
            if len(body) > MAX_BODY_BYTES:
                raise ModelError(f"the model endpoint {self.shown} sends a reply of more than {MAX_BODY_BYTES:,} bytes")
        return bytes(body)

    def _refusal(self, came: Exchanged) -> str:
        outcome = came.outcome.format(came.status)
        if 300 <= came.status < 400:
            return (
                f"{outcome}, a redirect. Redirects are not followed, because the key would go along. Give"
                " the final address"
            )
        return f"{outcome}: {self.brief(came.body)}"

    def _rejection(self, came: Exchanged, path: str, method: str = "POST") -> str:
        """Return the error message of a rejection: the address, the answer, and what to do."""
        base, mark, query = self.shown.partition("?")
        target = f"{method} {base.rstrip('/')}/{path}{mark}{query}"
        sentence = f"{came.outcome.format(came.status)} to {target}: {self.brief(came.body)}"
        if came.status == NOT_FOUND and not _VERSION.search(self._base.path):
            return f"{sentence}; its address has no /v1. Try --base-url {base.rstrip('/')}/v1{mark}{query}"
        if came.status in (UNAUTHORIZED, FORBIDDEN) and self._key_hint:
            return f"{sentence}. {self._key_hint}"
        return sentence

    def _reason(self, error: Exception) -> str:
        return self.brief(str(error)) if str(error) else type(error).__name__


def _is_loopback(host: str) -> bool:
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return host.lower().rstrip(".") == "localhost" or host.lower().rstrip(".").endswith(".localhost")


def retry_after_s(headers: httpx.Headers, now: datetime | None = None) -> float | None:
    """Return the wait (s, at most MAX_PAUSE_S) of a valid Retry-After header (seconds or a date), else None.

    A date is relative to the answer's own Date, because this computer's clock may be wrong; else to `now` (UTC).
    """
    value = headers.get("retry-after")
    if value is None:
        return None
    try:
        seconds = float(value)
    except ValueError:
        if (moment := http_date(value)) is None:
            return None
        sent = http_date(headers.get("date")) or now or datetime.now(UTC)
        seconds = (moment - sent).total_seconds()
    return min(max(seconds, 0.0), MAX_PAUSE_S) if seconds == seconds else None
