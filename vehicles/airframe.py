"""Loads and checks airframes, by name or from a TOML file, and adds payloads to them."""

import math
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

from foundation.airframe import Airframe
from foundation.errors import UsageError
from foundation.frames import GRAVITY
from foundation.typed_file import fields_of, toml_table, typed, unknown_key_message
from foundation.wording import suggestion

_FOLDER = Path(__file__).parent / "airframes"
ROUNDED = 0.01  # tolerance for rounded constants in files: a share for moments of inertia, rad for bearings of feet
PX4_ROTORS = 4  # rotors of PX4's airframe none_iris


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
                f"airframe file {name_or_path} does not exist. Give an existing file or one of {', '.join(names())}"
            )
    else:
        path = _FOLDER / f"{name_or_path}.toml"
        if name_or_path not in names():
            hint = suggestion(name_or_path, names(), count=2)
            raise UsageError(f"airframe '{name_or_path}' is not known: {hint} You can also give a .toml file")
    return parse(toml_table(path, f"airframe file {path.name}"), path.stem)


def require_quadrotor(airframe: Airframe) -> Airframe:
    """Return `airframe`. Raises UsageError unless it has four rotors, as PX4's simulated airframe (`none_iris`) has."""
    if len(airframe.rotors) != PX4_ROTORS:
        raise UsageError(
            f"PX4 flies only quadrotors here, but {airframe.name} has {len(airframe.rotors)} rotors. Choose"
            " another airframe"
        )
    return airframe


def parse(table: dict[str, Any], name: str) -> Airframe:
    """Return the airframe that a parsed TOML table describes. Raises UsageError naming the field and the reason."""
    where = f"airframe '{name}'"
    if "name" in table:  # the file's name is the airframe's name
        raise UsageError(
            f"{where}: 'name' {unknown_key_message('name', [key for key in fields_of(Airframe) if key != 'name'])}"
        )
    airframe = typed({**table, "name": name}, Airframe, where)
    if any(rotor.spin not in (-1, 1) for rotor in airframe.rotors):
        raise UsageError(f"{where}: rotors.spin must be +1 (counter-clockwise seen from above) or -1")
    if airframe.curve.speed_idle >= airframe.curve.speed_max:
        raise UsageError(f"{where}: curve.speed_idle must be below curve.speed_max")
    if airframe.thrust_max <= airframe.mass_kg * GRAVITY:
        raise UsageError(f"{where}: curve.thrust_coefficient gives less thrust at full speed than the weight needs")
    least, middle, largest = sorted(airframe.inertia_frd)
    if largest > (least + middle) * (1.0 + ROUNDED):
        raise UsageError(
            f"{where}: inertia_frd is impossible: in a rigid body no principal moment exceeds the sum of the other two,"
            f" but {largest:g} kg·m² exceeds {least:g} + {middle:g}. Correct the moments"
        )
    if not _stands(airframe):
        raise UsageError(
            f"{where}: contact_points_frd has no feet on which the vehicle stands. Place three or more points below the"
            " centre of mass (down above 0) and on all sides of it"
        )
    gimbal = airframe.camera.gimbal
    if gimbal is not None and not gimbal.pitch_min_deg <= airframe.camera.pitch_deg <= gimbal.pitch_max_deg:
        raise UsageError(
            f"{where}: camera.pitch_deg must be within camera.gimbal.pitch_min_deg … pitch_max_deg, which are"
            f" {gimbal.pitch_min_deg:g} … {gimbal.pitch_max_deg:g}"
        )
    return airframe


def _stands(airframe: Airframe) -> bool:
    """Return whether the feet (contact points below the centre of mass) surround the centre of mass."""
    feet = [(forward, right) for forward, right, down in airframe.contact_points_frd if down > 0.0]
    bearings = sorted(math.atan2(right, forward) for forward, right in feet if (forward, right) != (0.0, 0.0))
    if not bearings:
        return False
    turns = pairwise([*bearings, bearings[0] + 2.0 * math.pi])
    return all(later - earlier < math.pi - ROUNDED for earlier, later in turns)


HOVER_MAX = 0.8  # share of the full thrust; above it, too little thrust is left for control


def with_payload(airframe: Airframe, payload_kg: float) -> Airframe:
    """Return the airframe with `payload_kg` fixed halfway down its legs, where cameras and batteries hang.

    The payload is a point mass on the vertical axis. It adds to the weight and to the inertia of roll and pitch, not of
    yaw. Rotors and feet keep their places relative to the origin. The vertical shift of the centre of mass is
    neglected, because it does not change the moments of the rotors' thrust. Raises UsageError if the airframe would
    hover above HOVER_MAX of its thrust.
    """
    if payload_kg == 0.0:
        return airframe
    if payload_kg > (most_kg := max_payload_kg(airframe)):
        raise UsageError(
            f"airframe '{airframe.name}' cannot carry {payload_kg:g} kg: with more than {most_kg:.3g} kg it would hover"
            f" above {HOVER_MAX:.0%} of its thrust"
        )
    empty_kg = airframe.mass_kg
    below_m = airframe.standing_m / 2.0
    # inertia about the common centre of mass: reduced mass times the squared distance
    turned = payload_kg * empty_kg / (payload_kg + empty_kg) * below_m**2
    roll, pitch, yaw = airframe.inertia_frd
    return replace(airframe, mass_kg=empty_kg + payload_kg, inertia_frd=(roll + turned, pitch + turned, yaw))


def max_payload_kg(airframe: Airframe) -> float:
    """Return the heaviest payload (kg) that the airframe can carry; 0 if it can carry none."""
    return max(HOVER_MAX * airframe.thrust_max / GRAVITY - airframe.mass_kg, 0.0)
