"""The picture that a real camera would take: scene, haze, exposure, rain, lens, noise, in this order."""

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from episodes.camera.optics import weather
from episodes.camera.optics.lens import BentLens, Codes, Light
from episodes.camera.optics.options import LensModel, Optics, Rain, Sensor
from episodes.camera.renderer.layout import camera_pose
from episodes.camera.renderer.renderer import Renderer
from episodes.camera.renderer.sky import WHITE, daylight
from episodes.maps.scene import Moved, Scene, Sun
from foundation.camera import CameraModel, CameraPose
from foundation.frames import Quat, Vec3, quat_integrate


@dataclass(frozen=True, slots=True)
class VehicleMotion:
    """A vehicle at the instant of a frame."""

    time_s: float  # s, of the scene's own motion
    position_ned: Vec3  # m, body origin
    velocity_ned: Vec3  # m/s
    attitude: Quat  # FRD → NED
    rates_frd: Vec3  # rad/s, body

    def after(self, seconds: float) -> "VehicleMotion":
        """Return where it is a little later, at constant velocity and rates."""
        p, v, w = self.position_ned, self.velocity_ned, self.rates_frd
        return dataclasses.replace(
            self,
            time_s=self.time_s + seconds,
            position_ned=(p[0] + v[0] * seconds, p[1] + v[1] * seconds, p[2] + v[2] * seconds),
            attitude=quat_integrate(self.attitude, (w[0] * seconds, w[1] * seconds, w[2] * seconds)),
        )


class OpticalRenderer:
    """Draws one scene through one camera with `optics` before, in and behind its lens.

    The bytes depend on scene, camera, optics, motion and what is drawn from alone. Only the picture is changed: depth,
    ids and visibility are the geometry's.
    """

    def __init__(self, scene: Scene, camera: CameraModel, optics: Optics, threads: int = 2) -> None:
        """Raises UsageError as `Renderer` does, ValueError for a lens or a sun that cannot be."""
        sun = lit(scene.sun, optics)
        self._optics, self._camera = optics, camera
        self._lens = BentLens(optics.lens or LensModel(), camera)
        self._renderer = Renderer(dataclasses.replace(scene, sun=sun), self._lens.wide, threads)
        self._codes = Codes()
        self._air = weather.haze_color(optics.haze, daylight(sun).horizon)

    def picture(
        self, motion: VehicleMotion, moved: Callable[[float], Moved], drawn_from: Sequence[int]
    ) -> NDArray[np.uint8]:
        """Return the (H, W, 3) sRGB picture of a frame; `moved` tells what stands where at a time (s).

        `drawn_from`: what tells it from every other picture: of this and the options' seed are noise and drops.
        """
        optics, rng = self._optics, np.random.default_rng((self._optics.seed, *drawn_from))
        exposure = optics.exposure
        shutter, poses = (exposure.time_s, exposure.poses) if exposure and exposure.time_s > 0.0 else (0.0, 1)
        seen = [self._seen(motion.after(shutter * ((k + 0.5) / poses - 0.5)), moved) for k in range(poses)]
        light = seen[0][0]
        for other, _ in seen[1:]:
            light += other
        light /= np.float32(poses)
        if optics.rain is not None:
            light = self._rained(light, seen[poses // 2][1], motion, optics.rain, shutter or weather.SHUTTER_S, rng)
        light = self._lens.through(light)
        if optics.sensor is not None:
            light = noisy(light, optics.sensor, rng)
        return self._codes.shown(light)

    def close(self) -> None:
        """Let the renderer's threads go."""
        self._renderer.close()

    def _pose(self, motion: VehicleMotion) -> CameraPose:
        return camera_pose(motion.position_ned, motion.attitude, self._camera)

    def _seen(self, motion: VehicleMotion, moved: Callable[[float], Moved]) -> tuple[Light, NDArray[np.float32]]:
        """Return the light of the scene at one instant, through the air, and its planar depth (m)."""
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

    def _rained(
        self,
        light: Light,
        depth: NDArray[np.float32],
        motion: VehicleMotion,
        drops: Rain,
        shutter_s: float,
        rng: np.random.Generator,
    ) -> Light:
        """Return `light` with the streaks of drops that are nearer than `depth` (m)."""
        mask = weather.streaks(
            depth,
            self._pose(motion),
            motion.velocity_ned,
            drops.wind_ned,
            drops.rate_mm_h,
            shutter_s,
            self._lens.wide,
            rng,
        )
        return weather.add_streaks(light, mask, self._air)


def lit(sun: Sun, optics: Optics) -> Sun:
    """Return the sun as the options have it. Raises ValueError for one that is not up."""
    if optics.sun is not None:
        sun = weather.moved_sun(sun, optics.sun)
    return weather.overcast(sun) if optics.rain is not None else sun


def noisy(light: Light, sensor: Sensor, rng: np.random.Generator) -> Light:
    """Return `light` as counted by a sensor: variance in electrons = signal (shot noise) + read noise squared.

    Poisson's distribution is taken as normal, which it is to the eye from some twenty electrons on.
    """
    per_light = sensor.full_well_e / WHITE
    electrons = np.maximum(light, 0.0) * np.float32(per_light)
    spread = np.sqrt(electrons + np.float32(sensor.read_noise_e**2))
    electrons += spread * rng.standard_normal(light.shape, dtype=np.float32)
    return (electrons / np.float32(per_light)).astype(np.float32)
