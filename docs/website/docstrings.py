"""Converts the project's docstrings and comments into a form that Sphinx can read."""

import inspect
import re
from importlib import import_module
from typing import Any

from sphinx.pycode import ModuleAnalyzer

from docs.website.api import MODULES

# Matches `name: type = value  # the meaning`, unless the value contains a #
COMMENTED = re.compile(r"^(\s*\w+(?::| =)[^#\n]*)  # (?!type:|noqa)", re.MULTILINE)
INDENT = "    "
# code; or a character to escape, because only reStructuredText reads it as markup
MARKUP = re.compile(r"(`+[^`]*`+)|([*|]|(?<=\w)_(?!\w))")


def document_comments() -> None:
    """Turn the comments beside fields and constants into `#:` comments, which Sphinx reads as documentation."""
    for name in MODULES:
        source = COMMENTED.sub(r"\1  #: ", inspect.getsource(import_module(name)))
        ModuleAnalyzer.cache["module", name] = ModuleAnalyzer.for_string(source, name)


def process(_app: Any, what: str, name: str, _obj: Any, _options: Any, lines: list[str]) -> None:
    """Change the lines of a docstring in place: keep its tables, and list a module's members below its text."""
    lines[:] = preformatted(lines)
    if what == "module":
        lines += ["", ".. autosummary::", "   :nosignatures:", "", *(f"   {member}" for member in members(name)), ""]


def preformatted(lines: list[str]) -> list[str]:
    """Return a docstring as reStructuredText. Its indented blocks keep their lines, because they are tables."""
    text: list[str] = []
    inside = False
    for line in lines:
        indented = line.startswith(INDENT) or (inside and not line)
        if indented and not inside:
            text += ["", "::", ""]
        elif inside and not indented:
            text.append("")
        text.append(line if indented else MARKUP.sub(lambda found: found[1] or f"\\{found[2]}", line))
        inside = indented
    return text


def members(module: str) -> list[str]:
    """Return the names of the public classes and functions of a module."""
    defined = vars(import_module(module)).items()
    return [
        name
        for name, value in defined
        if not name.startswith("_") and callable(value) and getattr(value, "__module__", "") == module
    ]
