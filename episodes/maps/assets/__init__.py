"""The catalogue of things a scene can hold, by name."""

import difflib
from collections.abc import Callable
from functools import lru_cache, partial

from episodes.maps.assets import bus, exhibits, fixtures, materials, people, vehicles
from episodes.maps.scene import Mesh
from foundation.errors import UsageError

PAINTS = tuple(materials.PAINTS)

# asset → its maker: (paint, inscription) → mesh
_INSCRIBED: dict[str, Callable[[str, str], Mesh]] = {kind: partial(vehicles.car, kind) for kind in vehicles.SHAPES} | {
    "bus": bus.bus,
    "motorcycle": people.motorcycle,
    "sign": exhibits.sign,
}
# asset → its maker: paint → mesh
_PLAIN: dict[str, Callable[[str], Mesh]] = {
    "cyclist": people.cyclist,
    "delivery_robot": fixtures.delivery_robot,
    "pedestrian": people.pedestrian,
    "person": people.person,
    "quadrotor": exhibits.quadrotor,
    "service_cart": fixtures.service_cart,
}
PLATE = "DC 2475"  # written where a record names no inscription


def names() -> list[str]:
    """Return the assets that an episode may name as its target."""
    return sorted([*_INSCRIBED, *_PLAIN])


def inscribed() -> frozenset[str]:
    """Return the assets that show an inscription: cars, bus and motorcycle on their plates, the sign on its board."""
    return frozenset(_INSCRIBED)


@lru_cache(maxsize=128)
def build(asset: str, paint: str, inscription: str | None = None) -> Mesh:
    """Return the mesh of a target asset in a paint, FRD axes, origin on the ground under its middle.

    An inscription that the asset has no place for is ignored. Raises UsageError for an unknown asset or paint.
    """
    if asset in _INSCRIBED:
        return _INSCRIBED[asset](paint, inscription or PLATE)
    if asset not in _PLAIN:
        near = ", ".join(difflib.get_close_matches(asset, names(), 3, 0.3) or names())
        raise UsageError(f"asset '{asset}' is not in the catalogue: did you mean {near}?")
    return _PLAIN[asset](paint)
