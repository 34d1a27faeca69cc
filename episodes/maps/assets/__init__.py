"""The catalogue of assets by name: targets, campus fixtures and scenery."""

from collections.abc import Callable
from functools import lru_cache, partial

from episodes.maps.assets import (
    campus_fixtures,
    houses,
    lettering,
    materials,
    multirotor,
    people,
    plants,
    riders,
    service_vehicles,
    street,
    vehicles,
)
from episodes.maps.assets.house_plans import HousePlan
from episodes.maps.scene import Mesh
from foundation.errors import UsageError
from foundation.wording import suggestion

PAINTS = tuple(materials.PAINTS)

# asset that shows an inscription, on its plates or its board → function (paint, inscription) → mesh
_INSCRIBED: dict[str, Callable[[str, str], Mesh]] = {kind: partial(vehicles.car, kind) for kind in vehicles.SHAPES} | {
    "bus": service_vehicles.bus,
    "motorcycle": riders.motorcycle,
    "sign": lettering.sign,
}
# asset → function paint → mesh
_PLAIN: dict[str, Callable[[str], Mesh]] = {
    "cyclist": riders.cyclist,
    "delivery_robot": service_vehicles.delivery_robot,
    "pedestrian": people.pedestrian,
    "person": people.person,
    "quadrotor": multirotor.quadrotor,
    "service_cart": service_vehicles.service_cart,
}
FIXTURES = dict(sorted(campus_fixtures.FIXTURES.items()))
# other object of the maps → function that builds its mesh
SCENERY: dict[str, Callable[[], Mesh]] = {
    "barrier": street.barrier,
    "birch": partial(plants.tree, "birch", 7.2, 2),
    "board-fence": partial(street.board_fence, 6.0),
    "bungalow": partial(houses.house, HousePlan(dormers=2, shutters="ink", wall="mist")),
    "bush": plants.bush,
    "fir": plants.spruce,
    "hedge": plants.hedge,
    "hydrant": street.hydrant,
    "mailbox": street.mailbox,
    "lilac": partial(plants.bush, 0.6, 1),
    "linden": partial(plants.tree, "linden", 7.2, 1),
    "maple": partial(plants.tree, "maple", 7.2, 1),
    "oak": plants.tree,
    "picket-fence": street.picket_fence,
    "pine": partial(plants.tree, "pine", 9.0, 1),
    "poplar": partial(plants.tree, "poplar", 8.0, 1),
    "refuse-bin": street.bin,
    "street-lamp": street.lamp,
    "street-sign": partial(street.name_post, "Main Street", "Hill Road"),
    "two-storey-house": partial(
        houses.house, HousePlan(width=9.4, storeys=2, band=True, hipped=True, wall="linen", roof="umber", garage=-1)
    ),
}
PLATE = "DC 2475"  # text on the plates of a vehicle whose record has no inscription


def names() -> list[str]:
    """Return the assets that an episode may name as its target."""
    return sorted([*_INSCRIBED, *_PLAIN])


@lru_cache(maxsize=128)
def build(asset: str, paint: str, inscription: str | None = None) -> Mesh:
    """Return the mesh of a target asset in a paint: FRD axes, origin on the ground under its middle.

    `inscription` is ignored if the asset shows none. Raises UsageError for an unknown asset or paint.
    """
    if asset in _INSCRIBED:
        return _INSCRIBED[asset](paint, inscription or PLATE)
    if asset not in _PLAIN:
        raise UsageError(f"asset '{asset}' does not exist: {suggestion(asset, names())}")
    return _PLAIN[asset](paint)
