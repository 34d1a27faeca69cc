"""The one file that a browser opens: mark-up, style, program and data, with nothing to be fetched from a network.

The program is written as ES modules, which a browser does not load from a disk; so they stand in the page as one
script, in the order of their imports. Scripts and styles are allowed by their digest alone: whatever a model has
answered, it cannot run.
"""

import base64
import hashlib
import re
from collections.abc import Iterable, Mapping
from importlib.resources import files

ENTRY = "main"
_FIELD = re.compile("{{(title|policy|style|index|script)}}")
_IMPORT = re.compile(r'^import (\{[^}]*\}) from "\./(\w+)\.js";$', re.MULTILINE)
_EXPORT = re.compile(r"^export ((?:async )?function|const|class) (\w+)", re.MULTILINE)


def page(title: str, index: str, blocks: Mapping[str, str] | None = None) -> Iterable[str]:
    """Yield the page in pieces. `index` is JSON for a script element, as are `blocks` of flights by their key."""
    script, style = program(), _read("page.css")
    values = {
        "title": title,
        "policy": _policy(script, style),
        "style": style,
        "index": index,
        "script": script,
    }
    head, tail = (_FIELD.sub(lambda match: values[match[1]], part) for part in _read("page.html").split("{{blocks}}"))
    yield head
    for key, block in (blocks or {}).items():
        yield f'<script type="application/json" id="flight:{key}">{block}</script>\n'
    yield tail


def program() -> str:
    """Return the modules as one script: each a function of its own, after what it imports, that returns its exports."""
    order: list[str] = []

    def visit(name: str) -> None:
        if name not in order:
            for _, needed in _IMPORT.findall(_read(f"{name}.js")):
                visit(needed)
            order.append(name)

    visit(ENTRY)
    return '\n(() => {\n"use strict";\n' + "\n".join(_module(name) for name in order) + "})();\n"


def _module(name: str) -> str:
    text = _read(f"{name}.js")
    exports = ", ".join(export for _, export in _EXPORT.findall(text))
    body = _EXPORT.sub(r"\1 \2", _IMPORT.sub(r"const \1 = $\2;", text))
    return f"const ${name} = (() => {{\n{body}return {{ {exports} }};\n}})();\n"


def _policy(script: str, style: str) -> str:
    """Return what the browser may load: this script and style, pictures and flights that lie beside the page."""
    return "; ".join(
        (
            "default-src 'none'",
            f"script-src {_digest(script)} 'self' file:",
            f"style-src {_digest(style)}",
            "img-src 'self' file: data:",
            "base-uri 'none'",
            "form-action 'none'",
        )
    )


def _digest(text: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


def _read(name: str) -> str:
    return files(__package__ or "").joinpath("web", name).read_text(encoding="utf-8")
