"""Reads the listing of a prompt out of a LaTeX source, to the character."""

import re
from collections.abc import Iterator

from dronecats.agent.prompt import NEEDED, Prompt
from foundation.errors import UsageError
from foundation.wording import counted

# an environment whose text LaTeX takes as it stands, from the line after its options; a line that begins with % is none
_LISTING = re.compile(
    r"^[ \t]*\\begin\{(?P<name>lstlisting|verbatim|Verbatim)\}(?P<rest>.*?)^[ \t]*\\end\{(?P=name)\}", re.M | re.S
)


def prompt_listing(source: str, where: str) -> str:
    """Return the only listing of a LaTeX source that is a prompt template: one that has all fields of NEEDED.

    `where` names the source in errors. Raises UsageError when there is none, several, or one with an unknown field.
    """
    texts = list(_listings(source.replace("\r\n", "\n")))
    fields = [f"{{{name}}}" for name in NEEDED]
    found = [text for text in texts if all(field in text for field in fields)]
    if not texts:
        raise UsageError(f"{where} has no listing (lstlisting or verbatim); give the LaTeX file that holds the prompt")
    if not found:
        raise UsageError(
            f"{where} has {counted(len(texts), 'listing')}, none with {' and '.join(fields)};"
            " give the LaTeX file that holds the prompt"
        )
    if len(found) > 1:
        raise UsageError(
            f"{where} has {len(found)} listings that are prompts; keep the one to fly in a file of its own"
        )
    return Prompt.of(found[0], f"the listing in {where}").template


def _listings(source: str) -> Iterator[str]:
    """Yield the text of each listing, its options left out."""
    for match in _LISTING.finditer(source):
        rest = match["rest"]
        head, _, text = rest[_options_end(rest) :].partition("\n")
        if not head.strip():
            yield text


def _options_end(text: str) -> int:
    """Return where `[…]` at the beginning of a text ends; brackets within braces are part of an option's value."""
    if not text.lstrip(" \t").startswith("["):
        return 0
    depth = 0
    for place, character in enumerate(text):
        depth += {"{": 1, "}": -1}.get(character, 0)
        if character == "]" and depth == 0:
            return place + 1
    return 0
