"""The pages are a tree: docs/README.md leads to each, and what a page names in the repository is there."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.docs.pages import PAGES, ROOT

FIRST = ROOT / "docs" / "README.md"
LINK = re.compile(r"\]\(([^()\s]+)\)")
ELSEWHERE = re.compile(r"[a-z]+:")  # another site
ROOMS = ("autopilot", "benchmarks", "docs", "dronecats", "episodes", "foundation", "hil", "tests", "vehicles")
NAMED = re.compile(rf"(?<![\w/.])((?:{'|'.join(ROOMS)})(?:/[\w.-]*\w)+)")  # a path of ours, from the root
NO_PATHS = ("dronecats/dronecats",)  # the task, as Inspect names it
SOURCE = re.compile(r"`([\w/-]+\.py)`")  # a source file, by its path or by its name alone


def links(text: str) -> Iterator[tuple[str, str]]:
    """Yield the path of every link that stays in the repository, and the place on that page."""
    for target in LINK.findall(text):
        if not ELSEWHERE.match(target):
            path, _, anchor = target.partition("#")
            yield path, anchor


def anchors(page: Path) -> set[str]:
    """Return the places of a page that can be linked to: its headings, as GitHub spells them."""
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    heads = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in heads}


def missing(page: Path, text: str) -> list[str]:
    """Return what a page's text names and is not there: links, their places, and files of ours."""
    wrong = []
    for path, anchor in links(text):
        found = (page.parent / path).resolve() if path else page
        if not found.exists() or (anchor and anchor not in anchors(found)):
            wrong.append(f"{path}#{anchor}" if anchor else path)
    wrong += [name for name in NAMED.findall(text) if name not in NO_PATHS and not (ROOT / name).exists()]
    return wrong + [name for name in SOURCE.findall(text) if name not in wrong and not _is_there(name)]


def _is_there(name: str) -> bool:
    return (ROOT / name).exists() if "/" in name else any(path for room in ROOMS for path in (ROOT / room).rglob(name))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_what_a_page_names_is_there(page):
    assert missing(page, page.read_text(encoding="utf-8")) == []


def test_the_first_page_leads_to_every_other():
    led_to = {(FIRST.parent / path).resolve() for path, _ in links(FIRST.read_text(encoding="utf-8"))}
    others = [page for page in PAGES if page.is_relative_to(FIRST.parent) and page != FIRST]
    assert [str(page.relative_to(ROOT)) for page in others if page not in led_to] == []
    assert "docs/README.md" in [path for path, _ in links((ROOT / "README.md").read_text(encoding="utf-8"))]


def test_every_page_that_the_code_names_is_there():
    """In help, in errors and in docstrings; PX4's own docs/en are another project's."""
    named = {
        (page, path.name)
        for room in ROOMS
        for path in (ROOT / room).rglob("*.py")
        for page in re.findall(r"(?<![\w/])docs/(?!en/)[\w/-]+\.md", path.read_text(encoding="utf-8"))
    }
    assert len(named) > 10
    assert [(page, by) for page, by in named if not (ROOT / page).exists()] == []


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        ("[there](models.md#change-the-prompt)", []),
        ("[not there](nowhere.md)", ["nowhere.md"]),
        ("[a place](models.md#nowhere)", ["models.md#nowhere"]),
        ("see `vehicles/nothing.py`", ["vehicles/nothing.py"]),
        ("see `rotor.py` and `nothing.py`", ["nothing.py"]),
        ("see `sitl/pace.py`", ["sitl/pace.py"]),  # from the root, or by its name alone
        ("see tests/none/test_nothing.py.", ["tests/none/test_nothing.py"]),
    ],
)
def test_what_is_not_there_is_found(text, wrong):
    assert missing(FIRST, text) == wrong
