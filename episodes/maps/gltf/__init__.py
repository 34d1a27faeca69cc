"""Maps as glTF 2.0 binary files: `save` writes a built map, `load` reads one, our own or anybody's.

glTF is right-handed with +Y up, in metres. Ours is north-east-down: north = −Z, east = +X, down = −Y, and an asset's
forward-right-down axes lie in its node's axes the same way. Source: Khronos glTF 2.0 specification, section 3.4.
"""

from episodes.maps.gltf.reader import load
from episodes.maps.gltf.writer import save

__all__ = ["load", "save"]
