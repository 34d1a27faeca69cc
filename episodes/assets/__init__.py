"""The catalogue of things a scene can hold, by name."""

import difflib
from collections.abc import Callable
from functools import lru_cache, partial

from dronecats.border.errors import UsageError
from episodes.assets import paint as _paint
from episodes.assets import vehicles
from episodes.scene import Mesh

PAINTS = tuple(_paint.PAINTS)

# asset → its maker: (paint, inscription) → mesh
_TARGETS: dict[str, Callable[[str, str], Mesh]] = {kind: partial(vehicles.car, kind) for kind in vehicles.SHAPES}
PLATE = "DC 2475"  # written where a record names no inscription


def names() -> list[str]:
    """Return the assets that an episode may name as its target."""
    return sorted(_TARGETS)


@lru_cache(maxsize=64)
def build(asset: str, paint: str, inscription: str | None = None) -> Mesh:
    """Return the mesh of a target asset in a paint, FRD axes, origin on the ground under its middle.

    Raises UsageError for an unknown asset or paint.
    """
    if asset not in _TARGETS:
        near = ", ".join(difflib.get_close_matches(asset, names(), 3, 0.3) or names())
        raise UsageError(f"asset '{asset}' is not in the catalogue: did you mean {near}?")
    return _TARGETS[asset](paint, inscription or PLATE)
