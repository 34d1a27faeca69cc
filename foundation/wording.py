"""Words of messages: numbers with their nouns, names near a mistyped one, and foreign text made harmless.

A model, a server or a file may say anything: sequences that move the cursor or write the clipboard, characters that
turn the order of a line round, half a surrogate pair. None of it reaches a terminal but spelt out.
"""

import difflib
import unicodedata
from collections.abc import Iterable


def counted(count: int, noun: str, plural: str | None = None) -> str:
    """Return a number and its noun: `1 declaration`, `2 declarations`."""
    return f"{count:,} {noun if count == 1 else plural or noun + 's'}"


def nearest(word: str, known: Iterable[str], count: int = 3, cutoff: float = 0.6) -> list[str]:
    """Return at most `count` of the known names that are near to a word, the nearest first; [] where none is.

    Case and punctuation do not matter. A name that begins with the word is nearer than one that is only like it.
    `cutoff`: how alike a name is at least, 0 … 1, as in `difflib.get_close_matches`.
    """
    sought = _letters(word[:100])
    names: dict[str, str] = {}
    for name in known:
        names.setdefault(_letters(name), name)
    begun = [letters for letters in sorted(names, key=len) if sought and letters.startswith(sought)]
    alike = difflib.get_close_matches(sought, names, count, cutoff)
    return [names[letters] for letters in dict.fromkeys([*begun, *alike])][:count]


def _letters(word: str) -> str:
    return "".join(character for character in word.casefold() if character.isalnum())


def did_you_mean(names: Iterable[str]) -> str:
    """Return `did you mean 'a' or 'b'?`."""
    return f"did you mean {' or '.join(repr(name) for name in names)}?"


LINE = "\n"  # the only control that is meant
_SPACE = "Zs"  # category of Unicode: spaces of all widths, which Python calls unprintable


def printable(text: str) -> str:
    r"""Return `text` with every character that is neither printable nor a line's end as JSON writes it, such as \u001b.

    Applied twice it is as applied once, and a JSON text stays the JSON text that it was.
    """
    if text.isascii() and text.replace(LINE, "").isprintable():
        return text
    return "".join(each if shows(each) else _spelt(each) for each in text)


def shows(character: str) -> bool:
    """Return whether a character is printed as it stands."""
    return character == LINE or character.isprintable() or unicodedata.category(character) == _SPACE


def _spelt(character: str) -> str:
    pairs = character.encode("utf-16-be", "surrogatepass")
    return "".join(rf"\u{pairs[at : at + 2].hex()}" for at in range(0, len(pairs), 2))
