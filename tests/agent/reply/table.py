"""The table of replies with the expected result of each parser."""

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dronecats.agent.action import AxisOrder
from dronecats.agent.reply.mends import Mend, in_order
from dronecats.agent.reply.reading import Reading

FILE = Path(__file__).with_name("replies.toml")


@dataclass(frozen=True)
class Row:
    """One reply."""

    place: int
    family: str
    text: str
    drones: int
    axis_order: AxisOrder
    strict: tuple[str, ...]  # per drone: the action as text, or ! and a part of the error
    lenient: tuple[str, ...]
    mended: tuple[tuple[Mend, ...], ...]  # per drone

    def __str__(self) -> str:
        return f"{self.place} {self.family}"


def rows() -> list[Row]:
    """Return the rows of the table."""
    return [_row(place, entry) for place, entry in enumerate(tomllib.loads(FILE.read_text(encoding="utf-8"))["reply"])]


def _row(place: int, entry: dict[str, Any]) -> Row:
    drones = entry.get("drones", 1)

    def per_drone(key: str, default: Any) -> tuple[str, ...]:
        value = entry.get(key, default)
        return (value,) * drones if isinstance(value, str) else tuple(value)

    strict = per_drone("strict", None)
    mended: Any = [in_order(codes.split()) for codes in per_drone("mended", "")]  # type: ignore[arg-type]
    return Row(place, entry["family"], entry["text"], drones, entry.get("axis_order", "xy"), strict,
               per_drone("lenient", strict), tuple(mended))  # fmt: skip


def words(read: Reading) -> str:
    """Return a reading in the table's notation."""
    if read.action is None:
        return f"! {read.error}"
    kind, *numbers = read.action.as_json().values()
    flat = [n for value in numbers for n in (value if isinstance(value, list) else [value])]
    return " ".join([kind, *(f"{n:.9g}" for n in flat)])


def agrees(read: Reading, expected: str) -> bool:
    """Whether a reading equals the table's entry."""
    if expected.startswith("!"):
        return read.action is None and expected[1:].strip() in (read.error or "")
    return words(read) == expected
