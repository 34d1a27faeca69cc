"""Tolerant JSON reader: accepts the deviations of `mends.WRITTEN` except `escaped`, and records them.

It also reads a number with a unit (`Quantity`). It guesses nothing: text with any other deviation is not a value. The
work is bounded: each attempt reads the text once, and the search ends after too many characters without a value.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any
from unicodedata import normalize

from dronecats.agent.reply.mends import Mend
from dronecats.agent.reply.strict import MAX_REPLY_CHARS, MAX_TRIES, JsonSpan

MAX_VAIN_CHARS = MAX_REPLY_CHARS  # limit of all failed attempts together; strict.py, which is faster, has 5 × this
MAX_DEPTH = 40  # deepest nesting of brackets; the actions of a fleet have three levels
MAX_DIGITS = 60
_WORD = re.compile(r"[A-Za-z_][\w-]*")
_NUMBER = re.compile(r"[+\-\u2212\uff0b\uff0d]?(?:\d+[.\uff0e]?\d*|[.\uff0e]\d+)(?:[eE][+-]?\d+)?")
_JSON_NUMBER = re.compile(r"-?(?:0|[1-9][0-9]*)(?:\.[0-9]+)?(?:[eE][+-]?[0-9]+)?")
_UNIT = re.compile(r"[ \t]*(°|º|[A-Za-z]+)")
_SPACE = re.compile(r"[ \t\n\r]*")
_ODD_SPACES = "\u00a0\u200b\u200c\u200d\u2009\u202f\u2060\u3000\ufeff\u000b\u000c\u0085\u2028\u2029"
_ODD_SPACE = re.compile(f"[{_ODD_SPACES}]*")
_WORDS = {"true": True, "false": False, "null": None, "NaN": float("nan"), "Infinity": float("inf")}
_PYTHON = {"True": True, "False": False, "None": None}
_CLOSING = {'"': '"', "'": "'", "\u201c": "\u201d", "\u2018": "\u2019", "\u201d": "\u201d", "\u201e": "\u201c",
            "\uff02": "\uff02", "\uff07": "\uff07"}  # fmt: skip
_UNTIL = {end: re.compile(rf"[^{end}\\]*(?:\\.[^{end}\\]*)*", re.DOTALL) for end in set(_CLOSING.values())}
_ESCAPE = re.compile(r"\\(u[0-9a-fA-F]{4}|.)", re.DOTALL)
_ESCAPED = {"n": "\n", "t": "\t", "r": "\r", "b": "\b", "f": "\f"}


class Cut:
    """Placeholder for a value that the end of the reply cut off."""


CUT = Cut()


@dataclass(frozen=True, slots=True)
class Quantity:
    """An unquoted number with its unit, for example: 12 m."""

    number: float
    unit: str


@dataclass(frozen=True, slots=True)
class ReadValue(JsonSpan):
    """A value in a text: as `json` returns it, plus Quantity, and CUT for a cut-off value.

    A cut-off object has CUT under the key "".
    """

    mends: frozenset[Mend]
    inner: bool  # the value begins inside another value that is broken or cut off

    @property
    def cut(self) -> bool:
        """True when the text ends within this value."""
        return "truncated" in self.mends


class _BrokenError(Exception):
    """The text is not a value."""


@dataclass(slots=True)
class SearchBudget:
    """The work that is left for searches. Several searches may share it."""

    tries: int = MAX_TRIES
    vain_chars: int = field(default_factory=lambda: MAX_VAIN_CHARS)  # characters of failed attempts


def read_values(text: str, openings: str, budget: SearchBudget | None = None) -> list[ReadValue]:
    """Return the outermost values that begin with one of `openings`, in order, including cut-off values.

    After a broken or cut-off value, the search continues inside it. Without `budget`, the search has its own.
    """
    budget = SearchBudget() if budget is None else budget
    text, found_values, at, reached = text[:MAX_REPLY_CHARS], [], 0, 0
    opening = re.compile("[" + re.escape(openings + "".join(chr(ord(c) + 0xFEE0) for c in openings)) + "]")
    while budget.tries > 0 and budget.vain_chars >= 0 and (begins := opening.search(text, at)):
        budget.tries -= 1
        at = begins.start()
        reader = _Reader(text, at)
        try:
            value = reader.value(0)
        except _BrokenError:
            budget.vain_chars -= reader.at - at
            reached, at = max(reached, reader.at), at + 1
            continue
        found_values.append(ReadValue(value, at, reader.at, frozenset(reader.mends), at < reached))
        if found_values[-1].cut:
            budget.vain_chars -= reader.at - at
            reached, at = reader.at, at + 1
        else:
            at = reader.at
    return found_values


@dataclass(slots=True)
class _Reader:
    """Reads one value."""

    text: str
    at: int
    mends: set[Mend] = field(default_factory=set)

    def value(self, depth: int) -> Any:
        if depth > MAX_DEPTH:
            raise _BrokenError
        here = self._peek()
        if here == "":
            return self._cut()
        if here == "{":
            return self._object(depth)
        if here in "[(":
            return self._array(depth, "]" if here == "[" else ")")
        if here in _CLOSING:
            return self._string()
        if here in "+-.\u2212" or here.isdigit():
            return self._number()
        return self._word()

    def _object(self, depth: int) -> Any:
        self.at += 1
        members: dict[str, Any] = {}
        for _ in self._items("}"):
            key = self._key()
            if isinstance(key, Cut):
                break
            colon = self._peek()
            if colon == "":
                members[key] = self._cut()
                break
            if colon != ":":
                raise _BrokenError
            self.at += 1
            members[key] = self.value(depth + 1)
        if "truncated" in self.mends:
            members.setdefault("", CUT)
        return members

    def _array(self, depth: int, closing: str) -> Any:
        if closing == ")":
            self.mends.add("python")
        self.at += 1
        members = [self.value(depth + 1) for _ in self._items(closing)]
        if "truncated" in self.mends and not (members and isinstance(members[-1], Cut)):
            members.append(CUT)
        return members

    def _items(self, closing: str) -> Iterator[None]:
        """Yield before each member, until the closing bracket or the end of the text."""
        first = True
        while True:
            here = self._peek()
            if here == closing:
                self.at += 1
                return
            if here == "":
                self._cut()
                return
            if not first:
                if here == ",":
                    self.at += 1
                    here = self._peek()
                    if here == closing:
                        self.mends.add("trailing_comma")
                        continue
                    if here == "":
                        continue
                elif closing == "}" and here in _CLOSING:
                    self.mends.add("missing_comma")
                else:
                    raise _BrokenError
            first = False
            yield

    def _key(self) -> Any:
        if self._peek() in _CLOSING:
            return self._string()
        word = self._take(_WORD)
        if self.at == len(self.text):
            return self._cut()
        self.mends.add("unquoted")
        return word

    def _string(self) -> Any:
        quote = self.text[self.at]
        end = _CLOSING[quote]
        body = _UNTIL[end].match(self.text, self.at + 1)
        assert body is not None  # the pattern matches the empty string
        self.at = body.end()
        if self.at == len(self.text) or self.text[self.at] != end:  # a final backslash stops the pattern
            self.at = len(self.text)
            return self._cut()
        self.at += 1
        if quote != '"':
            self.mends.add("single_quotes" if quote == "'" else "smart_quotes")
        text = body.group()
        if any(letter < " " for letter in text):
            self.mends.add("control")
        return _ESCAPE.sub(_unescaped, text) if "\\" in text else text

    def _number(self) -> Any:
        digits = self._take(_NUMBER)
        if len(digits) > MAX_DIGITS:
            raise _BrokenError
        if self.at == len(self.text):
            return self._cut()  # digits may be missing
        plain = _JSON_NUMBER.fullmatch(digits) is not None
        if not plain:
            self.mends.add("number_form" if digits.isascii() else "full_width")
        read = number_in(digits) if not plain or not digits.lstrip("-").isdigit() else int(digits)
        unit = _UNIT.match(self.text, self.at)
        if unit is None:
            return read
        self.at = unit.end()
        if self.at == len(self.text):
            return self._cut()
        return Quantity(read, unit.group(1))

    def _word(self) -> Any:
        name = self._take(_WORD)
        if self.at == len(self.text):
            return self._cut()
        if name in _WORDS:
            return _WORDS[name]
        if name in _PYTHON:
            self.mends.add("python")
            return _PYTHON[name]
        self.mends.add("unquoted")
        return name

    def _take(self, pattern: re.Pattern[str]) -> str:
        match = pattern.match(self.text, self.at)
        if match is None:
            raise _BrokenError
        self.at = match.end()
        return match.group()

    def _peek(self) -> str:
        """Return the next character after spaces and comments, as ASCII if it is full-width; "" at the end."""
        text = self.text
        while True:
            self.at = _past(_SPACE, text, self.at)
            here = text[self.at : self.at + 1]
            if here and here in _ODD_SPACES:
                self.mends.add("whitespace")
                self.at = _past(_ODD_SPACE, text, self.at)
            elif here == "#" or text.startswith("//", self.at):
                self._comment(text.find("\n", self.at), 1)
            elif text.startswith("/*", self.at):
                self._comment(text.find("*/", self.at + 2), 2)
            elif "\uff01" <= here <= "\uff5e":
                self.mends.add("full_width")
                return chr(ord(here) - 0xFEE0)
            else:
                return here

    def _comment(self, end: int, length: int) -> None:
        self.mends.add("comment")
        self.at = len(self.text) if end < 0 else end + length

    def _cut(self) -> Cut:
        self.mends.add("truncated")
        return CUT


def _past(pattern: re.Pattern[str], text: str, at: int) -> int:
    match = pattern.match(text, at)
    return match.end() if match else at


def number_in(text: str) -> float:
    """Return the number that a text of digits, in any script, stands for. Raises ValueError."""
    return float(normalize("NFKC", text).replace("\u2212", "-"))


def _unescaped(match: re.Match[str]) -> str:
    escape = match.group(1)
    return chr(int(escape[1:], 16)) if len(escape) == 5 else _ESCAPED.get(escape, escape)
