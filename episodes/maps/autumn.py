"""Autumn on a map: leaves in other colours, fallen leaves on paler grass. Materials are known by their names."""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from episodes.maps.assets.leaves import SHADE
from episodes.maps.scene import Instance, Material, Mesh
from foundation.frames import Vec3

LEAVES = ("foliage", "leaf", "leaves", "thicket")  # how names of materials begin
INSIDE = "thicket"  # the same, of leaves in the shade of others
EVERGREEN = ("pine", "spruce", "box", "conifer", "hedge")  # how they end where leaves stay
GRASS = ("grass", "lawn", "meadow")
HUES: tuple[Vec3, ...] = (  # linear RGB of leaves: gold, orange, rust, brown, and a green that begins to turn
    (0.62, 0.36, 0.05),
    (0.60, 0.20, 0.03),
    (0.36, 0.09, 0.03),
    (0.30, 0.17, 0.06),
    (0.32, 0.34, 0.09),
)
STRAW: Vec3 = (1.22, 1.0, 0.78)  # factor on the colour of grass
FALLEN = 260  # leaves on one repeat of the grass
FALLEN_PX = (3, 6)  # half their width

Picture = NDArray[np.uint8]


def in_autumn(instances: Sequence[Instance]) -> tuple[Instance, ...]:
    """Return the things of a map in autumn. Trees of one mesh have several colours."""
    paints = _Paints()
    return tuple(
        replace(instance, mesh=paints.mesh(instance.mesh, instance.id * 7 % len(HUES))) for instance in instances
    )


class _Paints:
    """The recoloured meshes, materials and pictures, each once. Identity distinguishes them."""

    def __init__(self) -> None:
        self._meshes: dict[tuple[int, int], Mesh] = {}
        self._materials: dict[tuple[int, int], Material] = {}
        self._pictures: dict[int, Picture] = {}

    def mesh(self, mesh: Mesh, hue: int) -> Mesh:
        """Return a mesh with its materials in autumn; the mesh itself where none of them changes."""
        key = (id(mesh), hue)
        if key not in self._meshes:
            materials = tuple(self._material(material, hue) for material in mesh.materials)
            same = all(new is old for new, old in zip(materials, mesh.materials, strict=True))
            self._meshes[key] = mesh if same else replace(mesh, materials=materials)
        return self._meshes[key]

    def _material(self, material: Material, hue: int) -> Material:
        is_grass = material.name.startswith(GRASS)
        if not is_grass and (not material.name.startswith(LEAVES) or material.name.endswith(EVERGREEN)):
            return material
        key = (id(material), 0 if is_grass else hue)
        if key not in self._materials:
            light = SHADE if material.name.startswith(INSIDE) else 1.0
            color, factor = (material.color, STRAW) if is_grass else (HUES[hue], (light, light, light))
            r, g, b = (c * f for c, f in zip(color, factor, strict=True))
            self._materials[key] = replace(
                material, color=(r, g, b), texture=self._picture(material.texture, is_grass=is_grass)
            )
        return self._materials[key]

    def _picture(self, texture: Picture | None, *, is_grass: bool) -> Picture | None:
        if texture is None:
            return None
        if id(texture) not in self._pictures:
            self._pictures[id(texture)] = strewn(texture) if is_grass else colorless(texture)
        return self._pictures[id(texture)]


def colorless(texture: Picture) -> Picture:
    """Return a picture in greys as bright as its brightest channel; what it has beyond RGB is kept."""
    grey = texture.copy()
    grey[..., :3] = texture[..., :3].max(axis=-1, keepdims=True)
    return grey


def strewn(texture: Picture) -> Picture:
    """Return a picture of grass with fallen leaves, which continue over its edges."""
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
