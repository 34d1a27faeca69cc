"""Airframes by name or by file: TOML in, a checked `Airframe` out."""

import difflib
import math
import tomllib
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any

from foundation.airframe import Airframe, Battery, Rotor, RotorCurve
from foundation.errors import UsageError
from foundation.frames import GRAVITY, Vec3
from foundation.sensors import MAX_ROTORS

MAX_CONTACTS = 16  # what the compiled records hold

_FOLDER = Path(__file__).parent / "airframes"
_VECTORS = ("position_frd", "inertia_frd", "drag_linear_frd", "drag_quadratic_frd")
_MAY_BE_ZERO = (
    "speed_idle",
    "drag_coefficient",
    "rotating_kg",
    "avionics_w",
    "resistance_ohm",
    "drag_linear_frd",
    "drag_quadratic_frd",
)
PX4_ROTORS = 4  # of PX4's airframe none_iris


def names() -> list[str]:
    """Return the names of the airframes that come with the project, sorted."""
    return sorted(path.stem for path in _FOLDER.glob("*.toml"))


def load(name_or_path: str) -> Airframe:
    """Return the airframe of that name, or of that TOML file when the text ends in `.toml`.

    Raises UsageError when there is none, or when the file does not describe an aircraft that can hover.
    """
    if name_or_path.endswith(".toml"):
        path = Path(name_or_path)
        if not path.is_file():
            raise UsageError(
                f"airframe file {name_or_path} does not exist: give an existing file or one of {', '.join(names())}"
            )
    else:
        path = _FOLDER / f"{name_or_path}.toml"
        if name_or_path not in names():
            near = difflib.get_close_matches(name_or_path, names(), n=2, cutoff=0.4)
            hint = f"did you mean {' or '.join(near)}" if near else f"choose one of {', '.join(names())}"
            raise UsageError(f"airframe '{name_or_path}' is unknown: {hint}, or give the path of a .toml file")
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, OSError) as error:
        raise UsageError(f"airframe file {path.name} cannot be read as TOML: {error}") from error
    return parse(table, path.stem)


def quadrotor(airframe: Airframe) -> Airframe:
    """Return an airframe of four rotors: PX4's simulated one (`none_iris`) mixes for four. Raises UsageError."""
    if len(airframe.rotors) != PX4_ROTORS:
        raise UsageError(
            f"PX4 flies quadrotors here, and {airframe.name} has {len(airframe.rotors)} rotors; choose another"
        )
    return airframe


def parse(table: dict[str, Any], name: str) -> Airframe:
    """Return the airframe that a parsed TOML table describes. Raises UsageError naming the field and the reason."""
    table = dict(table)
    rotors = table.pop("rotors", None)
    curve = table.pop("curve", None)
    battery = table.pop("battery", None)
    contacts = table.pop("contact_points_frd", None)
    if not isinstance(rotors, list) or not 3 <= len(rotors) <= MAX_ROTORS:
        raise _bad(name, "rotors", f"must be 3 to {MAX_ROTORS} [[rotors]] tables")
    if not isinstance(contacts, list) or not 3 <= len(contacts) <= MAX_CONTACTS:
        raise _bad(name, "contact_points_frd", f"must be a list of 3 to {MAX_CONTACTS} points")
    airframe = Airframe(
        name=name,
        rotors=tuple(Rotor(**_checked(Rotor, rotor, name, f"rotors[{i}].")) for i, rotor in enumerate(rotors)),
        curve=RotorCurve(**_checked(RotorCurve, curve, name, "curve.")),
        battery=Battery(**_checked(Battery, battery, name, "battery.")),
        contact_points_frd=tuple(_vector(p, name, f"contact_points_frd[{i}]") for i, p in enumerate(contacts)),
        **_checked(Airframe, table, name, "", ("name", "rotors", "curve", "battery", "contact_points_frd")),
    )
    if any(rotor.spin not in (-1, 1) for rotor in airframe.rotors):
        raise _bad(name, "rotors.spin", "must be +1 (counter-clockwise seen from above) or -1")
    if airframe.curve.speed_idle >= airframe.curve.speed_max:
        raise _bad(name, "curve.speed_idle", "must be below curve.speed_max")
    if airframe.thrust_max <= airframe.mass_kg * GRAVITY:
        raise _bad(name, "curve.thrust_coefficient", "gives less thrust at full speed than the weight needs")
    return airframe


def _checked(kind: type, table: object, name: str, where: str, given: tuple[str, ...] = ()) -> dict[str, Any]:
    """Return the keyword arguments of the dataclass `kind`, each of the right type and range."""
    if not isinstance(table, dict):
        raise _bad(name, where.rstrip("."), "is missing or is not a table")
    known = {f.name: f for f in fields(kind) if f.name not in given}
    for key in table:
        if key not in known:
            raise _bad(name, where + key, f"is not a field (known: {', '.join(known)})")
    result: dict[str, Any] = {}
    for key, field in known.items():
        if key not in table:
            if field.default is MISSING:
                raise _bad(name, where + key, "is missing")
            continue
        value = table[key]
        if key in _VECTORS:
            result[key] = _vector(value, name, where + key)
            numbers = () if key == "position_frd" else result[key]
        elif field.type in (int, "int"):
            if type(value) is not int:
                raise _bad(name, where + key, "must be a whole number")
            result[key] = value
            numbers = () if key == "spin" else (value,)
        else:
            result[key] = _number(value, name, where + key)
            numbers = (result[key],)
        if any(n < 0.0 or (n == 0.0 and key not in _MAY_BE_ZERO) for n in numbers):
            raise _bad(name, where + key, "must be positive")
    return result


def _number(value: object, name: str, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise _bad(name, where, "must be a finite number")
    return float(value)


def _vector(value: object, name: str, where: str) -> Vec3:
    if not isinstance(value, list) or len(value) != 3:
        raise _bad(name, where, "must be three numbers")
    return (_number(value[0], name, where), _number(value[1], name, where), _number(value[2], name, where))


def _bad(name: str, field: str, reason: str) -> UsageError:
    return UsageError(f"airframe '{name}': {field} {reason}")
