"""Helpers for messages: counted nouns, suggestions for mistyped names, and safe display of untrusted text.

Text from a model, a server or a file may contain sequences that move the cursor or write the clipboard, characters
that reverse a line, or half a surrogate pair. `printable` escapes them before they reach a terminal.
"""

import difflib
import unicodedata
from collections.abc import Iterable


def counted(count: int, noun: str, plural: str | None = None) -> str:
    """Return a number and its noun: `1 declaration`, `2 declarations`."""
    return f"{count:,} {noun if count == 1 else plural or noun + 's'}"


def nearest(word: str, names: Iterable[str], count: int = 3, cutoff: float = 0.6) -> list[str]:
    """Return at most `count` names that are similar to a word, the most similar first.

    Case and punctuation do not matter. Names that begin with the word come first. `cutoff`: the lowest similarity of
    the others, 0 … 1, as in `difflib.get_close_matches`.
    """
    sought = _letters(word[:100])
    by_letters: dict[str, str] = {}
    for name in names:
        by_letters.setdefault(_letters(name), name)
    begun = [letters for letters in sorted(by_letters, key=len) if sought and letters.startswith(sought)]
    similar = difflib.get_close_matches(sought, by_letters, count, cutoff)
    return [by_letters[letters] for letters in dict.fromkeys([*begun, *similar])][:count]


def _letters(word: str) -> str:
    return "".join(character for character in word.casefold() if character.isalnum())


def did_you_mean(names: Iterable[str]) -> str:
    """Return `did you mean 'a' or 'b'?`."""
    return f"did you mean {' or '.join(repr(name) for name in names)}?"


def suggestion(word: str, names: Iterable[str], *, count: int = 3, cutoff: float = 0.4) -> str:
    """Return a question with the names that are similar to a word, or the list of all names if none is similar."""
    choices = list(names)
    near = nearest(word, choices, count, cutoff)
    return did_you_mean(near) if near else f"choose one of {', '.join(choices)}."


LINE = "\n"  # the only allowed control character
_SPACE = "Zs"  # category of Unicode: spaces of all widths, which Python calls unprintable


def printable(text: str) -> str:
    r"""Return `text` with every character that is neither printable nor a newline escaped as in JSON, such as \u001b.

    A second call has no effect. If `text` is JSON, its value stays the same.
    """
    if text.isascii() and text.replace(LINE, "").isprintable():
        return text
    return "".join(character if shows(character) else _spelt(character) for character in text)


def shows(character: str) -> bool:
    """Return whether a character is printed unchanged."""
    return character == LINE or character.isprintable() or unicodedata.category(character) == _SPACE


def _spelt(character: str) -> str:
    pairs = character.encode("utf-16-be", "surrogatepass")
    return "".join(rf"\u{pairs[at : at + 2].hex()}" for at in range(0, len(pairs), 2))
