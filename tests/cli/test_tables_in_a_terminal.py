"""Tables of the commands in a terminal of 100 columns, and in a pipe."""

import subprocess
from collections import Counter

import pytest

from tests.support.command_line import DRONECATS
from tests.support.terminal import in_terminal, screen

WIDE = [["models", "list"], ["episodes", "list", "--suite", "quick"]]  # wider than 100 columns


@pytest.mark.parametrize("verb", WIDE, ids=" ".join)
def test_tables_fit_the_terminal_and_are_not_wrapped_in_a_pipe(verb):
    status, received = in_terminal([*DRONECATS, *verb], columns=100)
    shown = screen(received)
    assert status == 0
    assert max(map(len, shown)) <= 100
    piped = subprocess.run([*DRONECATS, *verb], capture_output=True, text=True, check=True).stdout.splitlines()
    assert max(map(len, piped)) > 100
    assert letters(shown) >= letters(piped)  # row names repeat where columns continue below


def letters(lines):
    """Count the letters of a table without its rule, because the rule is as long as the table is wide."""
    return Counter("".join("".join(lines).split()).replace("─", ""))
