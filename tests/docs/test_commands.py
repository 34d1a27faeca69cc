"""Every command of README.md and docs/ is taken from its page and run, or `tables.py` says why not."""

import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from dronecats.cli.main import VERBS, parse
from tests.docs import tables
from tests.docs.pages import PAGES, ROOT, commands

ALL = [command for page in PAGES for command in commands(page)]
OURS = [command for command in ALL if re.match(r"(echo .* \| )?dronecats ", command.text)]
# `dronecats` and `python` are those of this test, wherever it is run from
PRELUDE = 'dronecats() { "$PYTHON" -m dronecats.cli.main "$@"; }; python() { "$PYTHON" "$@"; }; set -o pipefail; '
EPISODE = "residential-approaching-01"


def test_the_pages_are_read():
    """One command of each way in which a page can set it, so that a reader that reads nothing is found out."""
    read = {(command.page, command.text) for command in ALL}
    assert ("README.md", "dronecats tune x500") in read  # within a sentence
    assert ("docs/maps.md", "dronecats maps list [--json]") in read  # in a fence, and explained there
    assert ("docs/flying-px4.md", "dronecats fly --sitl") in read  # indented, with a comment
    assert any("--arm --seconds" in text for page, text in read if page == "docs/after-flight.md")  # over two lines
    assert any(text.startswith("dronecats fly --connect serial") for _, text in read)  # of a service
    assert not [text for _, text in read if text.startswith("dronecats fly:")]  # what one printed


@pytest.mark.parametrize("command", ALL, ids=str)
def test_every_command_is_run_or_said_why_not(command):
    try:
        tables.row(command.text)
    except LookupError as missing:
        raise AssertionError(f"{command} is in {missing} of tests/docs/tables.py") from None


@pytest.mark.parametrize("table", [tables.RUNS, tables.ELSEWHERE])
def test_no_row_stands_for_nothing(table):
    begins = [row.begins if isinstance(row, tables.Run) else row[0] for row in table]
    assert [begin for begin in begins if not any(re.match(begin, command.text) for command in ALL)] == []


@pytest.mark.parametrize("command", OURS, ids=str)
def test_every_command_can_be_parsed(command, capsys):
    words = shlex.split(tables.filled(command.text).split("| ")[-1])[1:]
    if not words:
        return
    assert words[0] in VERBS
    try:
        parse(words)
    except SystemExit:
        options = [word for word in words if word.startswith("-")]
        assert command.inline, capsys.readouterr().err
        assert not options, capsys.readouterr().err
        with pytest.raises(SystemExit) as named:  # a verb is named that wants more than its name
            parse([*words, "--help"])
        assert named.value.code == 0, capsys.readouterr().err


@pytest.mark.parametrize("command", [c for c in ALL if c.text.startswith(("pytest ", "make "))], ids=str)
def test_what_make_and_pytest_are_asked_for_is_there(command):
    what = command.text.split()[1]
    if command.text.startswith("pytest "):
        assert (ROOT / what).exists()
    elif tables.row(command.text) != "in PX4's sources":
        assert re.search(rf"^{re.escape(what)}:", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)


@pytest.fixture(scope="session")
def flown(tmp_path_factory) -> Path:
    """A run folder with a flight in it."""
    folder = tmp_path_factory.mktemp("docs") / "flown"
    shell(f"dronecats episodes audit {EPISODE} --jobs 1 --out {folder}", folder.parent)
    return Path(folder)


@pytest.fixture
def workplace(tmp_path, flown) -> Path:
    """A folder in which a page's relative paths lead to copies."""
    shutil.copytree(flown, tmp_path / "flown")
    (tmp_path / "docs" / "assets").mkdir(parents=True)
    (tmp_path / "benchmarks").mkdir()
    for copied in ("docs/airframes.md", "benchmarks/square.jsonl"):
        shutil.copy(ROOT / copied, tmp_path / copied)
    own = re.search(r"```python\n(.*?)```", (ROOT / "docs" / "metrics.md").read_text(encoding="utf-8"), re.DOTALL)
    assert own
    (tmp_path / "own.py").write_text(own[1], encoding="utf-8")
    return Path(tmp_path)


def shell(line: str, folder: Path) -> None:
    """Run a line in a folder. Raises AssertionError when it does not end with 0."""
    environment = {**os.environ, "PYTHON": sys.executable, "PYTHONPATH": str(ROOT), "DRONECATS_MAPS": f"{folder}/maps"}
    done = subprocess.run(
        ["bash", "-c", PRELUDE + line],
        cwd=folder,
        env=environment,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert done.returncode == 0, f"{line}\nends with {done.returncode}\n{done.stdout[-1500:]}{done.stderr[-1500:]}"


def lines(slow: bool) -> dict[str, list[str]]:
    """Return by page what is run, in the page's order; what several pages have is run for the first of them."""
    found: dict[str, str] = {}
    for command in ALL:
        try:
            row = tables.row(command.text)
        except LookupError:  # which has a test of its own
            continue
        if isinstance(row, tables.Run) and row.slow == slow:
            text = re.sub(row.drop, "", tables.filled(command.text)) if row.drop else tables.filled(command.text)
            found.setdefault(" ".join(f"{text} {row.add}".split()), command.page)
    return {page: [line for line, of in found.items() if of == page] for page in dict.fromkeys(found.values())}


@pytest.mark.slow
@pytest.mark.parametrize("page", lines(slow=False))
def test_the_commands_of_a_page_run(page, workplace):
    for line in lines(slow=False)[page]:
        shell(line, workplace)


@pytest.mark.slow
@pytest.mark.parametrize("page", lines(slow=True))
def test_the_flights_of_a_page_run(page, workplace):
    for line in lines(slow=True)[page]:
        shell(line, workplace)
