"""Writes the reference of the commands: one page for each verb, from its argument parsers."""

import argparse
import re
from collections.abc import Iterator

from dronecats.cli.main import VERBS, VerbParser, command_parser

MARKUP = re.compile(r"([\\*_<>\[\]{}|~$])")  # characters with a meaning in Markdown
CODE = re.compile(r"(`[^`]+`)")
PAGE = re.compile(r"\bdocs/[\w/-]+\.md")


def part() -> dict[str, Iterator[str]]:
    """Return the lines of each page, by page name."""
    return {"index": first_page(), **{verb: verb_page(verb) for verb in VERBS}}


def first_page() -> Iterator[str]:
    """Yield the lines of the page with all verbs."""
    yield from ("# Commands", "", "Each verb has a page with its options and examples.", "")
    yield from ("| command | what it does |", "| --- | --- |")
    yield from (f"| [`dronecats {verb}`]({verb}.md) | {markdown(text)} |" for verb, text in VERBS.items())
    yield from ("", "```{toctree}", ":hidden:", "", *VERBS, "```", "")


def verb_page(verb: str) -> Iterator[str]:
    parser = subparsers(command_parser(verb))[verb]
    yield from _section(parser, 1)
    for action in subparsers(parser).values():
        yield from _section(action, 2)


def subparsers(parser: argparse.ArgumentParser) -> dict[str, VerbParser]:
    """Return the subparsers of a parser, by name."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            return dict(action.choices)
    return {}


def _section(parser: VerbParser, level: int) -> Iterator[str]:
    """Yield the lines about one parser: usage, options, examples. `level`: level of the heading."""
    marks = "#" * level
    yield from (f"{marks} {parser.prog}", "", markdown(parser.description or ""), "")
    usage = re.sub(r"\n +", "\n    ", parser.format_usage().removeprefix("usage: "))
    yield from ("```text", usage.rstrip(), "```", "")
    if actions := subparsers(parser):
        yield from ("| action | what it does |", "| --- | --- |")
        for name, action in actions.items():
            yield f"| [`{name}`](#{action.prog.replace(' ', '-')}) | {markdown(action.description or '')} |"
        yield ""
    yield from ("```{program} " + parser.prog, "```", "")
    for group in parser._action_groups:
        options = [action for action in group._group_actions if _is_listed(action)]
        if options:
            yield from (f"**{markdown((group.title or '').capitalize())}**", "")
        for option in options:
            yield from _option(parser, option)
    if examples := parser.examples():
        yield from ("**Examples**", "", "```sh", *examples, "```", "")


def _is_listed(action: argparse.Action) -> bool:
    hidden = action.help == argparse.SUPPRESS or "--help" in action.option_strings
    return not hidden and not isinstance(action, argparse._SubParsersAction)


def _option(parser: VerbParser, action: argparse.Action) -> Iterator[str]:
    """Yield the entry of one option or argument."""
    formatter = parser._get_formatter()
    text = formatter._expand_help(action) if action.help else ""
    yield from ("```{option} " + formatter._format_action_invocation(action), markdown(text), "```", "")


def markdown(text: str) -> str:
    """Return a help text as Markdown, with links to the pages that it names."""
    parts = CODE.split(" ".join(text.split()))
    return "".join(part if CODE.fullmatch(part) else _linked(MARKUP.sub(r"\\\1", part)) for part in parts)


def _linked(text: str) -> str:
    return PAGE.sub(lambda found: f"[{found[0]}](../{found[0]})", text)
