"""Files named in pages and in code exist in the repository. `make docs` checks the links of the pages."""

import re

import pytest

from tests.docs.pages import PAGES, ROOT
from tests.support.unused_parameters import section

ROOMS = ("autopilot", "benchmarks", "docs", "dronecats", "episodes", "foundation", "hil", "tests", "vehicles")
NAMED = re.compile(rf"(?<![\w/.])((?:{'|'.join(ROOMS)})(?:/[\w.-]*\w)+)")  # a path from the repository's root
NO_PATHS = ("dronecats/dronecats",)  # the name of the task in Inspect
SOURCE = re.compile(r"`([\w/-]+\.py)`")  # a source file, as a path or as a name alone


def missing(text: str) -> list[str]:
    """Return the project files that a text names and that do not exist."""
    wrong = [name for name in NAMED.findall(text) if name not in NO_PATHS and not (ROOT / name).exists()]
    return wrong + [name for name in SOURCE.findall(text) if name not in wrong and not _is_there(name)]


def _is_there(name: str) -> bool:
    return (ROOT / name).exists() if "/" in name else any(path for room in ROOMS for path in (ROOT / room).rglob(name))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_files_named_on_a_page_exist(page):
    assert missing(page.read_text(encoding="utf-8")) == []


def test_every_page_named_in_the_code_exists():
    """The search covers help, errors and docstrings. It skips docs/en, which belongs to PX4."""
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
        ("see `vehicles/nothing.py`", ["vehicles/nothing.py"]),
        ("see `rotor.py` and `nothing.py`", ["nothing.py"]),
        ("see `sitl/pace.py`", ["sitl/pace.py"]),  # a path must start at the root
        ("see tests/none/test_nothing.py.", ["tests/none/test_nothing.py"]),
    ],
)
def test_missing_files_are_detected(text, wrong):
    assert missing(text) == wrong


def test_compatibility_page_lists_the_parameters_without_effect():
    assert section() in (ROOT / "docs" / "compatibility.md").read_text(encoding="utf-8")
