"""The frame as the model gets it: resized only when wider than 640 px, JPEG quality 85. Paper, "API Request Format"."""

import cv2
import numpy as np
from numpy.typing import NDArray

WIDTH_MAX = 640  # px
QUALITY = 85


def encode(image_rgb: NDArray[np.uint8]) -> bytes:
    """Return the JPEG of an (H, W, 3) RGB image, aspect ratio kept."""
    height, width = image_rgb.shape[:2]
    if width > WIDTH_MAX:
        size = (WIDTH_MAX, round(height * WIDTH_MAX / width))
        image_rgb = cv2.resize(image_rgb, size, interpolation=cv2.INTER_AREA)  # area: small text is lost last
    ok, data = cv2.imencode(".jpg", cv2.cvtColor(image_rgb, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    if not ok:
        raise ValueError(f"an image of shape {image_rgb.shape} cannot be written as JPEG")
    return data.tobytes()
