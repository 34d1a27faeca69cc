"""Reads the commands that the pages give: from code blocks, and from words set as code within a sentence."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").rglob("*.md")])
# what makes a line a command of ours; `dronecats fly: …` is what one printed
BEGINS = re.compile(
    r"dronecats(?: (?!\S*:\s)|$)|python -m (?:benchmarks|dronecats|episodes|examples)\b|pytest |make |echo .* \| dron"
)
BEFORE = re.compile(r"(?:\$ |ExecStart=\S*/(?=dronecats )|(?:[A-Z_0-9]+=(?:\"[^\"]*\"|\S+) )+(?=pytest|dronecats))")


@dataclass(frozen=True)
class Command:
    """A command as a page has it, on one line, without its prompt and what is said about it."""

    page: str  # from the repository's root
    line: int
    text: str
    inline: bool  # set as code within a sentence, where often only a verb is named

    def __str__(self) -> str:
        return f"{self.page}:{self.line}: {self.text}"


def commands(page: Path) -> list[Command]:
    """Return the commands of a page, from top to bottom."""
    found = []
    for line, text, inline in _code(page.read_text(encoding="utf-8")):
        bare = BEFORE.sub("", text.strip(), count=1) if BEFORE.match(text.strip()) else text.strip()
        bare = re.split(r"\s{2,}|\s# ", bare)[0]  # what it does is said two spaces further on
        if BEGINS.match(bare):
            found.append(Command(str(page.relative_to(ROOT)), line, bare, inline))
    return found


def _code(text: str) -> Iterator[tuple[int, str, bool]]:
    """Yield line number, text and whether it is within a sentence, of every line or word that is set as code."""
    fenced, before, prose, begun = False, "", "", 0
    pending: tuple[int, str] | None = None  # a line that goes on after its backslash
    for number, line in enumerate(text.splitlines(), 1):
        if line.lstrip().startswith("```"):
            fenced = not fenced
            continue
        indented = line.startswith("    ") and (not before.strip() or before.startswith("    "))
        before = line
        if fenced or indented or pending:
            start, joined = pending or (number, "")
            joined = f"{joined} {line.strip()}".strip()
            pending = (start, joined[:-1].rstrip()) if joined.endswith("\\") else None
            if not pending:
                yield start, joined, False
            continue
        begun, prose = (begun or number, f"{prose}\n{line}") if line.strip() else (begun, prose)
        if not line.strip():
            yield from _spans(begun, prose)
            begun, prose = 0, ""
    yield from _spans(begun, prose)


def _spans(begun: int, paragraph: str) -> Iterator[tuple[int, str, bool]]:
    for span in re.finditer(r"`([^`]+)`", paragraph):
        number = begun + paragraph.count("\n", 0, span.start()) - 1
        yield number, " ".join(span[1].split()), True
