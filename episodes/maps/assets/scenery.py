"""One of each thing that maps are furnished with besides targets and the campus's fixtures, by name."""

from collections.abc import Callable
from functools import partial

from episodes.maps.assets import houses, street
from episodes.maps.assets.houses import HousePlan
from episodes.maps.scene import Mesh

MAKERS: dict[str, Callable[[], Mesh]] = {
    "barrier": street.barrier,
    "birch": partial(street.tree, "birch", 7.2, 2),
    "board-fence": partial(street.board_fence, 6.0),
    "bungalow": partial(houses.house, HousePlan(dormers=2, shutters="ink", wall="mist")),
    "bush": street.bush,
    "fir": street.conifer,
    "hedge": street.hedge,
    "hydrant": street.hydrant,
    "mailbox": street.mailbox,
    "maple": partial(street.tree, "maple", 7.2, 1),
    "oak": street.tree,
    "picket-fence": street.picket_fence,
    "refuse-bin": street.bin,
    "street-lamp": street.lamp,
    "street-sign": partial(street.name_post, "Main Street", "Hill Road"),
    "two-storey-house": partial(
        houses.house, HousePlan(width=9.4, storeys=2, band=True, hipped=True, wall="linen", roof="umber", garage=-1)
    ),
}
