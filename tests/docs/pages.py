"""The pages of the documentation and their blocks of code.

A marker on the line above a block tells the tests how to treat it: `<!-- test: KIND -->`, with a KIND of `KINDS`.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").rglob("*.md")])
# The blocks of one page run in order, in a folder that holds the run `runs/demo` and a copy of docs/.
KINDS = {
    "run": "sh, console or python: it runs, and ends with status 0",
    "file": "text that is written to the file that the marker names: <!-- test: file NAME -->",
    "needs-key": "a model behind an address, mostly with a key",
    "needs-px4": "a PX4 build",
    "needs-board": "a flight controller, a vehicle or a camera",
    "long": "minutes to hours of flights",
    "interactive": "runs until Ctrl-C, or in real time",
    "setup": "installs software, changes the checkout, or starts a program of another project",
}
MARKER = "<!-- test:"
# `dronecats report` and `dronecats study` generate these pages. Their blocks are the commands that generate them.
GENERATED = re.compile(r"docs/(reports|studies)/[\w-]+/report\.md|docs/studies/host-load\.md")
BLOCK = re.compile(
    rf"(?:^{MARKER} (?P<kind>\S+)(?: (?P<file>\S+))? -->\n)?^```(?P<language>\S*)\n(?P<code>.*?)^```$",
    re.MULTILINE | re.DOTALL,
)


@dataclass(frozen=True)
class Block:
    """A fenced block of code."""

    page: str  # path from the repository's root
    line: int  # of the opening fence
    kind: str | None  # a key of KINDS; None: the block has no marker
    file: str | None
    language: str
    code: str

    def __str__(self) -> str:
        return f"{self.page}:{self.line}"

    @property
    def script(self) -> str:
        """The commands of a shell block, without the output that a console block also shows."""
        prompted = re.findall(r"^\$ ((?:.*\\\n)*.*\n)", self.code, re.MULTILINE)
        return "".join(prompted) if self.language == "console" else self.code


def blocks(page: Path) -> Iterator[Block]:
    """Yield the fenced blocks of a page from top to bottom."""
    text, path = page.read_text(encoding="utf-8"), page.relative_to(ROOT).as_posix()
    for match in BLOCK.finditer(text):
        line = text.count("\n", 0, match.start("language")) + 1
        kind, *rest = match.group("kind", "file", "language", "code")
        yield Block(path, line, kind or ("long" if GENERATED.fullmatch(path) else None), *rest)
