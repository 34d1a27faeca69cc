"""Pictures as arrays, for harnesses that want no JPEG."""

import cv2
import numpy as np
from numpy.typing import NDArray

from foundation.camera import CameraModel
from foundation.picture import WIDTH_MAX

_CAMERA = CameraModel()
PICTURE_SHAPE = (_CAMERA.height * WIDTH_MAX // _CAMERA.width, WIDTH_MAX, 3)  # as models get it: height, width, RGB


def picture(jpeg: bytes) -> NDArray[np.uint8]:
    """Return a JPEG as (height, width, 3) RGB."""
    decoded = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    return np.asarray(cv2.cvtColor(decoded, cv2.COLOR_BGR2RGB), np.uint8)
