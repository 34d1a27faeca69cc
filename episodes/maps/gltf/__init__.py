"""Reads and writes maps as glTF 2.0 binary files. `save` writes a built map; `load` reads a map from any program.

glTF axes are right-handed with +Y up, in metres. In NED axes, north = −Z, east = +X and down = −Y. In the same way, an
asset's forward, right and down axes are −Z, +X and −Y of its node. Source: Khronos glTF 2.0 specification, section 3.4.
"""

from episodes.maps.gltf.reader import load
from episodes.maps.gltf.writer import save

__all__ = ["load", "save"]
