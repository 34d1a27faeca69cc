"""The table of replies: what each parser reads in each."""

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
    strict: tuple[str, ...]  # per drone: an action's words, or ! and words of the reason
    lenient: tuple[str, ...]
    mended: tuple[tuple[Mend, ...], ...]  # per drone

    def __str__(self) -> str:
        return f"{self.place} {self.family}"


def rows() -> list[Row]:
    """Return the rows of the table."""
    return [_row(place, each) for place, each in enumerate(tomllib.loads(FILE.read_text(encoding="utf-8"))["reply"])]


def _row(place: int, each: dict[str, Any]) -> Row:
    drones = each.get("drones", 1)

    def per_drone(key: str, default: Any) -> tuple[str, ...]:
        value = each.get(key, default)
        return (value,) * drones if isinstance(value, str) else tuple(value)

    strict = per_drone("strict", None)
    mended: Any = [in_order(said.split()) for said in per_drone("mended", "")]  # type: ignore[arg-type]
    return Row(place, each["family"], each["text"], drones, each.get("axis_order", "xy"), strict,
               per_drone("lenient", strict), tuple(mended))  # fmt: skip


def words(read: Reading) -> str:
    """Return a reading as the table writes it."""
    if read.action is None:
        return f"! {read.error}"
    kind, *numbers = read.action.as_json().values()
    flat = [n for each in numbers for n in (each if isinstance(each, list) else [each])]
    return " ".join([kind, *(f"{n:.9g}" for n in flat)])


def agrees(read: Reading, expected: str) -> bool:
    """Whether a reading is what the table says."""
    if expected.startswith("!"):
        return read.action is None and expected[1:].strip() in (read.error or "")
    return words(read) == expected
