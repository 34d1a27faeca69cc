"""From the light of each pixel to the picture: edges smoothed by what the samples around each pixel see, then sRGB."""

import numpy as np
from numpy.typing import NDArray

from episodes.camera.renderer.sky import STEPS, WHITE
from foundation.compiled import njit


@njit(cache=True, nogil=True)
def resolve_rows(
    thread: int,
    threads: int,
    samples: NDArray[np.int32],
    plane: NDArray[np.int32],
    light: NDArray[np.float32],
    table: NDArray[np.uint8],
    rgb: NDArray[np.uint8],
) -> None:
    """Write this thread's rows of `rgb` (H, W, 3) from `light` (H, W, 3 linear, 0 … WHITE) and `display_table`.

    A pixel whose nine samples see one flat piece keeps its colour. Elsewhere each sample counts with the weight of a
    tent one pixel wide on either side, and brings the colour of the pixel beside it that sees the same piece; a piece
    that no neighbouring middle sees is left out.
    """
    height, width = rgb.shape[:2]
    scale, half = np.float32(STEPS / WHITE), np.float32(0.5)
    for y in range(thread, height, threads):
        j = 2 * y + 1
        above, here, below = samples[j - 1], samples[j], samples[j + 1]
        shaded, shown = light[y], rgb[y]
        for x in range(width):
            i = 2 * x + 1
            t = here[i]
            same = (
                above[i - 1] == t
                and above[i] == t
                and above[i + 1] == t
                and here[i - 1] == t
                and here[i + 1] == t
                and below[i - 1] == t
                and below[i] == t
                and below[i + 1] == t
            )
            r = shaded[x, 0]
            g = shaded[x, 1]
            b = shaded[x, 2]
            if not same:
                piece = plane[t] if t >= 0 else -1
                total = np.float32(4.0)
                r *= total
                g *= total
                b *= total
                for dy in range(-1, 2):
                    for dx in range(-1, 2):
                        if dx == 0 and dy == 0:
                            continue
                        s = samples[j + dy, i + dx]
                        wanted = plane[s] if s >= 0 else -1
                        qy, qx = y, x
                        if wanted != piece:
                            qy, qx = _find(samples, plane, wanted, y, x, dy, dx, height, width)
                            if qy < 0:
                                continue
                        w = np.float32((2 - abs(dx)) * (2 - abs(dy)))
                        r += w * light[qy, qx, 0]
                        g += w * light[qy, qx, 1]
                        b += w * light[qy, qx, 2]
                        total += w
                r /= total
                g /= total
                b /= total
            shown[x, 0] = table[int(r * scale + half)]
            shown[x, 1] = table[int(g * scale + half)]
            shown[x, 2] = table[int(b * scale + half)]


@njit(cache=True, nogil=True)
def _find(
    samples: NDArray[np.int32],
    plane: NDArray[np.int32],
    wanted: int,
    y: int,
    x: int,
    dy: int,
    dx: int,
    height: int,
    width: int,
) -> tuple[int, int]:
    """Return the pixel beside the sample (dy, dx) of pixel (y, x) whose middle sees the piece `wanted`, or (-1, -1)."""
    for choice in range(3):
        qy = y + (dy if choice != 1 else 0)
        qx = x + (dx if choice != 2 else 0)
        if 0 <= qy < height and 0 <= qx < width:
            s = samples[2 * qy + 1, 2 * qx + 1]
            if (plane[s] if s >= 0 else -1) == wanted:
                return qy, qx
    return -1, -1
