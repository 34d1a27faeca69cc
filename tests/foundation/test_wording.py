"""Wording of messages: numbers with their nouns, and suggestions for a mistyped name."""

import pytest

from foundation.wording import counted, nearest


@pytest.mark.parametrize(
    ("count", "words"),
    [(0, "0 declarations"), (1, "1 declaration"), (2, "2 declarations"), (1200, "1,200 declarations")],
)
def test_a_number_and_its_noun_agree(count, words):
    assert counted(count, "declaration") == words


def test_an_irregular_plural_can_be_passed():
    assert [counted(n, "retry", "retries") for n in (1, 2)] == ["1 retry", "2 retries"]


@pytest.mark.parametrize(
    ("word", "names", "near"),
    [
        ("gpt6", ("gpt-5", "gpt-6-luna", "gpt-6.2-sol", "gemini-3"), ["gpt-6-luna", "gpt-6.2-sol"]),  # family first
        ("GPT_5", ("gpt-5", "qwen3.5-4b"), ["gpt-5"]),
        ("flly", ("fly", "sitl", "film"), ["fly"]),
        ("zzz", ("fly", "sitl"), []),
        ("", ("fly", "sitl"), []),
    ],
)
def test_nearest_returns_the_most_similar_names(word, names, near):
    assert nearest(word, names, count=2)[: len(near)] == near
    assert bool(nearest(word, names)) is bool(near)
