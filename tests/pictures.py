"""Reads picture files in tests."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray


def read(path: Path, flags: int = cv2.IMREAD_COLOR) -> NDArray[np.uint8]:
    """Return the picture in a file, (H, W, 3) BGR or (H, W), depending on `flags`. Fails without a picture."""
    picture: NDArray[np.uint8] | None = cv2.imread(str(path), flags)
    assert picture is not None, path
    return picture
