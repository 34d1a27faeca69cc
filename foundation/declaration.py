"""Declares the numbers that users set. The metadata of a dataclass field holds its declaration.

    loss: float = number(0.0, "loss", "share of frames that never arrive", high=1.0, words="{percent:g} % lost")

The declaration is the only source of a value's bounds, error messages, command-line option, row in the docs, use as a
factor of a study, and sentence (`words`).
"""

import sys
from collections.abc import Callable, Iterator
from dataclasses import Field, dataclass, field, fields
from typing import Any, TypeVar

from foundation.errors import UsageError

T = TypeVar("T")
KEY = "declaration"  # key in a field's metadata
ABOVE_0 = sys.float_info.min  # the lower bound of a number that must not be 0


def shown(bound: float) -> str:
    """Return a bound as text: 0.0033, 0.95, 100,000,000."""
    return f"{bound:,.15g}" if abs(bound) >= 1.0 else f"{bound:.2g}"


@dataclass(frozen=True, slots=True, kw_only=True)
class DeclaredNumber:
    """Name, meaning, unit and bounds of a number."""

    name: str  # in options, files, studies and errors: "frame_delay"
    help: str  # meaning of the number, one line
    low: float = 0.0
    high: float
    unit: str = ""  # "s", "m/s" …; "": no unit, such as a share
    whole: bool = False  # whole numbers only

    @property
    def wanted(self) -> str:
        """The allowed numbers in words: "a number from 0 to 60 s"."""
        low = "above 0, at most" if self.low == ABOVE_0 else f"from {shown(self.low)} to"
        return (
            f"a {'whole ' if self.whole else ''}number {low} {shown(self.high)}{f' {self.unit}' if self.unit else ''}"
        )

    def read(self, value: object) -> float:
        """Return `value`, a number or its text, as a number. Raises UsageError if it is no number or out of bounds."""
        try:
            number = float(value) if isinstance(value, int | float | str) and not isinstance(value, bool) else None
        except (ValueError, OverflowError):
            number = None
        if number is None or not self.low <= number <= self.high or (self.whole and number != int(number)):
            got = f"{value:g}" if isinstance(value, float) else f"{value!r:.60}"
            raise UsageError(f"{self.name} must be {self.wanted}, got {got}")
        return int(number) if self.whole else number


@dataclass(frozen=True, slots=True, kw_only=True)
class Declaration:
    """The metadata of a declared field."""

    quantity: DeclaredNumber | None = None  # None: the value is checked elsewhere
    size: Callable[[Any], float] = float  # value → the number to check, such as the speed of a wind vector
    # sentence about a value that is not the default: a function, or a format with {value}, {percent} or {owner}
    words: str | Callable[[Any], str] = ""
    first: bool = False  # whether `words_of` puts this sentence before those without `first`


def declared(default: T, declaration: Declaration) -> T:
    """Return a dataclass field with this default and declaration."""
    return field(default=default, metadata={KEY: declaration})


def number(default: T, name: str, help: str, *, words: str = "", first: bool = False, **bounds: Any) -> T:
    """Return a declared field of one number; `bounds`: the other fields of `DeclaredNumber`."""
    quantity = DeclaredNumber(name=name, help=help, **bounds)
    return declared(default, Declaration(quantity=quantity, words=words, first=first))


def declarations(owner: type) -> dict[str, Any]:
    """Return the declaration of each declared field of a dataclass, by the field's name."""
    return {entry.name: entry.metadata[KEY] for entry in _declared_fields(owner)}


def check_bounds(owner: Any) -> None:
    """Raise UsageError if a declared value of a dataclass is out of bounds. None is allowed."""
    for name, declaration in declarations(type(owner)).items():
        value = getattr(owner, name)
        if declaration.quantity is not None and value is not None:
            declaration.quantity.read(declaration.size(value))


def words_of(owner: Any) -> Iterator[str]:
    """Yield the sentence (`words`) about each declared value of a dataclass that differs from its default."""
    for entry in sorted(_declared_fields(type(owner)), key=lambda entry: not entry.metadata[KEY].first):
        value, words = getattr(owner, entry.name), entry.metadata[KEY].words
        if value == entry.default or not words:
            continue
        if callable(words):
            yield words(value)
        else:
            yield words.format(value=value, percent=100 * value, owner=owner)


def _declared_fields(owner: type) -> list[Field[Any]]:
    return [candidate for candidate in fields(owner) if KEY in candidate.metadata]
