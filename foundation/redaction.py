"""Removes keys and passwords from messages and files.

Any part of an address (URL) may be a key. So only safe parts are shown: scheme, host, port, short words of the path,
names in the query. If the server repeats the other parts in its replies, they are hidden there too, in any spelling.
"""

import base64
import html
import re
from collections.abc import Mapping
from urllib.parse import unquote, unquote_plus

from foundation.protocol import ACTION_FIELDS, ACTIONS

HIDDEN = "***"
MAX_URL_CHARS = 2000  # a longer address is not parsed
MIN_CHARS = 5  # shorter texts are not keys, and hiding them would garble words and numbers
REPLY_WORDS = frozenset((*ACTIONS, *ACTION_FIELDS))  # a model's replies contain them, so they are never hidden
_WEB = ("http", "https", "ws", "wss", "rtsp", "rtsps", "")
_URL = re.compile(r"[A-Za-z][A-Za-z0-9+.-]{0,15}://[^\s'\"<>]*[^\s'\"<>.,:;!)\]}]")
_URL_FIELDS = re.compile(
    r"(?:(?P<scheme>[A-Za-z][A-Za-z0-9+.-]*)://)?(?:(?P<user>[^/?#]*)@)?(?P<host>\[[^/?#\]@]*\]|[^/?#:@\[\]]*)(?P<port>:\d*)?"
    r"(?P<path>/[^?#]*)?(?:\?(?P<query>[^#]*))?(?:#(?P<fragment>.*))?",
    re.DOTALL,
)
_WORD = re.compile(r"@?[A-Za-z0-9_.~-]{0,15}", re.ASCII)
_KEY = re.compile(r"key|token|secret|sig|auth|pass|code", re.IGNORECASE)
_KEY_VARIABLE = re.compile(r"(KEY|TOKEN|SECRET|PASSWORD)$", re.IGNORECASE)
_DATE = re.compile(r"\d{4}-\d\d(-\d\d)?(-preview)?")


def redacted(text: str, *secrets: str | None) -> str:
    """Return `text` with redacted addresses and without the secrets in any spelling."""
    return _URL.sub(lambda match: redacted_url(match[0]), hide_secrets(text, *secrets))


def hide_secrets(text: str, *secrets: str | None) -> str:
    """Return `text` without the secrets in any spelling; its addresses stay."""
    for secret in sorted(filter(None, secrets), key=len, reverse=True):
        text = _spellings(secret).sub(HIDDEN, text)
    return text


def keyless_environment(environment: Mapping[str, str]) -> dict[str, str]:
    """Return an environment without the variables named …KEY, …TOKEN, …SECRET or …PASSWORD."""
    return {name: value for name, value in environment.items() if not _KEY_VARIABLE.search(name)}


def redacted_url(url: str) -> str:
    """Return an address for display, without possible keys. If it cannot be parsed, at most its scheme is shown.

    With other schemes than http, ws and rtsp, such as serial:// or udpin://, only user and password are hidden.
    """
    match = _URL_FIELDS.fullmatch(url) if len(url) <= MAX_URL_CHARS else None
    if match is None:
        scheme, separator, _ = url.partition("://")
        return f"{scheme}://{HIDDEN}" if separator and scheme.isalnum() else HIDDEN
    scheme, user, host, port, path, query, fragment = (match[name] or "" for name in _URL_FIELDS.groupindex)
    shown = (f"{scheme}://" if scheme else "") + (f"{HIDDEN}@" if user else "") + host + port
    if scheme.lower() not in _WEB:
        return shown + url[match.end("port") if port else match.end("host") :]
    shown += "/".join(piece if _is_safe_path_part(piece) else HIDDEN for piece in path.split("/"))
    if query:
        shown += "?" + "&".join(_redacted_query_pair(pair) for pair in query.split("&"))
    return shown + (f"#{HIDDEN}" if fragment else "")


def keyless(url: str) -> str:
    """Return an address as it goes into a digest: without user, fragment, and query fields that are named like a key.

    The path may still contain a secret. An address that cannot be parsed is returned unchanged.
    """
    match = _URL_FIELDS.fullmatch(url) if len(url) <= MAX_URL_CHARS else None
    if match is None:
        return url
    scheme, host, port, path, query = (match[name] or "" for name in ("scheme", "host", "port", "path", "query"))
    kept = [pair for pair in query.split("&") if pair and not _KEY.search(pair.partition("=")[0])]
    return f"{scheme}://{host}{port}{path}?{'&'.join(kept)}"


def secrets_of(url: str) -> tuple[str, ...]:
    """Return the parts of an address that may be keys, raw and decoded. Short texts and common words are omitted."""
    match = _URL_FIELDS.fullmatch(url)
    if match is None:
        return worth_hiding(url)
    user, path, query, fragment = (match[name] or "" for name in ("user", "path", "query", "fragment"))
    name, _, password = user.partition(":")
    basic = base64.b64encode(unquote(user).encode()).decode() if user else ""
    pieces = [piece for piece in path.split("/") if not _is_safe_path_part(piece)]
    values = [pair.partition("=")[2] or pair for pair in query.split("&")]
    candidates = (user, name, password, basic, *pieces, *values, fragment)
    return worth_hiding(*candidates, *map(unquote, candidates), *map(unquote_plus, values))


def worth_hiding(*texts: str | None) -> tuple[str, ...]:
    """Return the texts to hide everywhere, without duplicates, short texts and words of replies."""
    return tuple(dict.fromkeys(text for text in texts if text and len(text) >= MIN_CHARS and text not in REPLY_WORDS))


def _is_safe_path_part(piece: str) -> bool:
    """Return whether a piece of a path is a short word or a date, so not a key."""
    if _DATE.fullmatch(piece):
        return True
    few = sum(map(str.isdigit, piece)) <= 3 and sum(map(str.isupper, piece)) <= 2
    return few and _WORD.fullmatch(piece) is not None


def _redacted_query_pair(pair: str) -> str:
    name, equals, value = pair.partition("=")
    if not equals:
        return HIDDEN if name else ""
    return f"{name if _is_safe_path_part(name) else HIDDEN}={HIDDEN if value else ''}"


def _spellings(secret: str) -> re.Pattern[str]:
    """Return a pattern of a text that is raw, percent-encoded once or repeatedly, or escaped for JSON or HTML."""
    return re.compile("".join(map(_letter, secret)))


def _letter(letter: str) -> str:
    code, pair = ord(letter), letter.encode("utf-16-be", "surrogatepass")
    ways = [  # longer spellings first, so that no spelling is matched in part only
        "".join(f"%(?:25){{0,4}}(?i:{byte:02x})" for byte in letter.encode("utf-8", "surrogatepass")),
        "".join(rf"\\{{1,4}}u(?i:{pair[i : i + 2].hex()})" for i in range(0, len(pair), 2)),
        rf"&#(?:0{{0,4}}{code}|[xX]0{{0,4}}(?i:{code:x}));",
        *([re.escape(html.escape(letter))] if html.escape(letter) != letter else []),
        *([r"\+"] if letter == " " else []),
        r"\\{0,4}" + re.escape(letter),
    ]
    return "(?:" + "|".join(ways) + ")"
