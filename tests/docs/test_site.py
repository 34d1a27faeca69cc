"""The pages that `make docs` generates from the repository as the input of Sphinx."""

import re
from importlib.util import find_spec
from pathlib import PurePosixPath

import pytest

from docs.website import api, commands, pages
from docs.website.api import preformatted
from docs.website.pages import ROOT
from dronecats.cli.main import VERBS, command_parser

PAGE = PurePosixPath("docs/sitl.md")


@pytest.mark.parametrize(
    ("link", "relinked"),
    [
        ("[a page](models.md#the-prompt)", "[a page](models.md#the-prompt)"),
        ("[an index](studies/README.md)", "[an index](studies/index.md)"),
        ("[the front](../README.md#cite)", "[the front](../index.md#cite)"),
        ("[a file](../examples/mavsdk4.py)", "[a file](../files/examples/mavsdk4.py.md)"),
        ("[a folder](../vehicles/airframes)", "[a folder](../files/vehicles/airframes.md)"),
        ("![a picture](pictures/flight.png)", "![a picture](pictures/flight.png)"),
        ("[elsewhere](https://px4.io/README.md)", "[elsewhere](https://px4.io/README.md)"),
        ("[here](#heading)", "[here](#heading)"),
        ("[not there](nowhere.toml)", "[not there](nowhere.toml)"),  # Sphinx reports it
    ],
)
def test_repository_links_become_site_links(link, relinked):
    shown: set[PurePosixPath] = set()
    assert pages.relinked(link, PAGE, shown) == relinked
    assert len(shown) == ("files/" in relinked)


def test_code_blocks_keep_their_text():
    text = "a\n```\na\n```\na\n```sh\na\n```\n"
    assert pages.outside_fences(text, str.upper) == "A\n```\na\n```\nA\n```sh\na\n```\n"


def test_the_navigation_follows_the_docs_index():
    navigation = pages.navigation(["commands/index"])
    index = (ROOT / pages.INDEX).read_text(encoding="utf-8")
    assert [
        heading for heading in re.findall("^## (.+)$", index, re.M) if f":caption: {heading}\n" not in navigation
    ] == []
    assert "\nTutorial <docs/tutorial>\n" in navigation
    assert "\nAll pages <docs/index>\n" in navigation
    assert navigation.endswith(":caption: Reference\ncommands/index\n```\n")


@pytest.mark.parametrize("verb", VERBS)
def test_the_page_of_a_command_has_all_options_and_examples_of_its_help(verb):
    page = "\n".join(commands.verb_page(verb))
    parser = commands.subparsers(command_parser(verb))[verb]
    for each in (parser, *commands.subparsers(parser).values()):
        section = page[page.index(f"# {each.prog}\n") :]
        flags = set(re.findall(r"^ {2}(--[\w-]+)", each.format_help(), re.M)) - {"--help"}
        assert flags <= set(re.findall(r"(--[\w-]+)", "".join(re.findall(r"^```\{option\}.*$", section, re.M))))
        assert [line for line in each.examples() if line not in section] == []


def test_the_command_overview_links_every_command():
    text = "\n".join(commands.first_page())
    assert [verb for verb in VERBS if f"({verb}.md)" not in text or f"\n{verb}\n" not in text] == []


def test_the_documented_modules_exist():
    assert [module for module in api.MODULES if find_spec(module) is None] == []


@pytest.mark.parametrize(
    ("text", "markdown"),
    [
        ("a * b_c <d>", r"a \* b\_c \<d\>"),
        ("as `a_b*` does", "as `a_b*` does"),
        ("see docs/run-folder.md", "see [docs/run-folder.md](../docs/run-folder.md)"),
    ],
)
def test_help_becomes_markdown(text, markdown):
    assert commands.markdown(text) == markdown


def test_a_table_in_a_docstring_keeps_its_lines():
    assert preformatted(["Of *all*, `a*`, MPC_ parameters:", "    x   east", "    y   north", "After it."]) == [
        r"Of \*all\*, `a*`, MPC\_ parameters:", "", "::", "", "    x   east", "    y   north", "", "After it.",
    ]  # fmt: skip
