"""The suggested next commands that a command prints at its end. Pipes and JSON output do not get them."""

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

AWKWARD = "it's a $folder"  # a shell splits this name unless it is quoted
LATENCY = {"latency": "trace:it's a $folder"}  # this option has its own syntax


def fields(made_by):
    return {name for command in NEXT[made_by] for _, name, _, _ in string.Formatter().parse(command) if name}


@pytest.mark.parametrize("made_by", NEXT)
def test_each_next_command_can_be_parsed_when_its_names_need_quoting(made_by):
    made = {name: LATENCY.get(name, AWKWARD) for name in fields(made_by)}
    commands = [shlex.split(line) for line in next_commands(made_by, **made)]
    assert 1 <= len(commands) <= 3
    for template, (program, *words) in zip(NEXT[made_by], commands, strict=True):
        assert program == "dronecats"
        assert parse(words).verb == words[0]
        assert len(re.findall(r"\{\w+\}", template)) == sum(AWKWARD in word for word in words)


def test_paths_with_spaces_stay_separate_arguments():
    (line,) = next_commands("compare", flights=["runs/a b", "runs/c"])
    assert list(map(str, parse(shlex.split(line)[1:]).runs)) == ["runs/a b", "runs/c"]


def test_print_next_calls_fill_every_declared_field():
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


def test_next_commands_are_printed_only_to_a_terminal(capsys, monkeypatch):
    print_next("doctor")
    assert capsys.readouterr().out == ""
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    print_next("doctor")
    assert capsys.readouterr().out.split("dronecats ")[1:]


@pytest.mark.parametrize(("form", "printed"), [([], True), (["--json"], False)])
def test_a_command_in_a_terminal_prints_next_commands_unless_it_prints_json(form, printed):
    status, received = in_terminal([*DRONECATS, "tune", "x500", *form], columns=100)
    assert status == 0
    assert ("dronecats tune x500 --out " in screen(received)[-2]) == printed
