"""A stored verdict beside one derived anew."""

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

SAME = 1.001e-3  # seconds, metres: numbers are rounded to a thousandth, whose last digit a rounding may turn
EXPLANATIONS = ("error", "note")  # sentences, whose words may be others in another version
CORE = ("outcome", "success", "ne_m", "delta_m", "steps", "declarations", "deciding")  # what every version stored


@dataclass(frozen=True, slots=True)
class Comparison:
    """What verdict.json says beside what the logs say."""

    differing: tuple[str, ...]  # the names of what differs, as in "diagnostics.dwell_s"
    older: bool  # an older version stored it, which knew less: only CORE is compared
    damaged: bool = False  # it is half a file, or none of ours

    @property
    def agrees(self) -> bool:
        """Whether nothing differs."""
        return not self.differing and not self.damaged


def compare(stored: Mapping[str, Any], derived: Mapping[str, Any]) -> Comparison:
    """Return how two verdicts at one radius compare. What an older version did not store cannot differ."""
    told = json.dumps(derived)
    if json.dumps(stored) == told:
        return Comparison((), older=False)
    now = json.loads(told)
    older = any(name not in stored for name in now)
    names = CORE if older else tuple(dict.fromkeys([*now, *stored]))
    return Comparison(tuple(d for name in names for d in _differing(name, stored.get(name), now.get(name))), older)


def _differing(name: str, a: Any, b: Any) -> Iterator[str]:
    if isinstance(a, dict) and isinstance(b, dict):
        for key in dict.fromkeys([*a, *b]):
            yield from _differing(f"{name}.{key}", a.get(key), b.get(key))
    elif isinstance(a, list) and isinstance(b, list) and len(a) == len(b):
        for k, (one, other) in enumerate(zip(a, b, strict=True)):
            yield from _differing(f"{name}[{k}]", one, other)
    elif name in EXPLANATIONS:
        if (a is None) != (b is None):
            yield name
    elif _is_number(a) and _is_number(b):
        if not math.isclose(a, b, rel_tol=0.0, abs_tol=SAME):
            yield name
    elif type(a) is not type(b) or a != b:
        yield name


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
