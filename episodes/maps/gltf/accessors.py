"""Arrays in a glTF file: accessors, checked against the bytes that are there. Source: glTF 2.0, section 3.6.2."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from episodes.maps.gltf.document import Document

COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


def count(document: Document, index: Any, where: str) -> int:
    """Return how many elements an accessor declares, before anything of it is read."""
    entry = document.entry("accessors", index, where)
    return document.whole(entry, "count", f"accessors[{index}]")


def vectors(document: Document, index: Any, where: str, *widths: int) -> NDArray[np.float32]:
    """Return an accessor's vectors (count, width) as floats, whole numbers scaled if it says that they are normalised.

    Raises UsageError unless its width is one of `widths` and all of it lies in the file and is finite.
    """
    raw, normalised = _elements(document, index, where, widths)
    if raw.dtype.kind == "f":
        if not np.isfinite(raw).all():
            document.fail(f"accessors[{index}]", "holds numbers that are not finite")
        return raw.astype(np.float32)
    floats = raw.astype(np.float32)
    return np.maximum(floats / np.float32(np.iinfo(raw.dtype).max), np.float32(-1.0)) if normalised else floats


def indices(document: Document, index: Any, where: str, vertices: int) -> NDArray[np.int32]:
    """Return an accessor's (count,) indices. Raises UsageError unless each names one of `vertices` vertices."""
    raw, _ = _elements(document, index, where, (1,))
    if raw.dtype.kind != "u":
        document.fail(f"accessors[{index}]", "holds indices that are not unsigned whole numbers")
    if raw.size and int(raw.max()) >= vertices:
        document.fail(f"accessors[{index}]", f"points at vertex {int(raw.max())} of {vertices}")
    return raw[:, 0].astype(np.int32)


def _elements(document: Document, index: Any, where: str, widths: tuple[int, ...]) -> tuple[NDArray[Any], bool]:
    """Return an accessor's elements (count, width) as a view of the file, and whether they are normalised."""
    entry = document.entry("accessors", index, where)
    name = f"accessors[{index}]"
    if "sparse" in entry:
        document.fail(name, "is sparse, which is not supported: export it without sparse accessors")
    if "bufferView" not in entry:
        document.fail(name, "has no bufferView, so there is nothing in it")
    component, kind = entry.get("componentType"), entry.get("type")
    if not isinstance(component, int) or component not in COMPONENTS:
        document.fail(f"{name}.componentType", "is none that glTF knows")
    if not isinstance(kind, str) or WIDTHS.get(kind) not in widths:
        document.fail(f"{name}.type", f"does not suit {where}")
    dtype, width = np.dtype(COMPONENTS[component]), WIDTHS[kind]
    view, stride = document.view(entry["bufferView"], f"{name}.bufferView")
    stride = stride or dtype.itemsize * width
    total, offset = count(document, index, where), document.whole(entry, "byteOffset", name, 0)
    if stride < dtype.itemsize * width:
        document.fail(name, f"steps by {stride} bytes over elements of {dtype.itemsize * width}")
    if total == 0:
        document.fail(name, "is empty")
    if offset + stride * (total - 1) + dtype.itemsize * width > len(view):
        document.fail(name, f"declares {total} elements, more than its {len(view)} bytes hold")
    elements = np.ndarray((total, width), dtype, view, offset, (stride, dtype.itemsize))
    return elements, entry.get("normalized") is True
