"""Which of several things that look alike is meant, in words: said by a scripted commander, read by built-in pilots."""

import re

ORDINALS = ("first", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth")
_PLACE = re.compile(rf"look at the ({'|'.join(ORDINALS)}) one from the left\b", re.IGNORECASE)


def goal(command: str, place: int) -> str:
    """Return a command narrowed to one of those that look alike, counted from 1 at the left as they are seen first."""
    return f"{command}: look at the {ORDINALS[place - 1]} one from the left"


def told(command: str) -> int | None:
    """Return the place that a command is narrowed to, None where it is not."""
    found = _PLACE.search(command)
    return ORDINALS.index(found[1].lower()) + 1 if found else None
