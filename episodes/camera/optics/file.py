"""Reads optics from a TOML file. The format is in docs/cameras.md."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from episodes.camera.optics.options import Optics
from foundation.camera import CameraModel
from foundation.errors import UsageError
from foundation.typed_file import toml_table, typed


def load(path: Path) -> Optics:
    """Return the options of a TOML file. Raises UsageError with file, key and reason."""
    where = f"--optics {path}"
    return optics_of(toml_table(path, where), where)


def optics_of(table: Mapping[str, Any], where: str) -> Optics:
    """Return the options in a table. Raises UsageError, which names the table as `where`."""
    optics = typed(dict(table), Optics, where)
    if optics.lens is not None:  # coefficients may each be in range and still give no usable picture together
        from episodes.camera.optics.camera import wide_camera  # imports the renderer, which most commands do not need

        try:
            wide_camera(optics.lens, CameraModel())
        except ValueError as error:
            raise UsageError(f"{where}: {error}") from None
    return optics
