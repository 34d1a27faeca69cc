"""From the codes of a picture to the light that they stand for, and back."""

import numpy as np
from numpy.typing import NDArray

from episodes.camera.renderer.sky import STEPS, WHITE, display_table

Light = NDArray[np.float32]  # (H, W, 3) linear RGB, 0 … WHITE


def decoding_table() -> NDArray[np.float32]:
    """Return the (256,) middle of the lights that each code shows. Encoding it gives the code again."""
    codes = display_table()
    steps = np.arange(STEPS + 1)
    first, last = np.searchsorted(codes, np.arange(256)), np.searchsorted(codes, np.arange(256), side="right") - 1
    middle: NDArray[np.int64] = steps[(first + last) // 2]
    middle[0], middle[255] = 0, STEPS  # black is no light, and white is all that the sensor takes
    return (middle * (WHITE / STEPS)).astype(np.float32)


class Codes:
    """Both directions, with their tables at hand."""

    def __init__(self) -> None:
        self._light, self._code = decoding_table(), display_table()

    def light(self, rgb: NDArray[np.uint8]) -> Light:
        """Return the light of an (H, W, 3) sRGB picture."""
        return self._light[rgb]

    def shown(self, light: Light) -> NDArray[np.uint8]:
        """Return the (H, W, 3) sRGB picture of a light; what is outside 0 … WHITE is cut off."""
        scaled = np.clip(light, 0.0, WHITE)
        scaled *= STEPS / WHITE
        scaled += 0.5
        return self._code[scaled.astype(np.int32)]
