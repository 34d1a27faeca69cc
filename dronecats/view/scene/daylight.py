"""Sky and sun over a map in the browser."""

from typing import Any

import numpy as np
import viser

from dronecats.view.scene import display
from episodes.maps.scene import Sun

SKY_TOP, SKY_BOTTOM = (150, 188, 226), (233, 240, 245)
FAR_M = 200.0  # from the origin to where the sun is put


def light(server: viser.ViserServer, sun: Sun) -> None:
    """Have the browser's up be up, a sky behind everything, and light as a map's sun gives it.

    Without shadows: those that count are in the cameras' pictures.
    """
    scene = server.scene
    scene.set_up_direction("+y")
    scene.set_background_image(_sky())
    scene.configure_default_lights(enabled=False)
    scene.configure_environment_map(None)
    scene.add_light_ambient("/light/ambient", intensity=0.9)
    scene.add_light_hemisphere("/light/sky", sky_color=(205, 222, 255), ground_color=(120, 115, 105), intensity=1.3)
    n, e, d = (FAR_M * v for v in sun.toward_ned)
    place = display.place_of((n, e, d))
    scene.add_light_directional("/light/sun", color=(255, 244, 224), intensity=2.2, position=place)


def _sky() -> Any:
    share = np.linspace(0.0, 1.0, 64)[:, None, None]
    rows = np.array(SKY_TOP) * (1.0 - share) + np.array(SKY_BOTTOM) * share
    return np.repeat(rows.astype(np.uint8), 4, axis=1)
