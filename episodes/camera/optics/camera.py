"""Draws the picture of a real camera: scene, haze, exposure, rain, lens and noise, applied in this order."""

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from episodes.camera.optics import weather
from episodes.camera.optics.options import LensModel, Optics, Sensor
from episodes.camera.optics.weather import Light
from episodes.camera.renderer.renderer import Renderer
from episodes.camera.renderer.sky import STEPS, WHITE, daylight, display_table
from episodes.maps.conditions import overcast
from episodes.maps.scene import Moved, Scene
from foundation.camera import CameraModel, CameraPose, camera_pose
from foundation.frames import Quat, Vec3, quat_integrate

WIDEST = 2.0  # a lens is rejected if it needs a pinhole picture over this many times as wide or high as the camera's
ROUNDS = 15  # iterations of the inversion in `pinhole_rays`; a lens that needs more is rejected
FARTHEST = 10.0  # the inversion clips x / z and y / z to ± this value: 84° off the axis
MISS_PX = 0.05  # error that the inversion may have, for a focal length of 640 px


@dataclass(frozen=True, slots=True)
class VehicleMotion:
    """The motion of a vehicle at the time of a frame."""

    time_s: float  # s, the argument of `moved` in `OpticalRenderer.picture`
    position_ned: Vec3  # m, body origin
    velocity_ned: Vec3  # m/s
    attitude: Quat  # FRD → NED
    rates_frd: Vec3  # rad/s, body
    gimbal_pitch: float | None = None  # rad, up from the horizon; None: the camera has no gimbal

    def after(self, seconds: float) -> "VehicleMotion":
        """Return the motion `seconds` later, at constant velocity and rates."""
        p, v, w = self.position_ned, self.velocity_ned, self.rates_frd
        return dataclasses.replace(
            self,
            time_s=self.time_s + seconds,
            position_ned=(p[0] + v[0] * seconds, p[1] + v[1] * seconds, p[2] + v[2] * seconds),
            attitude=quat_integrate(self.attitude, (w[0] * seconds, w[1] * seconds, w[2] * seconds)),
        )


class OpticalRenderer:
    """Draws one scene through one camera with the effects of `optics`.

    The bytes depend only on scene, camera, optics, motion and seeds. The effects change only the picture. Depth, ids
    and visibility come from the geometry.
    """

    def __init__(self, scene: Scene, camera: CameraModel, optics: Optics, threads: int = 2) -> None:
        """Raises UsageError as `Renderer` does, and ValueError as `wide_camera` does."""
        sun = overcast(scene.sun) if optics.rain is not None else scene.sun
        self._optics, self._camera = optics, camera
        self._lens = BentLens(optics.lens or LensModel(), camera)
        self._renderer = Renderer(dataclasses.replace(scene, sun=sun), self._lens.wide, threads)
        self._codes = Codes()
        # the colour of the haze: the option's colour, else the colour of the sky at the horizon
        self._air = (optics.haze.color if optics.haze else None) or daylight(sun).horizon

    def picture(
        self, motion: VehicleMotion, moved: Callable[[float], Moved], drawn_from: Sequence[int]
    ) -> NDArray[np.uint8]:
        """Return the (H, W, 3) sRGB picture of a frame.

        `moved` returns the poses of moving instances at a time (s). `drawn_from` identifies the picture. Together with
        the seed of the options, it seeds noise and drops.
        """
        optics, rng = self._optics, np.random.default_rng((self._optics.seed, *drawn_from))
        exposure = optics.exposure
        shutter, poses = (exposure.time_s, exposure.poses) if exposure and exposure.time_s > 0.0 else (0.0, 1)
        seen = [self._seen(motion.after(shutter * ((k + 0.5) / poses - 0.5)), moved) for k in range(poses)]
        light = seen[0][0]
        for later, _ in seen[1:]:
            light += later
        light /= np.float32(poses)
        if optics.rain is not None:
            drops = weather.streaks(
                seen[poses // 2][1],
                self._pose(motion),
                motion.velocity_ned,
                optics.rain.wind_ned,
                optics.rain.rate_mm_h,
                shutter or weather.SHUTTER_S,
                self._lens.wide,
                rng,
            )
            light = weather.add_streaks(light, drops, self._air)
        light = self._lens.through(light)
        if optics.sensor is not None:
            light = noisy(light, optics.sensor, rng)
        return self._codes.shown(light)

    def close(self) -> None:
        """Stop the renderer's threads."""
        self._renderer.close()

    def _pose(self, motion: VehicleMotion) -> CameraPose:
        return camera_pose(motion.position_ned, motion.attitude, self._camera.at_pitch(motion.gimbal_pitch))

    def _seen(self, motion: VehicleMotion, moved: Callable[[float], Moved]) -> tuple[Light, NDArray[np.float32]]:
        """Return the light of the scene at one instant, through haze and rain, and the scene's planar depth (m)."""
        haze, drops, pose = self._optics.haze, self._optics.rain, self._pose(motion)
        view = self._renderer.render(pose, moved(motion.time_s))
        light = self._codes.light(view.rgb)
        for density, height in (
            (haze.density_per_m if haze else 0.0, haze.height_m if haze else 0.0),
            (weather.veil(drops.rate_mm_h) if drops else 0.0, weather.CLOUDS_M),
        ):
            if density > 0.0:
                path = weather.path_in_layer(view.depth, pose, self._lens.wide, height)
                light = weather.add_haze(light, path, density, self._air)
        return light, view.depth


def noisy(light: Light, sensor: Sensor, rng: np.random.Generator) -> Light:
    """Return `light` with the noise of a sensor: variance in electrons = signal (shot noise) + read noise squared.

    A normal distribution replaces the Poisson distribution: above about twenty electrons, they look alike.
    """
    per_light = sensor.full_well_e / WHITE
    electrons = np.maximum(light, 0.0) * np.float32(per_light)
    spread = np.sqrt(electrons + np.float32(sensor.read_noise_e**2))
    electrons += spread * rng.standard_normal(light.shape, dtype=np.float32)
    return (electrons / np.float32(per_light)).astype(np.float32)


def decoding_table() -> NDArray[np.float32]:
    """Return (256,): for each sRGB code, the light in the middle of the range that has this code."""
    codes = display_table()
    steps = np.arange(STEPS + 1)
    first, last = np.searchsorted(codes, np.arange(256)), np.searchsorted(codes, np.arange(256), side="right") - 1
    middle: NDArray[np.int64] = steps[(first + last) // 2]
    middle[0], middle[255] = 0, STEPS  # black: no light; white: the most light that the sensor measures
    return (middle * (WHITE / STEPS)).astype(np.float32)


class Codes:
    """Converts between sRGB codes and light, both ways."""

    def __init__(self) -> None:
        self._light, self._code = decoding_table(), display_table()

    def light(self, rgb: NDArray[np.uint8]) -> Light:
        """Return the light of an (H, W, 3) sRGB picture."""
        return self._light[rgb]

    def shown(self, light: Light) -> NDArray[np.uint8]:
        """Return the (H, W, 3) sRGB picture of a light, clipped to 0 … WHITE."""
        scaled = np.clip(light, 0.0, WHITE)
        scaled *= STEPS / WHITE
        scaled += 0.5
        return self._code[scaled.astype(np.int32)]


def pinhole_rays(lens: LensModel, camera: CameraModel) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return x / z and y / z, each (H, W), of the undistorted ray through every pixel's middle.

    Inverts OpenCV's model by Newton's method: x' = x (1 + k1 r² + k2 r⁴ + k3 r⁶) + 2 p1 x y + p2 (r² + 2 x²), and y'
    likewise. Raises ValueError for a lens that folds the picture, because its model has no inverse.
    """
    shown_x, shown_y = weather.pixel_slopes(camera)
    x, y = (slopes.copy() for slopes in np.broadcast_arrays(shown_x, shown_y))
    for _ in range(ROUNDS):
        radial, dx, dy = _terms(lens, x, y)
        miss_x, miss_y = x * radial + dx - shown_x, y * radial + dy - shown_y
        r2 = x * x + y * y
        steep = 2.0 * (lens.k1 + r2 * (2.0 * lens.k2 + 3.0 * lens.k3 * r2))  # derivative of `radial` by r²/2
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
        raise ValueError("[lens] with these coefficients the picture overlaps itself. Give smaller ones")
    return x, y


def _terms(lens: LensModel, x: NDArray[np.float64], y: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
    r2 = x * x + y * y
    radial = 1.0 + r2 * (lens.k1 + r2 * (lens.k2 + r2 * lens.k3))
    dx = 2.0 * lens.p1 * x * y + lens.p2 * (r2 + 2.0 * x * x)
    dy = lens.p1 * (r2 + 2.0 * y * y) + 2.0 * lens.p2 * x * y
    return radial, dx, dy


def _folds(lens: LensModel, r_max: float) -> bool:
    """Return whether the distorted radius stops growing somewhere within `r_max`."""
    r = np.linspace(0.0, r_max, 1000)
    r2 = r * r
    return bool((1.0 + r2 * (3.0 * lens.k1 + r2 * (5.0 * lens.k2 + 7.0 * r2 * lens.k3)) <= 0.0).any())


def wide_camera(lens: LensModel, camera: CameraModel) -> CameraModel:
    """Return a pinhole camera of the same focal length that covers the view of the lens.

    Return `camera` for a lens without distortion. Raises ValueError for a lens that folds the picture, or needs a
    picture more than `WIDEST` times as wide or high.
    """
    if not lens.bends:
        return camera
    x, y = pinhole_rays(lens, camera)
    width = 2 * math.ceil(max(np.abs(x).max() * camera.focal_px, 0.5 * camera.width) + 1.5)
    height = 2 * math.ceil(max(np.abs(y).max() * camera.focal_px, 0.5 * camera.height) + 1.5)
    if width > WIDEST * camera.width or height > WIDEST * camera.height:
        raise ValueError(
            f"[lens] these coefficients show more than {WIDEST:g} times the camera's width or height. Give smaller ones"
        )
    hfov = math.degrees(2.0 * math.atan(0.5 * width / camera.focal_px))
    return CameraModel(width, height, hfov, camera.offset_frd)


class BentLens:
    """Applies the distortion and the vignetting of a lens to the light of a wide pinhole camera."""

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
    """Return the share (H, W, 1) of light that reaches each pixel: 1 − vignetting · (1 − cos⁴(angle to the axis)).

    None for a lens without vignetting.
    """
    if not lens.vignetting:
        return None
    x, y = weather.pixel_slopes(camera)
    natural = 1.0 / (1.0 + x**2 + y**2) ** 2
    return (1.0 - lens.vignetting * (1.0 - natural))[..., None].astype(np.float32)
