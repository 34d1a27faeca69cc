"""A lens that bends straight lines, and light: from the codes of a picture to the light that they stand for."""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from episodes.camera.optics.options import LensModel
from episodes.camera.renderer.sky import STEPS, WHITE, display_table
from foundation.camera import CameraModel

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


WIDEST = 2.0  # times the camera's width and height may be drawn to feed the lens
ROUNDS = 15  # of the inversion; a lens that needs more folds the picture
FARTHEST = 10.0  # focal lengths from the middle: 84° off the axis
MISS_PX = 0.05  # at 1280 px: how well the inversion must hold


def pinhole_rays(lens: LensModel, camera: CameraModel) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (H, W) x / z and y / z of the undistorted ray behind every pixel's middle.

    Inverts OpenCV's model, x' = x (1 + k1 r² + k2 r⁴ + k3 r⁶) + 2 p1 x y + p2 (r² + 2 x²) and y' alike, by
    Newton's method. Raises ValueError for a lens whose model cannot be inverted over the picture, because it folds it.
    """
    shown_x, shown_y = np.meshgrid(
        (np.arange(camera.width) + 0.5 - 0.5 * camera.width) / camera.focal_px,
        (np.arange(camera.height) + 0.5 - 0.5 * camera.height) / camera.focal_px,
    )
    x, y = shown_x.copy(), shown_y.copy()
    for _ in range(ROUNDS):
        radial, dx, dy = _terms(lens, x, y)
        miss_x, miss_y = x * radial + dx - shown_x, y * radial + dy - shown_y
        r2 = x * x + y * y
        steep = 2.0 * (lens.k1 + r2 * (2.0 * lens.k2 + 3.0 * lens.k3 * r2))  # of the radial factor, by r²/2
        xx = radial + x * x * steep + 2.0 * lens.p1 * y + 6.0 * lens.p2 * x
        xy = x * y * steep + 2.0 * lens.p1 * x + 2.0 * lens.p2 * y
        yy = radial + y * y * steep + 6.0 * lens.p1 * y + 2.0 * lens.p2 * x
        area = xx * yy - xy * xy
        area = np.where(np.abs(area) > 1e-3, area, 1e-3)
        x = np.clip(x - (yy * miss_x - xy * miss_y) / area, -FARTHEST, FARTHEST)
        y = np.clip(y - (xx * miss_y - xy * miss_x) / area, -FARTHEST, FARTHEST)
    radial, dx, dy = _terms(lens, x, y)
    miss = np.hypot(x * radial + dx - shown_x, y * radial + dy - shown_y).max()
    if not miss * 640.0 < MISS_PX or _folds(lens, float(np.hypot(x, y).max())):
        raise ValueError("[lens] these coefficients fold the picture over itself; give smaller ones")
    return x, y


def _terms(lens: LensModel, x: NDArray[np.float64], y: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
    r2 = x * x + y * y
    radial = 1.0 + r2 * (lens.k1 + r2 * (lens.k2 + r2 * lens.k3))
    dx = 2.0 * lens.p1 * x * y + lens.p2 * (r2 + 2.0 * x * x)
    dy = lens.p1 * (r2 + 2.0 * y * y) + 2.0 * lens.p2 * x * y
    return radial, dx, dy


def _folds(lens: LensModel, r_max: float) -> bool:
    """Return whether the radial part stops growing somewhere within `r_max`."""
    r = np.linspace(0.0, r_max, 1000)
    r2 = r * r
    return bool((1.0 + r2 * (3.0 * lens.k1 + r2 * (5.0 * lens.k2 + 7.0 * r2 * lens.k3)) <= 0.0).any())


def wide_camera(lens: LensModel, camera: CameraModel) -> CameraModel:
    """Return the pinhole of the same focal length that sees everything that the lens shows.

    Raises ValueError for a lens that folds the picture or shows more than `WIDEST` times the camera's view.
    """
    if not lens.bends:
        return camera
    x, y = pinhole_rays(lens, camera)
    width = 2 * math.ceil(max(np.abs(x).max() * camera.focal_px, 0.5 * camera.width) + 1.5)
    height = 2 * math.ceil(max(np.abs(y).max() * camera.focal_px, 0.5 * camera.height) + 1.5)
    if width > WIDEST * camera.width or height > WIDEST * camera.height:
        raise ValueError(f"[lens] these coefficients show more than {WIDEST:g} times the camera's width or height")
    hfov = math.degrees(2.0 * math.atan(0.5 * width / camera.focal_px))
    return CameraModel(width, height, hfov, camera.offset_frd)


class BentLens:
    """The lens before a camera: takes the wide pinhole's light, gives the camera's."""

    def __init__(self, lens: LensModel, camera: CameraModel) -> None:
        """Raises ValueError as `wide_camera` does."""
        self.wide = wide_camera(lens, camera)
        self._map: tuple[NDArray[np.float32], NDArray[np.float32]] | None = None
        if lens.bends:
            x, y = pinhole_rays(lens, camera)
            self._map = (
                (x * camera.focal_px + 0.5 * self.wide.width - 0.5).astype(np.float32),
                (y * camera.focal_px + 0.5 * self.wide.height - 0.5).astype(np.float32),
            )
        self._shade = _fall_off(lens, camera)

    def through(self, light: Light) -> Light:
        """Return the light (H, W, 3) on the sensor."""
        if self._map is not None:
            light = cv2.remap(light, *self._map, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return light if self._shade is None else light * self._shade


def _fall_off(lens: LensModel, camera: CameraModel) -> NDArray[np.float32] | None:
    """Return (H, W, 1): the share of light that reaches each pixel, cos⁴ of its angle when vignetting is one."""
    if not lens.vignetting:
        return None
    x = (np.arange(camera.width) + 0.5 - 0.5 * camera.width) / camera.focal_px
    y = (np.arange(camera.height) + 0.5 - 0.5 * camera.height) / camera.focal_px
    natural = 1.0 / (1.0 + x[None, :] ** 2 + y[:, None] ** 2) ** 2
    return (1.0 - lens.vignetting * (1.0 - natural))[..., None].astype(np.float32)
