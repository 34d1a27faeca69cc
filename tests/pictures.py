"""Pictures that the tests read back."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray


def read(path: Path, flags: int = cv2.IMREAD_COLOR) -> NDArray[np.uint8]:
    """Return the picture in a file, (H, W, 3) BGR or (H, W) as `flags` say; there has to be one."""
    picture: NDArray[np.uint8] | None = cv2.imread(str(path), flags)
    assert picture is not None, path
    return picture
