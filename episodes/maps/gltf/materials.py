"""Converts materials and pictures from and to glTF. Picture sizes are read from the headers before decoding."""

import struct
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from episodes.maps.assets.materials import fill_holes
from episodes.maps.gltf.document import REMEDY, Document
from episodes.maps.scene import Material, Picture
from foundation.frames import Vec3

MAX_SIDE = 8192
MAX_TEXELS = 48 * 2**20  # all pictures of a map together, when reduced
SIDES = (2048, 1024, 512, 256, 128, 64, 32, 16)  # px; the first value that keeps MAX_TEXELS becomes the largest side
CUTOFF = 0.5  # default of alphaCutoff: texels with a lower alpha are holes

EXTRA = "dronecats_look"  # field of the extras: [red, green, blue, emission, specular, drift, foliage]


def encode(picture: Picture, cutout: NDArray[np.bool_] | None = None) -> bytes:
    """Return an (H, W, 3) sRGB picture as lossless PNG, with `cutout` as its alpha."""
    if cutout is not None:
        picture = np.dstack([picture[..., ::-1], np.where(cutout, 255, 0).astype(np.uint8)])
    else:
        picture = picture[..., ::-1]
    done, data = cv2.imencode(".png", picture, [cv2.IMWRITE_PNG_COMPRESSION, 6])
    if not done:
        raise ValueError("the picture cannot be encoded")
    return data.tobytes()


class Images:
    """The pictures of one file, each decoded once, on demand."""

    def __init__(self, document: Document, used: Iterable[int]) -> None:
        """Measure the pictures that will be used. Raises UsageError if one is too large, or neither PNG nor JPEG."""
        self._document = document
        self._pictures: dict[tuple[int, float | None], tuple[Picture, NDArray[np.bool_] | None]] = {}
        self._data = {k: self._bytes_of(k) for k in sorted(set(used))}
        self._sizes = {k: self._measured(k, data) for k, data in self._data.items()}
        for self._side in SIDES:
            shrunk = (min(1.0, self._side / max(w, h)) for w, h in self._sizes.values())
            areas = (w * h * s * s for (w, h), s in zip(self._sizes.values(), shrunk, strict=True))
            if sum(areas) <= MAX_TEXELS:
                break

    def _bytes_of(self, index: int) -> bytes:
        image, where = self._document.entry("images", index, "source"), f"images[{index}]"
        if "uri" in image:
            return self._document.data(image["uri"], f"{where}.uri")
        return bytes(self._document.view(image.get("bufferView"), f"{where}.bufferView")[0])

    def _measured(self, index: int, data: bytes) -> tuple[int, int]:
        size = png_size(data) or jpeg_size(data)
        if size is None:
            self._document.fail(f"images[{index}]", f"is neither PNG nor JPEG: {REMEDY['KHR_texture_basisu']}")
        if not 0 < min(size) <= max(size) <= MAX_SIDE:
            self._document.fail(
                f"images[{index}]", f"is {size[0]}×{size[1]} pixels; a side of 1 … {MAX_SIDE} is allowed"
            )
        return size

    def picture(self, index: int, cutoff: float | None) -> tuple[Picture, NDArray[np.bool_] | None]:
        """Return an image (H, W, 3) sRGB and the mask (H, W) of its opaque texels, those with alpha ≥ `cutoff`.

        The mask is None if the image has no holes or `cutoff` is None. See `fill_holes` for the colour of holes.
        """
        if (index, cutoff) not in self._pictures:
            self._pictures[index, cutoff] = self._decoded(index, cutoff)
        return self._pictures[index, cutoff]

    def _decoded(self, index: int, cutoff: float | None) -> tuple[Picture, NDArray[np.bool_] | None]:
        try:
            raw = cv2.imdecode(np.frombuffer(self._data[index], np.uint8), cv2.IMREAD_UNCHANGED)
        except cv2.error:
            raw = None
        width, height = self._sizes[index]
        if raw is None or raw.shape[:2] != (height, width) or raw.dtype not in (np.uint8, np.uint16):
            self._document.fail(f"images[{index}]", "is damaged: it cannot be decoded")
        if raw.dtype == np.uint16:
            raw = (raw >> 8).astype(np.uint8)
        if raw.ndim == 2:
            raw = np.repeat(raw[..., None], 3, axis=2)
        shrink = self._side / max(width, height)
        if shrink < 1.0:
            size = (max(1, round(width * shrink)), max(1, round(height * shrink)))
            raw = cv2.resize(raw, size, interpolation=cv2.INTER_AREA)
        picture = np.ascontiguousarray(raw[..., 2::-1])
        if cutoff is None or raw.shape[2] != 4:
            return picture, None
        there = raw[..., 3] >= 255.0 * cutoff
        if there.all():
            return picture, None
        fill_holes(picture, there)
        return picture, there


def png_size(data: bytes) -> tuple[int, int] | None:
    """Return (width, height) that a PNG declares; None if the data are no PNG. Source: PNG, section 11.2.2."""
    if data[:8] != b"\x89PNG\r\n\x1a\n" or data[12:16] != b"IHDR" or len(data) < 24:
        return None
    width, height = struct.unpack(">II", data[16:24])
    return width, height


def jpeg_size(data: bytes) -> tuple[int, int] | None:
    """Return (width, height) that a JPEG declares; None if the data are no JPEG. Source: ITU-T T.81, annex B."""
    if data[:2] != b"\xff\xd8":
        return None
    at = 2
    while at + 9 <= len(data):
        if data[at] != 0xFF:
            return None
        marker, length = data[at + 1], struct.unpack(">H", data[at + 2 : at + 4])[0]
        if marker == 0xFF:  # fill byte
            at += 1
        elif 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            height, width = struct.unpack(">HH", data[at + 5 : at + 9])
            return width, height
        else:
            at += 2 + length
    return None


def source_of(document: Document, texture: Any, where: str) -> int:
    """Return the index of the image that a texture shows."""
    entry = document.entry("textures", texture, where)
    if "source" not in entry:
        document.fail(f"textures[{texture}]", f"has no PNG or JPEG source: {REMEDY['KHR_texture_basisu']}")
    document.entry("images", entry["source"], f"textures[{texture}].source")
    return int(entry["source"])


@dataclass(frozen=True, slots=True, eq=False)
class TexturedMaterial:
    """A material, and how a mesh maps its texture."""

    material: Material
    uv_set: int = 0  # n of TEXCOORD_n, the attribute with the coordinates of the texture
    uv_scale: tuple[float, float] = (1.0, 1.0)
    uv_turn: float = 0.0  # rad
    uv_offset: tuple[float, float] = (0.0, 0.0)

    def uv(self, raw: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return texture coordinates (V, 2) after KHR_texture_transform; `raw` itself if nothing changes."""
        if self.uv_scale == (1.0, 1.0) and self.uv_turn == 0.0 and self.uv_offset == (0.0, 0.0):
            return raw
        c, s = np.cos(self.uv_turn), np.sin(self.uv_turn)
        scaled = raw * np.array(self.uv_scale)
        return np.asarray(scaled @ np.array([[c, -s], [s, c]]) + np.array(self.uv_offset), np.float32)


def standard(material: Material) -> dict[str, Any]:
    """Return the fields of the glTF material that looks most like `material`, without textures."""
    color = [min(max(float(c), 0.0), 1.0) for c in material.color]
    fields: dict[str, Any] = {
        "pbrMetallicRoughness": {
            "baseColorFactor": [*color, 1.0],
            "metallicFactor": 0.0,
            "roughnessFactor": 1.0 - min(max(material.specular, 0.0), 1.0),
        },
        "doubleSided": True,
    }
    if material.cutout is not None:
        fields |= {"alphaMode": "MASK", "alphaCutoff": CUTOFF}
    if material.emission > 0.0:
        fields["emissiveFactor"] = [c * min(material.emission, 1.0) for c in color]
    return fields


def used_images(document: Document, materials: set[int]) -> set[int]:
    """Return the indices of the images that some materials show."""
    images = set()
    for k in materials:
        texture = _texture(document, document.entry("materials", k, "material"), f"materials[{k}]")
        if texture is not None:
            images.add(source_of(document, texture.get("index"), f"materials[{k}].baseColorTexture.index"))
    return images


def read(document: Document, index: int, images: Images) -> TexturedMaterial:
    """Return a material of the file. Metalness, normal maps and partial transparency are ignored."""
    entry, where = document.entry("materials", index, "material"), f"materials[{index}]"
    name = document.name_of(entry) or f"material-{index}"
    color, specular = _surface(document, entry, where)
    texture, picture, cutout = _texture(document, entry, where), None, None
    if texture is not None:
        source = source_of(document, texture.get("index"), f"{where}.baseColorTexture.index")
        mode = entry.get("alphaMode", "OPAQUE")
        picture, cutout = images.picture(source, None if mode == "OPAQUE" else _cutoff(document, entry, where))
        cutout = cutout if mode == "MASK" else None
    red, green, blue = (max(c, 0.0) for c in document.numbers(entry, "emissiveFactor", where, (0.0, 0.0, 0.0)))
    shine = (red, green, blue)
    emission = 0.0
    if max(color) <= 1e-3 < max(shine):  # a lamp: black, apart from its own light
        color, emission = shine, 1.0
    elif sum(shine) > 0.0 and "emissiveTexture" not in entry:
        emission = min(sum(shine) / max(sum(color), 1e-3), 1.0)
    made = Material(name, color, picture, emission, specular, cutout=cutout)
    made = _ours(document, entry, where, made) or made
    if texture is None:
        return TexturedMaterial(made)
    uv_set = document.natural(texture, "texCoord", f"{where}.baseColorTexture", 0)
    moved = document.extension(texture, "KHR_texture_transform", f"{where}.baseColorTexture") or {}
    place = f"{where}.KHR_texture_transform"
    scale = document.numbers(moved, "scale", place, (1.0, 1.0))
    offset = document.numbers(moved, "offset", place, (0.0, 0.0))
    turn = document.number(moved, "rotation", place, 0.0)
    uv_set = document.natural(moved, "texCoord", place, uv_set)
    return TexturedMaterial(made, uv_set, (scale[0], scale[1]), turn, (offset[0], offset[1]))


def _surface(document: Document, entry: Mapping[str, Any], where: str) -> tuple[Vec3, float]:
    """Return (linear colour, specular). Specular is 1 − roughness, or the glossiness."""
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
    """Return the reference to a material's colour texture, or to its emissive texture if the colour is black.

    None for a material without such a texture.
    """
    older = document.extension(entry, "KHR_materials_pbrSpecularGlossiness", where)
    if older is not None and "diffuseTexture" in older:
        return document.mapping(older, "diffuseTexture", f"{where}.diffuseTexture")
    pbr = document.mapping(entry, "pbrMetallicRoughness", f"{where}.pbrMetallicRoughness")
    if "baseColorTexture" in pbr:
        return document.mapping(pbr, "baseColorTexture", f"{where}.baseColorTexture")
    if "emissiveTexture" in entry and max(_surface(document, entry, where)[0]) <= 1e-3:
        return document.mapping(entry, "emissiveTexture", f"{where}.emissiveTexture")
    return None


def _cutoff(document: Document, entry: Mapping[str, Any], where: str) -> float:
    """Return the least alpha of the texture at which a material is opaque."""
    pbr = document.mapping(entry, "pbrMetallicRoughness", f"{where}.pbrMetallicRoughness")
    factor = document.numbers(pbr, "baseColorFactor", where, (1.0, 1.0, 1.0, 1.0))[3]
    return document.number(entry, "alphaCutoff", where, CUTOFF) / max(factor, 1e-6)


def _ours(document: Document, entry: Mapping[str, Any], where: str, read: Material) -> Material | None:
    """Return the exact material from the extras; None without extras, or if the standard fields were changed since."""
    look = document.mapping(entry, "extras", f"{where}.extras").get(EXTRA) if "extras" in entry else None
    if not isinstance(look, list) or len(look) not in (5, 7):  # files of earlier versions have no drift and no foliage
        return None
    if not all(isinstance(v, int | float) and not isinstance(v, bool) and 0.0 <= v <= 4.0 for v in look):
        return None
    red, green, blue, emission, specular, drift, foliage = (float(v) for v in (*look, 0.0, 0.0)[:7])
    exact = replace(
        read, color=(red, green, blue), emission=emission, specular=specular, drift=drift, foliage=foliage > 0.0
    )
    pbr = document.mapping(entry, "pbrMetallicRoughness", where)
    written = (
        *document.numbers(pbr, "baseColorFactor", where, (1.0, 1.0, 1.0, 1.0)),
        document.number(pbr, "roughnessFactor", where, 1.0),
        *document.numbers(entry, "emissiveFactor", where, (0.0, 0.0, 0.0)),
    )
    fields = standard(exact)
    surface = fields["pbrMetallicRoughness"]
    wanted = (*surface["baseColorFactor"], surface["roughnessFactor"], *fields.get("emissiveFactor", (0.0, 0.0, 0.0)))
    return exact if np.allclose(written, wanted, rtol=0.0, atol=1e-5) else None
