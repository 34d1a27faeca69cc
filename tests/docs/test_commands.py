"""Runs the code blocks of README.md and docs/ that are marked `run`, and parses the commands of all others."""

import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from dronecats.cli.main import parse
from tests.docs.pages import BLOCK, KINDS, MARKER, PAGES, ROOT, Block, blocks

BLOCKS = [block for page in PAGES for block in blocks(page)]
RUNNING = sorted({block.page for block in BLOCKS if block.kind == "run"} - {"docs/README.md"})  # `demo` runs that block
SHELL = ("sh", "console")
COMMAND = re.compile(r"(    )?(\$ )?(dronecats|python3?|make|pip|pytest) (?!\S*: )")  # `dronecats fly: …` is output
# Runs `dronecats` and `python` with the interpreter and the checkout of this test, even if nothing is installed.
PRELUDE = 'set -eo pipefail; dronecats() { python -m dronecats.cli.main "$@"; }; python() { "$PYTHON" "$@"; }\n'


def calls(text: str, program: str) -> Iterator[list[str]]:
    """Yield the arguments of each call of a program in shell commands."""
    for line in text.replace("\\\n", " ").splitlines():
        words = [word.lstrip("$(") for word in shlex.split(line, comments=True)]
        for start, word in enumerate(words, 1):
            if word == program or word.endswith(f"bin/{program}"):
                end = next((i for i, word in enumerate(words) if i >= start and word in ("|", "&&", ";")), None)
                yield words[start:end]


def prose(page: Path) -> str:
    """Return the text of a page without its fenced blocks and their markers."""
    return BLOCK.sub("", page.read_text(encoding="utf-8"))


def spans(page: Path) -> list[str]:
    """Return the commands with options that are inline code in the sentences of a page."""
    return [" ".join(span.split()) for span in re.findall(r"`(dronecats\s[^`]*\s\[?-[^`]*)`", prose(page))]


def shell(script: str, folder: Path) -> None:
    """Run a script in a folder. Raises AssertionError if one of its commands fails."""
    environment = {**os.environ, "PYTHON": sys.executable, "PYTHONPATH": str(ROOT), "DRONECATS_MAPS": f"{folder}/maps"}
    command = ["bash", "-c", PRELUDE + script]
    done = subprocess.run(
        command, cwd=folder, env=environment, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=900
    )
    assert done.returncode == 0, f"{script}ended with {done.returncode}\n{done.stdout[-1500:]}{done.stderr[-1500:]}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_shell_block_has_a_marker(page):
    marked = [block for block in blocks(page) if block.kind]
    unmarked = [block for block in blocks(page) if not block.kind]
    assert [str(block) for block in unmarked if block.language in SHELL or COMMAND.match(block.code)] == []
    assert [str(block) for block in marked if block.kind not in KINDS] == []
    assert [str(block) for block in marked if (block.kind == "file") != bool(block.file)] == []
    assert prose(page).count(MARKER) == 0, "a marker is not directly above its fence"
    assert [line for line in prose(page).splitlines() if COMMAND.match(line)] == [], "commands belong in a fence"


@pytest.mark.parametrize("block", [block for block in BLOCKS if block.kind not in (None, "file")], ids=str)
def test_every_command_can_be_parsed(block):
    if block.language == "python":
        compile(block.code, str(block), "exec")
        return
    for words in calls(block.script, "dronecats"):
        parse(words)
    for path, *_ in calls(block.script, "pytest"):
        assert (ROOT / path).exists()
    for target, *_ in calls(block.script, "make"):
        assert re.search(rf"^{re.escape(target)}:", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)


@pytest.mark.parametrize("page", [page for page in PAGES if spans(page)], ids=lambda page: str(page.relative_to(ROOT)))
def test_commands_within_sentences_can_be_parsed(page):
    for span in spans(page):
        parse(shlex.split(span)[1:])


@pytest.fixture(scope="session")
def demo(tmp_path_factory) -> Path:
    """A folder with the run `runs/demo`, made with the commands in docs/README.md."""
    folder = tmp_path_factory.mktemp("docs")
    for block in blocks(ROOT / "docs" / "README.md"):
        run_block(block, folder)
    assert (folder / "runs" / "demo" / "run.json").exists()
    return Path(folder)


@pytest.mark.process
@pytest.mark.slow("whole commands, with their flights")
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("page", [pytest.param(page, marks=pytest.mark.xdist_group(page)) for page in RUNNING])
def test_the_code_blocks_of_a_page_run(page, demo, tmp_path):
    shutil.copytree(demo, tmp_path, dirs_exist_ok=True)
    shutil.copytree(ROOT / "docs", tmp_path / "docs", ignore=shutil.ignore_patterns("*.jpg", "*.png", "*.svg", "*.pdf"))
    (tmp_path / "benchmarks").symlink_to(ROOT / "benchmarks")
    for block in blocks(ROOT / page):
        run_block(block, tmp_path)


def run_block(block: Block, folder: Path) -> None:
    """Write a block marked `file` to its file, run a block marked `run`, and skip all others."""
    if block.file:
        (folder / block.file).write_text(block.code, encoding="utf-8")
    elif block.kind == "run":
        shell(f"python -c {shlex.quote(block.code)}\n" if block.language == "python" else block.script, folder)
