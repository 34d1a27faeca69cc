"""Applies light and season to a built map: position of the sun, overcast sky, dusk, autumn.

Conditions change only light and colours. No shape moves, so distances, visibility and the verdict stay the same.
Materials are recognised by their names.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from episodes.maps.assets.leaves import SHADE
from episodes.maps.geometry import connected
from episodes.maps.scene import Instance, Material, Mesh, Picture, Scene, Sun
from foundation.conditions import AS_BUILT, SceneConditions
from foundation.frames import Vec3, vec3
from foundation.threads import once

REDDENING = (0.02, 0.10, 0.24)  # optical depth of clear air at the zenith, RGB (Rayleigh scattering, ∝ 1/λ⁴)
DUSK_DEG = (300.0, -4.0)  # azimuth and elevation of the sun: about 25 minutes after sunset in a northern summer
DUSK_SKY: Vec3 = (0.16, 0.19, 0.29)  # linear RGB, brightened, because cameras expose longer at dusk
DUSK_GLOW: Vec3 = (0.95, 0.42, 0.12)

# The lights of a map at dusk: street lamps and about half of the windows. They shine, but do not illuminate anything.
WINDOWS = ("window", "pane-", "curtain", "doors")  # prefixes of material names
LAMPS = ("lamp-glass", "lantern")
LIT_PERCENT = 55  # percentage of lit windows
ROOM_M = 2.0  # windows in the same cube of this size are lit or dark together
WARM: Vec3 = (1.0, 0.70, 0.36)  # linear RGB
GLASS = 0.30  # brightness of the darkest part of a lit window's picture, 0 … 1
WINDOW_EMISSION, LAMP_EMISSION = 0.75, 2.0

# Autumn: leaves in other colours, fallen leaves on paler grass.
LEAVES = ("foliage", "leaf", "leaves", "thicket")  # prefixes of material names
INSIDE = "thicket"  # prefix for leaves in the shade of other leaves
EVERGREEN = ("pine", "spruce", "box", "conifer", "hedge")  # suffixes for leaves that keep their colour
GRASS = ("grass", "lawn", "meadow")
HUES: tuple[Vec3, ...] = (  # linear RGB of leaves: gold, orange, rust, brown, yellowish green
    (0.62, 0.36, 0.05),
    (0.60, 0.20, 0.03),
    (0.36, 0.09, 0.03),
    (0.30, 0.17, 0.06),
    (0.32, 0.34, 0.09),
)
STRAW: Vec3 = (1.22, 1.0, 0.78)  # factor on the colour of grass
FALLEN = 260  # number of fallen leaves per repeat of the grass texture
FALLEN_PX = (3, 6)  # texels, range of the half length of a fallen leaf


@once(3)  # a run flies many episodes on one map; scenes are immutable
def in_conditions(scene: Scene, conditions: SceneConditions) -> Scene:
    """Return a map in these conditions. AS_BUILT leaves the map unchanged."""
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
    """Return the unit vector (NED) towards a point of the sky."""
    azimuth, elevation = math.radians(azimuth_deg), math.radians(elevation_deg)
    level = math.cos(elevation)
    return (level * math.cos(azimuth), level * math.sin(azimuth), -math.sin(elevation))


def moved(sun: Sun, azimuth_deg: float, elevation_deg: float) -> Sun:
    """Return `sun` at another position. A lower sun is redder and weaker, and its sky is darker.

    The colour is multiplied by the transmission of clear air at the new elevation, and divided by the old transmission.
    """
    toward = direction(azimuth_deg, elevation_deg)

    def through(height: float) -> list[float]:
        thickness = 1.0 / (height + 0.05)  # air masses; 0.05 avoids a division by 0 at the horizon
        return [math.exp(-depth * thickness) for depth in REDDENING]

    new, old = through(-toward[2]), through(max(-sun.toward_ned[2], 0.05))
    color = [c * n / o for c, n, o in zip(sun.color, new, old, strict=True)]
    dim = min(1.0, 0.35 + 0.65 * math.sqrt(max(-toward[2], 0.0) / max(-sun.toward_ned[2], 0.05)))
    return replace(sun, toward_ned=toward, color=vec3(color), sky=vec3(c * dim for c in sun.sky))


def overcast(sun: Sun) -> Sun:
    """Return the light below a closed layer of clouds: weak shadows, a grey sky."""
    if sun.clouds >= 1.0:
        return sun
    grey = 1.1 * sum(sun.sky) / 3.0
    return replace(
        sun, strength=0.10 * sun.strength, sky=(0.95 * grey, grey, 1.05 * grey), clouds=1.0, glow=(0.0, 0.0, 0.0)
    )


def dusk(sun: Sun) -> Sun:
    """Return the light after sunset: no direct sunlight, a blue sky, and a glow above the place of sunset."""
    return replace(sun, toward_ned=direction(*DUSK_DEG), strength=0.0, sky=DUSK_SKY, glow=DUSK_GLOW)


def with_lights(instances: Sequence[Instance]) -> tuple[Instance, ...]:
    """Return the instances of a map with their lights on."""
    shining = cache(_shining)

    @cache  # meshes and materials are compared by identity
    def lit(mesh: Mesh) -> Mesh:
        materials, material = list(mesh.materials), mesh.material.copy()
        for row, looks in enumerate(mesh.materials):
            is_lamp = looks.name.startswith(LAMPS)
            if is_lamp or looks.name.startswith(WINDOWS):
                of_it = np.flatnonzero(mesh.material == row)
                material[of_it if is_lamp else of_it[_lit_windows(mesh, of_it)]] = len(materials)
                materials.append(shining(looks, LAMP_EMISSION if is_lamp else WINDOW_EMISSION))
        if len(materials) == len(mesh.materials):
            return mesh
        return replace(mesh, material=material, materials=(*materials,))

    return tuple(
        instance if (mesh := lit(instance.mesh)) is instance.mesh else replace(instance, mesh=mesh)
        for instance in instances
    )


def _shining(looks: Material, emission: float) -> Material:
    if looks.texture is None:
        return replace(looks, color=WARM, emission=emission)
    floor = 255.0 * GLASS ** (1.0 / 2.2)
    picture = np.asarray(floor + (1.0 - floor / 255.0) * looks.texture, np.uint8)
    return replace(looks, color=WARM, texture=picture, emission=emission)


def _lit_windows(mesh: Mesh, rows: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return a mask of the triangles of lit windows. The position of a window alone decides whether it is lit."""
    _, corners = np.unique(mesh.vertices[mesh.triangles[rows]].reshape(-1, 3), axis=0, return_inverse=True)
    corners = corners.reshape(-1, 3)
    first, second, third = corners.T
    window = connected(np.tile(first, 2), np.concatenate([second, third]), int(corners.max(initial=0)) + 1)[first]
    middle = mesh.vertices[mesh.triangles[rows]].mean(axis=1)
    count = np.maximum(np.bincount(window), 1)[:, None]
    middles = np.stack([np.bincount(window, middle[:, axis]) for axis in range(3)], axis=1) / count
    cell = np.floor(middles / ROOM_M).astype(np.int64)
    draw = (cell @ np.array((73_856_093, 19_349_663, 83_492_791)) & 0xFFFF_FFFF) * 2_654_435_761 >> 16
    return np.asarray((draw % 100 < LIT_PERCENT)[window], np.bool_)


def in_autumn(instances: Sequence[Instance]) -> tuple[Instance, ...]:
    """Return the instances of a map in autumn. Trees that share a mesh can have different colours."""
    pictures: dict[int, Picture] = {}  # by the identity of the original

    def picture(texture: Picture, is_grass: bool) -> Picture:
        if id(texture) not in pictures:
            pictures[id(texture)] = strewn(texture) if is_grass else colorless(texture)
        return pictures[id(texture)]

    @cache  # meshes and materials are compared by identity
    def recolored(material: Material, color: Vec3, is_grass: bool) -> Material:
        texture = None if material.texture is None else picture(material.texture, is_grass)
        return replace(material, color=color, texture=texture)

    def material_of(material: Material, hue: int) -> Material:
        is_grass = material.name.startswith(GRASS)
        if not is_grass and (not material.name.startswith(LEAVES) or material.name.endswith(EVERGREEN)):
            return material
        light = SHADE if material.name.startswith(INSIDE) else 1.0
        color, factor = (material.color, STRAW) if is_grass else (HUES[hue], (light, light, light))
        return recolored(material, vec3(c * f for c, f in zip(color, factor, strict=True)), is_grass)

    @cache
    def mesh_of(mesh: Mesh, hue: int) -> Mesh:
        materials = tuple(material_of(material, hue) for material in mesh.materials)
        same = all(new is old for new, old in zip(materials, mesh.materials, strict=True))
        return mesh if same else replace(mesh, materials=materials)

    return tuple(replace(instance, mesh=mesh_of(instance.mesh, instance.id * 7 % len(HUES))) for instance in instances)


def colorless(texture: Picture) -> Picture:
    """Return a grey picture: each texel gets the value of its brightest channel. Channels beyond RGB are kept."""
    grey = texture.copy()
    grey[..., :3] = texture[..., :3].max(axis=-1, keepdims=True)
    return grey


def strewn(texture: Picture) -> Picture:
    """Return a picture of grass with fallen leaves. Leaves at an edge continue at the opposite edge."""
    picture, rng = texture.copy(), np.random.default_rng(181)
    height, width = picture.shape[:2]
    for hue in rng.integers(0, len(HUES) - 1, FALLEN):
        x, y = int(rng.integers(width)), int(rng.integers(height))
        axes = (int(rng.integers(*FALLEN_PX)), int(rng.integers(2, 4)))
        turn = float(rng.uniform(0.0, 180.0))
        color = [255.0 * (1.3 * c) ** (1.0 / 2.2) for c in HUES[hue]]
        for dx in (-width, 0, width):
            for dy in (-height, 0, height):
                cv2.ellipse(picture, (x + dx, y + dy), axes, turn, 0.0, 360.0, color, -1, cv2.LINE_AA)
    return picture
