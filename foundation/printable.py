"""What may be shown of words that are not ours: text stays, and what steers a terminal is spelt out.

A model, a server or a file may say anything: sequences that move the cursor or write the clipboard, characters that
turn the order of a line round, half a surrogate pair. None of it goes to a terminal but in letters.
"""

import unicodedata

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
