"""A residential neighbourhood: two streets of houses, two roads that join them, gardens, drives and parked cars.

The main street runs north through the origin. Where things are is said by `residential_plan`; what is free for targets
by `residential_places`.
"""

import numpy as np

from episodes.maps import residential_plan as plan
from episodes.maps.assets import houses
from episodes.maps.residential_ground import ground, markings
from episodes.maps.residential_places import places
from episodes.maps.residential_things import things
from episodes.maps.scene import Instance, Mesh, Scene, Sun

__all__ = ["build", "places"]

ORIGIN = (47.397742, 8.545594, 488.0)  # PX4's usual SITL home


def build(seed: int = 1) -> Scene:
    """Return the neighbourhood. `seed` varies houses, planting and most parked cars; roads and plots stay."""
    homes = plan.plots(seed)
    terrain = plan.terrain(homes)
    instances: list[Instance] = []

    def add(kind: str, mesh: Mesh, north: float, east: float, yaw: float, level: float | None = None) -> None:
        number = len(instances) + 1
        place = (float(north), float(east), terrain.at(north, east) if level is None else level)
        instances.append(Instance(number, f"{kind}-{number}", kind, mesh, place, float(yaw)))

    for name, mesh in ground(homes):
        number = len(instances) + 1
        instances.append(Instance(number, name, "ground", mesh, (0.0, 0.0, 0.0)))
    number = len(instances) + 1
    instances.append(Instance(number, "marking", "ground", markings(terrain), (0.0, 0.0, 0.0), solid=False))
    for plot in homes:
        out = plan.FRONT + plot.plan.depth / 2
        # the garage door opens at the level of the drive
        level = terrain.at(*plot.at(plot.drive, out))
        add("house", houses.house(plot.plan), *plot.at(plot.house, out), plot.yaw, level)
    for one in things(homes, seed, terrain):
        add(one.kind, one.mesh, one.north, one.east, one.yaw)
    azimuth, elevation = np.radians(142.0), np.radians(50.0)  # late morning, northern summer
    sun = (np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), -np.sin(elevation))
    return Scene(
        name="residential",
        instances=tuple(instances),
        terrain=terrain,
        sun=Sun((float(sun[0]), float(sun[1]), float(sun[2]))),
        latitude_deg=ORIGIN[0],
        longitude_deg=ORIGIN[1],
        altitude_m=ORIGIN[2],
        spawn_ned=(0.0, 0.0, terrain.at(0.0, 0.0)),
        notes=("Main Street and Orchard Street run north, Hill Road and Mill Road east.",),
    )
