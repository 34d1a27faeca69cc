"""Pictures of cut-out textures."""

import numpy as np
from numpy.typing import NDArray


def fill_holes(picture: NDArray[np.uint8], there: NDArray[np.bool_]) -> None:
    """Give the texels of a picture (H, W, 3) that are not there the mean colour of the others.

    What lies under holes would show as specks at their edges.
    """
    if there.any():
        picture[~there] = picture[there].mean(axis=0).astype(np.uint8)
