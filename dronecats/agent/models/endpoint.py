"""An HTTP endpoint that may be slow, busy, broken or hostile: an answer or a ModelError, and within a stated time."""

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
from email.utils import parsedate_to_datetime
from ipaddress import ip_address
from typing import Any, TypeVar

import httpx

from dronecats.agent.model_call import DaemonExecutor
from dronecats.agent.models.turns import Limiter, Unlimited, allowances
from foundation.errors import ModelError, ModelRejectedError, UsageError
from foundation.redaction import redacted, redacted_url, secrets_of, without, worth_hiding
from foundation.threads import COMPUTING
from foundation.wording import printable

BUSY, DOWN, REFUSED = 429, 503, 400  # what a word for an error comes to
_WORDS = (
    (BUSY, re.compile(r"rate.?limit|too.?many|resource.?exhausted", re.IGNORECASE)),
    (
        DOWN,
        re.compile(r"overloaded|unavailable|time.?d?.?out|server.?error|internal|api.?error|gateway", re.IGNORECASE),
    ),
)
_EXHAUSTED = re.compile(
    rb"insufficient.{0,3}(quota|balance|credits?|funds)|credit balance is too low|billing_(hard_limit|not_active)"
    rb"|per.?day",
    re.IGNORECASE,
)
_DELAY = re.compile(r"(\d{1,6}(?:\.\d{1,9})?)s")  # google.rpc.RetryInfo


@dataclass(frozen=True, slots=True)
class BodyFault:
    """Why a body is no answer."""

    status: int  # of HTTP: the vendor's own, or what its word comes to
    cut: bool = False  # it ends in the middle of its JSON


def fault_in(body: bytes) -> BodyFault | None:
    """Return what the body of a 200 says went wrong; None for one that says nothing of the kind.

    An error may stand at the top, as Gemini, Anthropic and OpenRouter have it, or in the first choice, where OpenRouter
    puts what befell a model in the middle of its reply.
    """
    try:
        data = json.loads(body)
    except ValueError:
        return BodyFault(DOWN, cut=True) if body.lstrip()[:1] == b"{" else None
    except RecursionError:
        return None
    for error in _errors(data):
        return BodyFault(_status(error))
    return None


def delay_in(body: bytes) -> float | None:
    """Return the seconds that Gemini asks for in the details of a refusal; None where it asks for none."""
    try:
        details = json.loads(body)["error"]["details"]
        delays = [_DELAY.fullmatch(each["retryDelay"]) for each in details if "retryDelay" in each]
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None
    return max((float(delay[1]) for delay in delays if delay), default=None)


def is_exhausted(body: bytes) -> bool:
    """Return whether a refusal says that there is no credit left, or that a day's allowance is used up."""
    return _EXHAUSTED.search(body) is not None


def _errors(data: Any) -> Iterator[Any]:
    """Yield the errors that stand in an answer."""
    if not isinstance(data, dict):
        return
    choices = data.get("choices")
    first = choices[0] if isinstance(choices, list) and choices else None
    for place in (data, first):
        if isinstance(place, dict) and place.get("error"):
            yield place["error"]


def _status(error: Any) -> int:
    told = [error.get(name) for name in ("code", "status", "type")] if isinstance(error, dict) else [error]
    for each in told:
        digits = str(each) if isinstance(each, int | str) and not isinstance(each, bool) else ""
        if re.fullmatch(r"[45]\d\d", digits):
            return int(digits)
    said = " ".join(each for each in told if isinstance(each, str))
    return next((status for status, word in _WORDS if word.search(said)), REFUSED)


GIVE_UP_S = 300.0  # wall s for a question with all its attempts and pauses: an episode is no longer than that
CONNECT_S = 10.0  # … of which to be connected, each time
MAX_BODY_BYTES = 4 * 2**20  # of an answer, decompressed; one of 8192 tokens has some 40 kB
MAX_SAID_CHARS = 100_000  # of a refusal, of which a sentence is shown
MAX_PAUSE_S = 60.0  # whatever Retry-After asks for
AGAIN = (408, 425, 429)  # and 5xx: answers that ask to be tried again
UNAUTHORIZED, UNPAID, FORBIDDEN, NOT_FOUND = 401, 402, 403, 404  # every other question gets the same answer
_VERSION = re.compile(r"/v\d")  # in the path of an address
HEADERS = {"Accept-Encoding": "identity", "Content-Type": "application/json"}
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class RetryPolicy:
    """How long and how often an endpoint is asked."""

    give_up_s: float = GIVE_UP_S  # wall s
    attempts: int = 3
    pause_s: float = 2.0  # wall s before the second attempt when the endpoint names no time, and double that each time


DEFAULT = RetryPolicy()


@dataclass(frozen=True, slots=True)
class KeyHeader:
    """Which header carries the key, and what stands before it there."""

    name: str
    before: str = ""


BEARER = KeyHeader("Authorization", "Bearer ")


@dataclass(frozen=True, slots=True)
class Answer:
    """What came back with status 200."""

    body: bytes  # decompressed
    latency_s: float  # wall s, of the attempt that was answered
    waited_s: float  # wall s before it: for a turn, and with attempts that failed


@dataclass(frozen=True, slots=True)
class Exchanged:
    """What one request came to."""

    status: int  # of HTTP; of an error in a 200 its own
    body: bytes  # decompressed
    wish_s: float | None  # s to wait that the answer asks for
    outcome: str = "answered {}"  # in words, {} for the status

    @property
    def rejects(self) -> bool:
        """Whether every other question would be answered the same: the key, the model, the path or the credit."""
        if self.status in (UNAUTHORIZED, UNPAID, FORBIDDEN, NOT_FOUND):
            return True
        return 400 <= self.status < 500 and is_exhausted(self.body)


@functools.cache
def _trusted() -> ssl.SSLContext:
    """Return whom all endpoints of this process believe: to read it takes 20 ms, and every flight has an endpoint."""
    return httpx.create_ssl_context()


class Endpoint:
    """A base URL with its key. What it says of itself, and what it lets through of what came back, holds no secret."""

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
        """Connect nothing yet; `key_variable` holds the key, for a sentence about a wrong one.

        Raises UsageError for what is no URL, and for a key that cannot be sent."""
        self.shown = redacted_url(base_url)
        self._key_hint = f"{'check' if key else 'set'} the key in {key_variable}" if key_variable else ""
        self.patience = patience
        self._limiter = limiter or Unlimited()
        self._secrets = worth_hiding(key, *secrets, *secrets_of(base_url))
        if key and not (key.isascii() and key.isprintable()):
            raise UsageError(f"the API key for {self.shown} holds a character that cannot be sent; is it copied whole?")
        signed = {key_header.name: key_header.before + key} if key else {}
        try:
            self._base = httpx.URL(base_url)
            # a proxy of the environment leads to other machines: it cannot reach what this one serves to itself
            proxied = not _is_loopback(self._base.host)
            self._http = httpx.Client(headers={**headers, **signed}, verify=_trusted(), trust_env=proxied)
        except (httpx.InvalidURL, ValueError):
            raise UsageError(f"--base-url '{self.shown}' is not a URL such as http://HOST:PORT/v1") from None
        if self._base.scheme not in ("http", "https") or not self._base.host:
            self._http.close()
            raise UsageError(f"--base-url '{self.shown}' must start with http:// or https://, and name a host")

    def close(self) -> None:
        self._http.close()

    def url(self, path: str) -> httpx.URL:
        """Return the address of `path` (no slash before it) below the base, whose query stays behind it."""
        base, mark, query = self._base.raw_path.partition(b"?")
        return self._base.copy_with(raw_path=base.rstrip(b"/") + b"/" + path.encode() + mark + query, fragment=None)

    def hide(self, text: str) -> str:
        """Return what came back without the secrets, and otherwise as it came."""
        return without(text, *self._secrets)

    def brief(self, text: str | bytes) -> str:
        """Return the beginning of what came back, on one line, as it may be shown."""
        said = text.decode("utf-8", "replace") if isinstance(text, bytes) else text
        line = redacted(" ".join(said[:MAX_SAID_CHARS].split()), *self._secrets)
        return printable(line)[:200] or "(empty)"

    def check(self) -> None:
        """Raise UsageError when nothing answers there; what it answers does not matter here."""

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
        """Return the body of an answer of status 200. Raises ModelError for any other, in one sentence."""

        def fetch(until: float) -> bytes:
            with self._http.stream("GET", self.url(path), timeout=CONNECT_S, follow_redirects=False) as response:
                body = self._body(response, until)
                if response.status_code != 200:
                    said = self._rejection(Exchanged(response.status_code, body, None), path, "GET")
                    raise ModelError(f"the model endpoint {self.shown} {said}")
                return body

        try:
            return self._within(CONNECT_S, fetch)
        except (httpx.HTTPError, httpx.InvalidURL, httpx.StreamError) as error:
            raise ModelError(f"the model endpoint {self.shown} cannot be reached: {self._reason(error)}") from None

    def post(self, path: str, content: bytes, tokens: int = 0) -> Answer:
        """Return the answer of status 200 that holds no error, after as many attempts as patience allows.

        `tokens`: about as many as it asks about, for the limiter. Raises ModelError, and of these ModelRejectedError at
        once where every other question would be answered the same.
        """
        return self._within(self.patience.give_up_s, lambda until: self._attempts(path, content, tokens, until))

    def _within(self, seconds: float, call: Callable[[float], T]) -> T:
        """Return what `call` returns, which is told until when it may take. Raises ModelError when that is over.

        On a thread of its own, since neither the look-up of a name nor a header that trickles in can be timed.
        """
        coming: Future[T] = DaemonExecutor().submit(call, time.monotonic() + seconds)
        try:
            with COMPUTING.lent():
                return coming.result(seconds)
        except NotInTimeError:
            raise self._silent(seconds) from None

    def _silent(self, seconds: float) -> ModelError:
        return ModelError(f"the model endpoint {self.shown} has not answered for {seconds:g} s")

    def _attempts(self, path: str, content: bytes, tokens: int, until: float) -> Answer:
        url, asked = self.url(path), time.monotonic()
        for attempt in range(1, self.patience.attempts + 1):
            pause_s = self.patience.pause_s * 2.0 ** (attempt - 1)
            self._await_turn(tokens, until)
            began = time.monotonic()
            try:
                came = self._exchange(url, content, until)
            except (httpx.ReadTimeout, httpx.WriteTimeout):  # there was all the time that is left
                raise self._silent(self.patience.give_up_s) from None
            except (httpx.HTTPError, httpx.InvalidURL, httpx.StreamError) as error:
                said, again = f"broke off: {self._reason(error)}", isinstance(error, httpx.TransportError)
            else:
                if came.status == 200:
                    return Answer(came.body, round(time.monotonic() - began, 6), round(began - asked, 6))
                if came.rejects:
                    said = self._rejection(came, path)
                    raise ModelRejectedError(f"the model endpoint {self.shown} {said}", came.status)
                said, again = self._refusal(came), came.status in AGAIN or came.status >= 500
                pause_s = pause_s if came.wish_s is None else came.wish_s
                if came.status == BUSY:
                    self._limiter.hold(pause_s)
            if not again or attempt == self.patience.attempts or time.monotonic() + pause_s >= until:
                break
            time.sleep(pause_s)
        raise ModelError(f"the model endpoint {self.shown} {said}")

    def _await_turn(self, tokens: int, until: float) -> None:
        """Return when the limiter lets this one ask. Raises ModelError when that would be too late."""
        while (wait_s := self._limiter.claim(tokens)) > 0.0:
            if time.monotonic() + wait_s >= until:
                raise ModelError(f"the model endpoint {self.shown} is held back by its rate limit for too long")
            time.sleep(wait_s)

    def _exchange(self, url: httpx.URL, content: bytes, until: float) -> Exchanged:
        """Return what one request came to; what its headers allow is told to the limiter."""
        left_s = max(until - time.monotonic(), 0.001)
        timeout = httpx.Timeout(left_s, connect=min(CONNECT_S, left_s))
        # a redirect is never followed: it would carry the key to wherever it points
        with self._http.stream("POST", url, content=content, timeout=timeout, follow_redirects=False) as response:
            if allowed := allowances(response.headers):
                self._limiter.heard(allowed)
            status, body = response.status_code, self._body(response, until)
            wish_s = pause_asked_for(response.headers)
        if wish_s is None and (delay_s := delay_in(body)) is not None:
            wish_s = min(delay_s, MAX_PAUSE_S)
        fault = fault_in(body) if status == 200 else None
        if fault is None:
            return Exchanged(status, body, wish_s)
        outcome = "broke off within its answer" if fault.cut else "answered 200 with an error {}"
        return Exchanged(fault.status, body, wish_s, outcome)

    def _body(self, response: httpx.Response, until: float) -> bytes:
        """Return the body, decompressed. Raises ModelError for one that trickles past the time, or is too long."""
        encoding = response.headers.get("content-encoding", "identity").lower()
        if encoding not in ("identity", "gzip", "deflate"):
            raise ModelError(f"the model endpoint {self.shown} answers compressed, which it was asked not to")
        inflate = None if encoding == "identity" else zlib.decompressobj(zlib.MAX_WBITS | 32)
        body = bytearray()
        for piece in response.iter_raw():
            if time.monotonic() >= until:
                raise self._silent(self.patience.give_up_s)
            try:
                body += inflate.decompress(piece, MAX_BODY_BYTES + 1 - len(body)) if inflate else piece
            except zlib.error:
                raise ModelError(f"the model endpoint {self.shown} answers what cannot be decompressed") from None
            if len(body) > MAX_BODY_BYTES:
                raise ModelError(f"the model endpoint {self.shown} answers more than {MAX_BODY_BYTES:,} bytes")
        return bytes(body)

    def _refusal(self, came: Exchanged) -> str:
        outcome = came.outcome.format(came.status)
        if 300 <= came.status < 400:
            return f"{outcome}, a redirect: none is followed, so that no key goes there; give the final address"
        return f"{outcome}: {self.brief(came.body)}"

    def _rejection(self, came: Exchanged, path: str, method: str = "POST") -> str:
        """Return the sentence about a rejection: the address that was asked, the answer, and what to do."""
        base, mark, query = self.shown.partition("?")
        asked = f"{method} {base.rstrip('/')}/{path}{mark}{query}"
        sentence = f"{came.outcome.format(came.status)} to {asked}: {self.brief(came.body)}"
        if came.status == NOT_FOUND and not _VERSION.search(self._base.path):
            return f"{sentence}; its address lacks /v1: try --base-url {base.rstrip('/')}/v1{mark}{query}"
        if came.status in (UNAUTHORIZED, FORBIDDEN) and self._key_hint:
            return f"{sentence}; {self._key_hint}"
        return sentence

    def _reason(self, error: Exception) -> str:
        return self.brief(str(error)) if str(error) else type(error).__name__


def _is_loopback(host: str) -> bool:
    """Return whether a host of a URL is this machine by its loopback name or addresses."""
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return host.lower().rstrip(".") == "localhost" or host.lower().rstrip(".").endswith(".localhost")


def pause_asked_for(headers: httpx.Headers, now: datetime | None = None) -> float | None:
    """Return the seconds that Retry-After asks for, given as seconds or as a date, bounded; None where it says none."""
    value = headers.get("retry-after")
    if value is None:
        return None
    try:
        seconds = float(value)
    except ValueError:
        try:
            moment = parsedate_to_datetime(value)
        except (ValueError, OverflowError):
            return None
        moment = moment if moment.tzinfo else moment.replace(tzinfo=UTC)
        seconds = (moment - (now or datetime.now(UTC))).total_seconds()
    return min(max(seconds, 0.0), MAX_PAUSE_S) if seconds == seconds else None
