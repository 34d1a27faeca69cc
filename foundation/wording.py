"""Words of messages: numbers with their nouns, and the names that are near to a mistyped one."""

import difflib
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
