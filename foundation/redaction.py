"""Keeps keys and passwords out of sentences and files.

Nobody can know which part of an address is a key. So only what is none is shown of it: scheme, host, port, short words
of the path, the names of the query. The rest is looked for in whatever comes back from there, in any spelling.
"""

import base64
import html
import re
from collections.abc import Mapping
from urllib.parse import unquote, unquote_plus

HIDDEN = "***"
MAX_URL_CHARS = 2000  # a longer one is not worth reading
MIN_CHARS = 5  # shorter texts are no keys, and hiding them would garble words and numbers
SPOKEN = frozenset(("action", "angle_deg", "depth_m", "finished", "point", "rotate", "think"))  # a pilot's own words
_WEB = ("http", "https", "ws", "wss", "rtsp", "rtsps", "")
_URL = re.compile(r"[A-Za-z][A-Za-z0-9+.-]{0,15}://[^\s'\"<>]*[^\s'\"<>.,:;!)\]}]")
_PARTS = re.compile(
    r"(?:(?P<scheme>[A-Za-z][A-Za-z0-9+.-]*)://)?(?:(?P<user>[^/?#]*)@)?(?P<host>\[[^/?#\]@]*\]|[^/?#:@\[\]]*)(?P<port>:\d*)?"
    r"(?P<path>/[^?#]*)?(?:\?(?P<query>[^#]*))?(?:#(?P<fragment>.*))?",
    re.DOTALL,
)
_WORD = re.compile(r"@?[A-Za-z0-9_.~-]{0,15}", re.ASCII)
_KEY = re.compile(r"key|token|secret|sig|auth|pass|code", re.IGNORECASE)
_KEY_VARIABLE = re.compile(r"(KEY|TOKEN|SECRET|PASSWORD)$", re.IGNORECASE)
_DATE = re.compile(r"\d{4}-\d\d(-\d\d)?(-preview)?")


def redacted(text: str, *secrets: str | None) -> str:
    """Return `text` with its addresses as `redacted_url` shows them and without the secrets, however they are spelt."""
    return _URL.sub(lambda match: redacted_url(match[0]), without(text, *secrets))


def without(text: str, *secrets: str | None) -> str:
    """Return `text` without the secrets, however they are spelt; its addresses stay."""
    for secret in sorted(filter(None, secrets), key=len, reverse=True):
        text = _spellings(secret).sub(HIDDEN, text)
    return text


def keyless_environment(environment: Mapping[str, str]) -> dict[str, str]:
    """Return what of an environment a program gets that asks nobody: all but what is named as a key, whoever's."""
    return {name: value for name, value in environment.items() if not _KEY_VARIABLE.search(name)}


def redacted_url(url: str) -> str:
    """Return an address as it may be shown. Of one that cannot be taken apart nothing is shown but the scheme.

    An address that is not of the web (a serial port, a UDP port) keeps all but its user.
    """
    parts = _PARTS.fullmatch(url) if len(url) <= MAX_URL_CHARS else None
    if parts is None:
        scheme, separator, _ = url.partition("://")
        return f"{scheme}://{HIDDEN}" if separator and scheme.isalnum() else HIDDEN
    scheme, user, host, port, path, query, fragment = (parts[name] or "" for name in _PARTS.groupindex)
    shown = (f"{scheme}://" if scheme else "") + (f"{HIDDEN}@" if user else "") + host + port
    if scheme.lower() not in _WEB:
        return shown + url[parts.end("port") if port else parts.end("host") :]
    shown += "/".join(piece if _plain(piece) else HIDDEN for piece in path.split("/"))
    if query:
        shown += "?" + "&".join(_named(pair) for pair in query.split("&"))
    return shown + (f"#{HIDDEN}" if fragment else "")


def keyless(url: str) -> str:
    """Return an address without its user and without the values in its query that are named as keys.

    It is for a digest: a piece of its path may still be a secret. One that cannot be taken apart is returned whole.
    """
    parts = _PARTS.fullmatch(url) if len(url) <= MAX_URL_CHARS else None
    if parts is None:
        return url
    scheme, host, port, path, query = (parts[name] or "" for name in ("scheme", "host", "port", "path", "query"))
    kept = [pair for pair in query.split("&") if pair and not _KEY.search(pair.partition("=")[0])]
    return f"{scheme}://{host}{port}{path}?{'&'.join(kept)}"


def secrets_of(url: str) -> tuple[str, ...]:
    """Return what may be a key in an address: what `redacted_url` does not show of it, as it stands and decoded."""
    parts = _PARTS.fullmatch(url)
    if parts is None:
        return worth_hiding(url)
    user, path, query, fragment = (parts[name] or "" for name in ("user", "path", "query", "fragment"))
    name, _, password = user.partition(":")
    basic = base64.b64encode(unquote(user).encode()).decode() if user else ""
    pieces = [piece for piece in path.split("/") if not _plain(piece)]
    values = [pair.partition("=")[2] or pair for pair in query.split("&")]
    found = (user, name, password, basic, *pieces, *values, fragment)
    return worth_hiding(*found, *map(unquote, found), *map(unquote_plus, values))


def worth_hiding(*texts: str | None) -> tuple[str, ...]:
    """Return those of the texts, each once, that may be hidden wherever they occur: no scraps, no words of a pilot."""
    return tuple(dict.fromkeys(text for text in texts if text and len(text) >= MIN_CHARS and text not in SPOKEN))


def _plain(piece: str) -> bool:
    """Return whether a piece of a path is a short word or a date, and so no key."""
    if _DATE.fullmatch(piece):
        return True
    few = sum(map(str.isdigit, piece)) <= 3 and sum(map(str.isupper, piece)) <= 2
    return few and _WORD.fullmatch(piece) is not None


def _named(pair: str) -> str:
    name, equals, value = pair.partition("=")
    if not equals:
        return HIDDEN if name else ""
    return f"{name if _plain(name) else HIDDEN}={HIDDEN if value else ''}"


def _spellings(secret: str) -> re.Pattern[str]:
    """Return what matches a text letter by letter: as it is, percent-encoded (even twice), escaped for JSON or HTML."""
    return re.compile("".join(map(_letter, secret)))


def _letter(letter: str) -> str:
    code, pair = ord(letter), letter.encode("utf-16-be", "surrogatepass")
    ways = [  # the longer ones first
        "".join(f"%(?:25){{0,4}}(?i:{byte:02x})" for byte in letter.encode("utf-8", "surrogatepass")),
        "".join(rf"\\{{1,4}}u(?i:{pair[i : i + 2].hex()})" for i in range(0, len(pair), 2)),
        rf"&#(?:0{{0,4}}{code}|[xX]0{{0,4}}(?i:{code:x}));",
        *([re.escape(html.escape(letter))] if html.escape(letter) != letter else []),
        *([r"\+"] if letter == " " else []),
        r"\\{0,4}" + re.escape(letter),
    ]
    return "(?:" + "|".join(ways) + ")"
