"""The commands printed at the end of a command. Each can be pasted. Pipes and JSON output do not get them."""

import ast
import re
import shlex
import string
import sys
from pathlib import Path

import pytest

from dronecats import cli
from dronecats.cli.main import parse
from dronecats.cli.next_commands import NEXT, next_commands, print_next
from tests.support.command_line import DRONECATS
from tests.support.terminal import in_terminal, screen

AWKWARD = "it's a $folder"  # a name that a shell splits unless it is quoted
LATENCY = {"latency": "trace:it's a $folder"}  # it has a syntax of its own


def fields(made_by):
    return {name for command in NEXT[made_by] for _, name, _, _ in string.Formatter().parse(command) if name}


@pytest.mark.parametrize("made_by", NEXT)
def test_each_next_command_is_parsed_with_the_names_that_were_made(made_by):
    made = {name: LATENCY.get(name, AWKWARD) for name in fields(made_by)}
    commands = [shlex.split(line) for line in next_commands(made_by, **made)]
    assert 1 <= len(commands) <= 3
    for template, (program, *words) in zip(NEXT[made_by], commands, strict=True):
        assert program == "dronecats"
        assert parse(words).verb == words[0]
        assert len(re.findall(r"\{\w+\}", template)) == sum(AWKWARD in word for word in words)


def test_several_words_stay_several():
    (line,) = next_commands("compare", flights=["runs/a b", "runs/c"])
    assert list(map(str, parse(shlex.split(line)[1:]).runs)) == ["runs/a b", "runs/c"]


def test_the_commands_of_the_program_fill_every_declared_name():
    calls = [
        (made_by.value, {keyword.arg for keyword in node.keywords if keyword.arg})
        for file in Path(cli.__file__).parent.glob("*.py")
        for node in ast.walk(ast.parse(file.read_text()))
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "print_next"
        for made_by in ast.walk(node.args[0])
        if isinstance(made_by, ast.Constant) and made_by.value in NEXT
    ]
    assert {made_by for made_by, _ in calls} == NEXT.keys()
    assert [call for call in calls if call[0] != "study rate" and call[1] != fields(call[0])] == []


def test_nothing_is_printed_into_a_pipe_or_file(capsys, monkeypatch):
    print_next("doctor")
    assert capsys.readouterr().out == ""
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    print_next("doctor")
    assert capsys.readouterr().out.split("dronecats ")[1:]


@pytest.mark.parametrize(("form", "printed"), [([], True), (["--json"], False)])
def test_a_command_ends_with_the_next_in_a_terminal_but_not_as_json(form, printed):
    status, received = in_terminal([*DRONECATS, "tune", "x500", *form], columns=100)
    assert status == 0
    assert ("dronecats tune x500 --out " in screen(received)[-2]) == printed
