"""Prepares pictures of cut-out textures."""

import numpy as np
from numpy.typing import NDArray


def fill_holes(picture: NDArray[np.uint8], there: NDArray[np.bool_]) -> None:
    """Set the holes of a picture (H, W, 3) to the mean colour of its opaque texels, in place.

    `there` (H, W) is true for opaque texels. The original colours of holes would show as specks at their edges.
    """
    if there.any():
        picture[~there] = picture[there].mean(axis=0).astype(np.uint8)
