"""The prompt's listing in a LaTeX source is identified and returned unchanged."""

import pytest

from dronecats.agent.prompt import prompt_listing
from foundation.errors import UsageError

TEMPLATE = """You fly.  Two spaces, a \\backslash, 50% and a {"action":"think"}.

Command: {instruction}
  [indented] {point_fmt}
{history}
"""
REQUEST = '{\n  "model": "<P_t>"\n}\n'


def listing(text, options=""):
    return f"\\begin{{lstlisting}}{options}\n{text}\\end{{lstlisting}}\n"


def paper(*listings):
    return "\\documentclass{article}\n\\begin{document}\n" + "Words.\n".join(listings) + "\\end{document}\n"


@pytest.mark.parametrize(
    "options",
    ["", "[style=promptstyle]", "[caption={Braces around \\texttt{action} are [literal] JSON.}, label={lst:prompt}]"],
)
def test_the_listing_with_the_prompts_fields_is_returned_unchanged(options):
    source = paper(listing(REQUEST), listing(TEMPLATE, options), listing(REQUEST))
    assert prompt_listing(source, "paper.tex") == TEMPLATE


def test_other_verbatim_environments_and_line_ends_are_read():
    source = paper(f"\\begin{{verbatim}}\n{TEMPLATE}\\end{{verbatim}}\n").replace("\n", "\r\n")
    assert prompt_listing(source, "paper.tex") == TEMPLATE


def test_a_commented_listing_is_ignored():
    commented = "".join(f"% {line}\n" for line in listing(TEMPLATE).splitlines())
    assert prompt_listing(paper(commented, listing(TEMPLATE)), "paper.tex") == TEMPLATE


@pytest.mark.parametrize(
    ("listings", "words"),
    [
        ([], "no listing"),
        ([REQUEST], "{instruction}"),
        ([TEMPLATE.replace("{history}", "")], "{history}"),
        ([TEMPLATE, TEMPLATE.replace("fly", "hover")], "2 listings"),
        ([TEMPLATE.replace("{point_fmt}", "{point_format}")], "point_fmt"),
    ],
)
def test_a_source_without_exactly_one_prompt_is_rejected(listings, words):
    with pytest.raises(UsageError) as refused:
        prompt_listing(paper(*map(listing, listings)), "paper.tex")
    assert words in str(refused.value)
    assert "paper.tex" in str(refused.value)
