"""Makes the HTML file of a page: mark-up, style, program and data. The page uses no network.

The program consists of ES modules. Browsers do not load modules from a local disk, so the page has all modules in one
script, in the order of their imports. The content security policy allows inline scripts and styles only by their
digest, so text from a model cannot run.
"""

import base64
import hashlib
import html
import re
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from importlib.resources import files

from dronecats.report.kit import palette

_FIELD = re.compile("{{(policy|title|style|trail|tools|main|more|script)}}")
_IMPORT = re.compile(r'^import (\{[^}]*\}) from "\./(\w+)\.js";$', re.MULTILINE)
_EXPORT = re.compile(r"^export ((?:async )?function|const|class) (\w+)", re.MULTILINE)


@dataclass(frozen=True, slots=True, kw_only=True)
class PageContent:
    """The contents of a page. `main`, `trail`, `tools` and `more` are HTML. `page` adds the common style and bar."""

    title: str
    folder: str  # package with the page's style (web/page.css) and ES modules
    entry: str = "bar"  # first module of the program
    main: str
    trail: str = ""  # items of the breadcrumb list in the bar
    tools: str = ""  # buttons beside the theme button
    more: str = ""  # elements after main
    loads_files: bool = False  # whether the page may load scripts and pictures from its folder
    has_drawings: bool = False  # whether the page has SVG with style attributes


def page(content: PageContent, blocks: Mapping[str, str] | None = None) -> Iterable[str]:
    """Yield the page in chunks. `blocks`: JSON for script elements, by element id."""
    style = palette.css() + _read(__package__ or "", "kit.css") + _read(content.folder, "page.css")
    script = program(content.entry, content.folder)
    values = {
        **asdict(content),
        "policy": _policy(content, script, style),
        "title": html.escape(content.title),
        "style": style,
        "script": script,
    }
    head, tail = (
        _FIELD.sub(lambda match: values[match[1]], half)
        for half in _read(__package__ or "", "page.html").split("{{blocks}}")
    )
    yield head
    for key, block in (blocks or {}).items():
        yield f'<script type="application/json" id="{key}">{block}</script>\n'
    yield tail


def program(entry: str, folder: str) -> str:
    """Return `entry` and the modules that it imports as one script: a function per module, in the order of imports."""
    order: list[str] = []

    def visit(name: str) -> None:
        if name not in order:
            for _, needed in _IMPORT.findall(_module(name, folder)):
                visit(needed)
            order.append(name)

    visit(entry)
    return '\n(() => {\n"use strict";\n' + "\n".join(_as_function(name, folder) for name in order) + "})();\n"


def _as_function(name: str, folder: str) -> str:
    text = _module(name, folder)
    exports = ", ".join(export for _, export in _EXPORT.findall(text))
    body = _EXPORT.sub(r"\1 \2", _IMPORT.sub(r"const \1 = $\2;", text))
    return f"const ${name} = (() => {{\n{body}return {{ {exports} }};\n}})();\n"


def _module(name: str, folder: str) -> str:
    own = files(folder).joinpath("web", f"{name}.js")
    return own.read_text(encoding="utf-8") if own.is_file() else _read(__package__ or "", f"{name}.js")


def _policy(content: PageContent, script: str, style: str) -> str:
    """Return the content security policy. It permits this script and style, and optionally the page's folder."""
    beside = " 'self' file:" if content.loads_files else ""
    rules = [
        "default-src 'none'",
        f"script-src {_digest(script)}{beside}",
        f"style-src {_digest(style)}",
        f"img-src{beside} data:",
        "base-uri 'none'",
        "form-action 'none'",
    ]
    return "; ".join([*rules, "style-src-attr 'unsafe-inline'"] if content.has_drawings else rules)


def _digest(text: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


def _read(folder: str, name: str) -> str:
    return files(folder).joinpath("web", name).read_text(encoding="utf-8")


OUTCOMES = {  # outcome → mark and word
    "success": ("✓", "success"),
    "failure": ("✕", "failure"),
    "error": ("!", "error"),
    "damaged": ("!", "damaged"),
    "censored": ("?", "censored"),
    "unknown": ("?", "unknown"),
    "distance only": ("?", "distance only"),
}
