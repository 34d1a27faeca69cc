"""Between our materials and glTF's metallic-roughness ones.

What glTF cannot say is kept in a material's `extras`; it counts only while the standard fields are those we wrote, so
that a colour changed in another program is the colour that is flown.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from episodes.maps.gltf.document import Document
from episodes.maps.gltf.images import Images, source_of
from episodes.maps.scene import Material
from foundation.frames import Vec3

EXTRA = "dronecats_look"  # [red, green, blue, emission, specular] of ours


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """A material with what a mesh needs to know to wear it."""

    material: Material
    uv_set: int = 0  # which TEXCOORD_ the texture follows
    uv_scale: tuple[float, float] = (1.0, 1.0)
    uv_turn: float = 0.0  # rad
    uv_offset: tuple[float, float] = (0.0, 0.0)

    def uv(self, raw: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return texture coordinates (V, 2) as KHR_texture_transform moves them; untouched when it does not."""
        if self.uv_scale == (1.0, 1.0) and self.uv_turn == 0.0 and self.uv_offset == (0.0, 0.0):
            return raw
        c, s = np.cos(self.uv_turn), np.sin(self.uv_turn)
        scaled = raw * np.array(self.uv_scale)
        return np.asarray(scaled @ np.array([[c, -s], [s, c]]) + np.array(self.uv_offset), np.float32)


def standard(material: Material) -> dict[str, Any]:
    """Return the fields of a glTF material that look most like one of ours, textures apart."""
    color = [min(max(float(c), 0.0), 1.0) for c in material.color]
    fields: dict[str, Any] = {
        "pbrMetallicRoughness": {
            "baseColorFactor": [*color, 1.0],
            "metallicFactor": 0.0,
            "roughnessFactor": 1.0 - min(max(material.specular, 0.0), 1.0),
        },
        "doubleSided": True,
    }
    if material.emission > 0.0:
        fields["emissiveFactor"] = [c * min(material.emission, 1.0) for c in color]
    return fields


def used_images(document: Document, materials: set[int]) -> set[int]:
    """Return the indices of the images that some materials show."""
    found = set()
    for k in materials:
        texture = _texture(document, document.entry("materials", k, "material"), f"materials[{k}]")
        if texture is not None:
            found.add(source_of(document, texture.get("index"), f"materials[{k}].baseColorTexture.index"))
    return found


def read(document: Document, index: int, images: Images) -> Look:
    """Return a material of the file. Metalness, normal maps and transparency are not of our renderer's world."""
    entry, where = document.entry("materials", index, "material"), f"materials[{index}]"
    name = document.name_of(entry) or f"material-{index}"
    color, specular = _surface(document, entry, where)
    texture, picture = _texture(document, entry, where), None
    if texture is not None:
        source = source_of(document, texture.get("index"), f"{where}.baseColorTexture.index")
        picture = images.picture(source, entry.get("alphaMode", "OPAQUE") != "OPAQUE")
    red, green, blue = (max(c, 0.0) for c in document.numbers(entry, "emissiveFactor", where, (0.0, 0.0, 0.0)))
    shine = (red, green, blue)
    emission = 0.0
    if max(color) <= 1e-3 < max(shine):  # a lamp that is black but for its own light
        color, emission = shine, 1.0
    elif sum(shine) > 0.0 and "emissiveTexture" not in entry:
        emission = min(sum(shine) / max(sum(color), 1e-3), 1.0)
    made = Material(name, color, picture, emission, specular)
    made = _ours(document, entry, where, name, picture) or made
    if texture is None:
        return Look(made)
    uv_set = document.whole(texture, "texCoord", f"{where}.baseColorTexture", 0)
    moved = document.extension(texture, "KHR_texture_transform", f"{where}.baseColorTexture") or {}
    place = f"{where}.KHR_texture_transform"
    scale = document.numbers(moved, "scale", place, (1.0, 1.0))
    offset = document.numbers(moved, "offset", place, (0.0, 0.0))
    turn = document.number(moved, "rotation", place, 0.0)
    uv_set = document.whole(moved, "texCoord", place, uv_set)
    return Look(made, uv_set, (scale[0], scale[1]), turn, (offset[0], offset[1]))


def _surface(document: Document, entry: Mapping[str, Any], where: str) -> tuple[Vec3, float]:
    """Return (linear colour, specular): a rough surface is matt, a smooth one shines."""
    older = document.extension(entry, "KHR_materials_pbrSpecularGlossiness", where)
    if older is not None:
        factor = document.numbers(older, "diffuseFactor", where, (1.0, 1.0, 1.0, 1.0))
        specular = 0.0 if "specularGlossinessTexture" in older else document.number(older, "glossinessFactor", where, 1)
    else:
        pbr = document.mapping(entry, "pbrMetallicRoughness", f"{where}.pbrMetallicRoughness")
        factor = document.numbers(pbr, "baseColorFactor", where, (1.0, 1.0, 1.0, 1.0))
        specular = 1.0 - document.number(pbr, "roughnessFactor", where, 1.0)
    red, green, blue = (min(max(c, 0.0), 1.0) for c in factor[:3])
    return (red, green, blue), min(max(specular, 0.0), 1.0)


def _texture(document: Document, entry: Mapping[str, Any], where: str) -> Mapping[str, Any] | None:
    """Return the reference to the texture of a material's own colour, or of its light when it has no other."""
    older = document.extension(entry, "KHR_materials_pbrSpecularGlossiness", where)
    if older is not None and "diffuseTexture" in older:
        return document.mapping(older, "diffuseTexture", f"{where}.diffuseTexture")
    pbr = document.mapping(entry, "pbrMetallicRoughness", f"{where}.pbrMetallicRoughness")
    if "baseColorTexture" in pbr:
        return document.mapping(pbr, "baseColorTexture", f"{where}.baseColorTexture")
    if "emissiveTexture" in entry and max(_surface(document, entry, where)[0]) <= 1e-3:
        return document.mapping(entry, "emissiveTexture", f"{where}.emissiveTexture")
    return None


def _ours(
    document: Document, entry: Mapping[str, Any], where: str, name: str, picture: NDArray[np.uint8] | None
) -> Material | None:
    """Return the exact material that was written, while the standard fields still say the same."""
    look = document.mapping(entry, "extras", f"{where}.extras").get(EXTRA) if "extras" in entry else None
    if not isinstance(look, list) or len(look) != 5:
        return None
    if not all(isinstance(v, int | float) and not isinstance(v, bool) and 0.0 <= v <= 4.0 for v in look):
        return None
    red, green, blue, emission, specular = (float(v) for v in look)
    exact = Material(name, (red, green, blue), picture, emission, specular)
    pbr = document.mapping(entry, "pbrMetallicRoughness", where)
    written = (
        *document.numbers(pbr, "baseColorFactor", where, (1.0, 1.0, 1.0, 1.0)),
        document.number(pbr, "roughnessFactor", where, 1.0),
        *document.numbers(entry, "emissiveFactor", where, (0.0, 0.0, 0.0)),
    )
    fields = standard(exact)
    surface = fields["pbrMetallicRoughness"]
    wanted = (
        *surface["baseColorFactor"],
        surface["roughnessFactor"],
        *fields.get("emissiveFactor", (0.0, 0.0, 0.0)),
    )
    return exact if np.allclose(written, wanted, rtol=0.0, atol=1e-5) else None
