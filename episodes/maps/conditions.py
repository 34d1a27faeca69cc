"""Applies light and season to a map as it was built: the place of the sun, an overcast sky, dusk, autumn.

They change what is seen and nothing else: no shape moves, so distances, visibility and the verdict stay.
"""

import math
from collections.abc import Iterable
from dataclasses import replace

from episodes.maps.autumn import in_autumn
from episodes.maps.lights import with_lights
from episodes.maps.scene import Scene, Sun
from foundation.conditions import AS_BUILT, SceneConditions
from foundation.frames import Vec3
from foundation.threads import once

REDDENING = (0.02, 0.10, 0.24)  # optical depth of clear air at the zenith, RGB (Rayleigh, as 1/λ⁴ goes)
DUSK_DEG = (300.0, -4.0)  # azimuth and elevation of the sun: about 25 minutes after sunset in a northern summer
DUSK_SKY: Vec3 = (0.16, 0.19, 0.29)  # linear RGB, exposed longer than a day's sky, as cameras do
DUSK_GLOW: Vec3 = (0.95, 0.42, 0.12)


@once(3)  # a run flies many episodes on one map, and a scene is never changed
def in_conditions(scene: Scene, conditions: SceneConditions) -> Scene:
    """Return a map in these conditions; the map itself where they are those that it was built in."""
    if conditions == AS_BUILT:
        return scene
    instances = scene.instances
    if conditions.season == "autumn":
        instances = in_autumn(instances)
    if conditions.sky == "dusk":
        instances = with_lights(instances)
    return replace(scene, sun=_sun(scene.sun, conditions), instances=instances)


def _sun(sun: Sun, conditions: SceneConditions) -> Sun:
    if conditions.sky == "dusk":
        return dusk(sun)
    azimuth, elevation = conditions.sun_azimuth_deg, conditions.sun_elevation_deg
    if azimuth is not None or elevation is not None:
        north, east, down = sun.toward_ned
        own = math.degrees(math.atan2(east, north)), math.degrees(math.asin(min(max(-down, -1.0), 1.0)))
        sun = moved(sun, own[0] if azimuth is None else azimuth, own[1] if elevation is None else elevation)
    return overcast(sun) if conditions.sky == "overcast" else sun


def direction(azimuth_deg: float, elevation_deg: float) -> Vec3:
    """Return the unit vector, NED, towards a place of the sky."""
    azimuth, elevation = math.radians(azimuth_deg), math.radians(elevation_deg)
    level = math.cos(elevation)
    return (level * math.cos(azimuth), level * math.sin(azimuth), -math.sin(elevation))


def moved(sun: Sun, azimuth_deg: float, elevation_deg: float) -> Sun:
    """Return `sun` at another place, redder and weaker the lower it stands, and the sky darker with it.

    The colour is what clear air lets through on the way to either height, against the way overhead.
    """
    toward = direction(azimuth_deg, elevation_deg)

    def through(height: float) -> list[float]:
        thickness = 1.0 / (height + 0.05)  # air masses; the term keeps the horizon finite
        return [math.exp(-depth * thickness) for depth in REDDENING]

    new, old = through(-toward[2]), through(max(-sun.toward_ned[2], 0.05))
    color = [c * n / o for c, n, o in zip(sun.color, new, old, strict=True)]
    dim = min(1.0, 0.35 + 0.65 * math.sqrt(max(-toward[2], 0.0) / max(-sun.toward_ned[2], 0.05)))
    return replace(sun, toward_ned=toward, color=_vec3(color), sky=_vec3(c * dim for c in sun.sky))


def overcast(sun: Sun) -> Sun:
    """Return the light below a closed layer of clouds: hardly any shadow, a grey sky."""
    if sun.clouds >= 1.0:
        return sun
    grey = 1.1 * sum(sun.sky) / 3.0
    return replace(
        sun, strength=0.10 * sun.strength, sky=(0.95 * grey, grey, 1.05 * grey), clouds=1.0, glow=(0.0, 0.0, 0.0)
    )


def dusk(sun: Sun) -> Sun:
    """Return the light after sunset: none from the sun itself, a blue sky, and a glow above the place where it set."""
    return replace(sun, toward_ned=direction(*DUSK_DEG), strength=0.0, sky=DUSK_SKY, glow=DUSK_GLOW)


def _vec3(values: Iterable[float]) -> Vec3:
    r, g, b = values
    return (r, g, b)
