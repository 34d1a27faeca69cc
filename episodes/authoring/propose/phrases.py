"""The words of an instruction: verbs of each cell around what the target is called."""

import random

from episodes.authoring.check.nouns import nouns

VERBS: dict[str, tuple[str, ...]] = {
    "approaching": (
        "go to {what}", "fly to {what}", "approach {what}", "head over to {what}", "move up to {what}",
        "fly over to {what}",
    ),
    "searching": (
        "find {what} and go to {it}", "look for {what} and fly to {it}", "search for {what} and approach {it}",
        "locate {what} and go there", "find {what} and fly up to {it}",
    ),
    "tracking": (
        "follow {what} and get close to {it}", "catch up with {what}", "go after {what} and close in on {it}",
        "fly after {what} and reach {it}", "track {what} and come close to {it}",
    ),
    "search-and-track": (
        "find {what} and catch up with {it}", "look for {what} and follow {it} until you reach {it}",
        "search for {what} and close in on {it}", "locate {what}, go after {it} and reach {it}",
    ),
    "commanding": (
        "go to {what}", "fly to {what}", "find {what} and go to it", "approach {what}", "send a drone to {what}",
    ),
}  # fmt: skip
PEOPLE = ("person", "pedestrian", "cyclist")


def instruction(cell: str, named: str, asset: str, rng: random.Random) -> str:
    """Return an instruction of a cell for a target that is called `named`, article included."""
    return rng.choice(VERBS[cell]).format(what=named, it="them" if asset in PEOPLE else "it")


def painted(asset: str, paint: str) -> str:
    """Return what a placed target is called on a map where its colour is its own."""
    return f"the {paint} {nouns(asset)[0]}"


def inscribed(asset: str, text: str, rng: random.Random) -> str:
    """Return what a candidate is called by its inscription."""
    if asset == "sign":
        return rng.choice((f"the sign that reads {text}", f"the sign saying {text}", f"the sign marked {text}"))
    noun = nouns(asset)[0]
    return rng.choice(
        (
            f"the {noun} with the licence plate {text}",
            f"the {noun} whose plate reads {text}",
            f"the {noun} with number plate {text}",
        )
    )


def plates(count: int, rng: random.Random) -> list[str]:
    """Return so many plates that differ in a digit or two, so that each has to be read to its end."""
    base = [rng.randrange(1, 10) for _ in range(4)]
    found: list[str] = []
    while len(found) < count:
        digits = list(base)
        for place in rng.sample(range(4), 2):
            digits[place] = rng.randrange(1, 10)
        text = "".join(map(str, digits))
        if text not in found:
            found.append(text)
    return found


BOARDS = (
    ("DOCK A", "DOCK B", "DOCK C", "DOCK D"),
    ("GATE 3", "GATE 5", "GATE 8", "GATE 9"),
    ("BAY 12", "BAY 17", "BAY 21", "BAY 71"),
    ("NORTH", "SOUTH", "EAST", "WEST"),
    ("STORE", "STAGE", "STAIR", "START"),
    ("LANE 2", "LANE 4", "LANE 6", "LANE 7"),
    ("ZONE K", "ZONE M", "ZONE N", "ZONE R"),
    ("PUMP", "PORT", "POST", "PARK"),
    ("HALL 1", "HALL 4", "HALL 7", "HALL 9"),
    ("UNIT 38", "UNIT 58", "UNIT 83", "UNIT 85"),
)
