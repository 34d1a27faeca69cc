"""Optics from a TOML file: docs/cameras.md."""

import dataclasses
import difflib
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from episodes.camera.optics.options import Exposure, Haze, LensModel, Optics, Rain, Sensor, SunPlace
from foundation.camera import CameraModel
from foundation.errors import UsageError
from foundation.frames import Vec3

SECTIONS: dict[str, type] = {
    "lens": LensModel,
    "sensor": Sensor,
    "exposure": Exposure,
    "sun": SunPlace,
    "haze": Haze,
    "rain": Rain,
}
SEED_MAX = 2**31 - 1
BYTES_MAX = 64_000  # of a file: a hundred times what all options take
VECTORS = {"color": (0.0, 2.0), "wind_ned": (-40.0, 40.0)}  # key → range of each component


def load(path: Path) -> Optics:
    """Return the options of a TOML file. Raises UsageError, one sentence with file, key and reason."""
    try:
        with path.open("rb") as file:
            data = file.read(BYTES_MAX + 1)
        if len(data) > BYTES_MAX:
            raise UsageError(f"--optics {path} is longer than {BYTES_MAX} bytes, so it is no file of camera options")
        table = tomllib.loads(data.decode("utf-8"))
    except OSError as error:
        raise UsageError(f"--optics {path} cannot be read: {error.strerror}; see docs/cameras.md") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        reason = str(error).splitlines()[0] if str(error) else "it is nested too deeply"
        raise UsageError(f"--optics {path} is not TOML: {reason}") from None
    return optics_of(table, f"--optics {path}")


def optics_of(table: Mapping[str, Any], where: str) -> Optics:
    """Return the options that a table spells out, `where` naming it in errors. Raises UsageError."""
    parts: dict[str, Any] = {}
    for name, value in table.items():
        if name == "seed":
            if type(value) is not int or not 0 <= value <= SEED_MAX:
                raise UsageError(f"{where}: seed must be a whole number from 0 to {SEED_MAX}")
            parts[name] = value
        elif name not in SECTIONS:
            raise UsageError(f"{where}: there is no '{name[:40]}'{_near(name, [*SECTIONS, 'seed'])}")
        elif not isinstance(value, Mapping):
            raise UsageError(f"{where}: {name} must be a section, [{name}]")
        else:
            parts[name] = _section(name, value, where)
    optics = Optics(**parts)
    _check(optics, where)
    return optics


def _section(name: str, table: Mapping[str, Any], where: str) -> Any:
    kind = SECTIONS[name]
    fields = {f.name: f for f in dataclasses.fields(kind)}
    values: dict[str, Any] = {}
    for key, value in table.items():
        if key not in fields:
            raise UsageError(f"{where}: [{name}] has no '{key[:40]}'{_near(key, list(fields))}")
        if key in VECTORS:
            values[key] = _vector(value, *VECTORS[key], f"{where}: [{name}] {key}")
        else:
            low, high = fields[key].metadata["range"]
            values[key] = _number(value, fields[key].type is int, low, high, f"{where}: [{name}] {key}")
    return kind(**values)


def _number(value: Any, whole: bool, low: float, high: float, what: str) -> float | int:
    kinds: tuple[type, ...] = (int,) if whole else (int, float)
    if type(value) not in kinds or not low <= value <= high:
        raise UsageError(f"{what} must be a {'whole ' if whole else ''}number from {low:g} to {high:g}")
    return int(value) if whole else float(value)


def _vector(value: Any, low: float, high: float, what: str) -> Vec3:
    if not isinstance(value, list) or len(value) != 3:
        raise UsageError(f"{what} must be a list of three numbers")
    a, b, c = (float(_number(v, False, low, high, f"{what}: each")) for v in value)
    return (a, b, c)


def _check(optics: Optics, where: str) -> None:
    """Raise UsageError for numbers that are fine alone but make no picture together."""
    if optics.sun is None and optics.lens is None:
        return
    from episodes.camera.optics.lens import wide_camera  # these two load the renderer, which most commands do without
    from episodes.camera.optics.weather import toward_sun

    try:
        if optics.sun is not None:
            toward_sun(optics.sun)
        if optics.lens is not None:
            wide_camera(optics.lens, CameraModel())
    except ValueError as error:
        raise UsageError(f"{where}: {error}") from None


def _near(name: str, known: list[str]) -> str:
    near = difflib.get_close_matches(name, known, 1, 0.5)
    return f"; did you mean '{near[0]}'?" if near else f"; there are {', '.join(known)}"
