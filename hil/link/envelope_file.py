"""The safety envelope from a TOML file: the fields of `hil.link.envelope.Limits` by their names."""

from pathlib import Path

from foundation.errors import UsageError
from foundation.typed_file import replaced, toml_table
from hil.link.envelope import Limits


def load(path: Path, base: Limits) -> Limits:
    """Return `base` with what the file says otherwise. Raises UsageError naming the file and the field."""
    where = f"--envelope {path}"
    limits = replaced(base, toml_table(path, where), where)
    if limits.floor_m + 2 * limits.height_margin_m >= limits.ceiling_m:
        raise UsageError(f"{where}: between floor_m and ceiling_m no room is left beside two height_margin_m")
    if limits.radius_m <= limits.margin_m:
        raise UsageError(f"{where}: radius_m leaves no room beside margin_m")
    return limits
