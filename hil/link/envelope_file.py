"""The safety envelope from a TOML file: the fields of `hil.link.envelope.Limits` by their names."""

import math
import tomllib
from dataclasses import fields
from pathlib import Path
from typing import Any

from foundation.errors import UsageError
from hil.link.envelope import Limits

NUMBERS = {field.name for field in fields(Limits)} - {"exclusions", "exclusions_geodetic"}
SIGNED = {"floor_m"}  # every other number is above 0
CORNERS_MIN = 3


def load(path: Path, base: Limits) -> Limits:
    """Return `base` with what the file says otherwise. Raises UsageError naming the file and the field."""
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise UsageError(f"--envelope {path} cannot be read: {error.strerror}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise UsageError(f"--envelope {path} is not TOML: {error}") from None
    values: dict[str, Any] = {name: getattr(base, name) for name in (field.name for field in fields(Limits))}
    for name, value in table.items():
        if name in NUMBERS:
            values[name] = _number(path, name, value)
        elif name in values:
            values[name] = _polygons(path, name, value)
        else:
            raise UsageError(f"--envelope {path}: '{name}' is no limit; there are {', '.join(sorted(values))}")
    limits = Limits(**values)
    if limits.floor_m + 2 * limits.height_margin_m >= limits.ceiling_m:
        raise UsageError(f"--envelope {path}: between floor_m and ceiling_m no room is left beside two height_margin_m")
    if limits.radius_m <= limits.margin_m:
        raise UsageError(f"--envelope {path}: radius_m leaves no room beside margin_m")
    return limits


def _number(path: Path, name: str, value: Any) -> float:
    good = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    if not good or (name not in SIGNED and value <= 0):
        raise UsageError(
            f"--envelope {path}: {name} wants a number{'' if name in SIGNED else ' above 0'}, got {value!r}"
        )
    return float(value)


def _polygons(path: Path, name: str, value: Any) -> tuple[tuple[tuple[float, float], ...], ...]:
    what = "latitude, longitude" if name.endswith("geodetic") else "north, east"
    try:
        polygons = tuple(tuple((float(a), float(b)) for a, b in polygon) for polygon in value)
    except (TypeError, ValueError):
        polygons = ((),)
    for polygon in polygons:
        if len(polygon) < CORNERS_MIN or not all(math.isfinite(x) for corner in polygon for x in corner):
            raise UsageError(f"--envelope {path}: {name} wants polygons of three or more corners [[{what}], …]")
    return polygons
