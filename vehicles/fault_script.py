"""A fault script as a TOML file: which part of the vehicle breaks, how, and from when until when."""

import tomllib
from pathlib import Path
from typing import Any

from foundation.errors import UsageError
from foundation.frames import Vec3
from vehicles.faults import Fault, script
from vehicles.records import MAX_FAULTS
from vehicles.sensors import Suite

KEYS = ("part", "kind", "from_s", "until_s", "value")
LONGEST_S = 1e9  # thirty years; keeps the times within what the record's integers hold


def load(path: Path, rotors: int, suite: Suite | None = None) -> list[Fault]:
    """Return the faults of a file, in its order, for a vehicle with so many rotors and these sensors.

    The file is a list of `[[fault]]` tables: part and kind as in `vehicles.faults`, from_s and until_s in vehicle
    seconds since boot (left out: from boot, for ever), value a number or three, as the kind asks for. Raises UsageError
    that names the file, the entry and the reason.
    """
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise UsageError(f"fault script {path} does not exist: give the path of a TOML file") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, OSError) as error:
        raise UsageError(f"fault script {path} cannot be read as TOML: {error}") from error
    return parse(table, path.name, rotors, suite)


def parse(table: dict[str, Any], name: str, rotors: int, suite: Suite | None = None) -> list[Fault]:
    """Return the faults that a parsed TOML table lists; `name` stands for it in errors. Raises UsageError."""
    suite = suite or Suite()
    entries = table.get("fault", [])
    unknown = [key for key in table if key != "fault"]
    if unknown or not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        what = f"'{unknown[0]}' is unknown" if unknown else "'fault' is no list of tables"
        raise UsageError(f"fault script {name}: {what}; a script is made of [[fault]] tables only")
    if len(entries) > MAX_FAULTS:
        raise UsageError(f"fault script {name}: it lists {len(entries)} faults, and at most {MAX_FAULTS} are possible")
    faults = []
    for number, entry in enumerate(entries, 1):
        where = f"fault script {name}, entry {number}"
        fault = _fault(entry, where)
        try:
            script([fault], rotors, suite.gps_period_us, suite.gps_age_us)
        except UsageError as error:
            raise UsageError(f"{where}: {error}") from None
        faults.append(fault)
    return faults


def _fault(entry: dict[str, Any], where: str) -> Fault:
    for key in entry:
        if key not in KEYS:
            raise UsageError(f"{where}: '{key}' is unknown; choose from {', '.join(KEYS)}")
    for key in ("part", "kind"):
        if not isinstance(entry.get(key), str):
            raise UsageError(f"{where}: '{key}' must be given as text")
    times = {f"{key}_us": _microseconds(entry, f"{key}_s", where) for key in ("from", "until") if f"{key}_s" in entry}
    needs_value = entry["kind"] in ("bias", "delay", "weaken")
    if needs_value and "value" not in entry:
        raise UsageError(f"{where}: a fault of kind {entry['kind']} needs a 'value'")
    if not needs_value and "value" in entry:
        raise UsageError(f"{where}: a fault of kind {entry['kind']} takes no 'value'")
    value = _vector(entry["value"], where) if needs_value else (0.0, 0.0, 0.0)
    return Fault(entry["part"], entry["kind"], **times, value=value)


def _microseconds(entry: dict[str, Any], key: str, where: str) -> int:
    seconds: float = entry[key]
    if not _is_number(seconds) or not 0.0 <= seconds <= LONGEST_S:
        raise UsageError(f"{where}: '{key}' must be a number of seconds since boot, 0 or more, not {seconds!r}")
    return round(float(seconds) * 1e6)


def _vector(value: Any, where: str) -> Vec3:
    if _is_number(value):
        return (float(value), 0.0, 0.0)
    if isinstance(value, list) and len(value) == 3 and all(_is_number(x) for x in value):
        return (float(value[0]), float(value[1]), float(value[2]))
    raise UsageError(f"{where}: 'value' must be a finite number or a list of three, not {value!r}")


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e12  # nan is not
