"""Declares the options of camera and weather."""

from dataclasses import asdict, dataclass
from typing import Annotated, Any

from msgspec import Meta

SEED_MAX = 2**31 - 1


def _within(low: float, high: float) -> Meta:
    """Return the bounds of a number. The reader of the TOML file checks them."""
    return Meta(ge=low, le=high)


LinearLight = Annotated[float, _within(0.0, 2.0)]
Speed = Annotated[float, _within(-40.0, 40.0)]


@dataclass(frozen=True, slots=True)
class LensModel:
    """Brown's lens model with OpenCV's names and order of terms, on coordinates divided by the focal length."""

    k1: Annotated[float, _within(-1.0, 1.0)] = 0.0  # radial, factor of r²; negative bends lines outwards (barrel)
    k2: Annotated[float, _within(-1.0, 1.0)] = 0.0  # radial, factor of r⁴
    p1: Annotated[float, _within(-0.1, 0.1)] = 0.0  # tangential
    p2: Annotated[float, _within(-0.1, 0.1)] = 0.0  # tangential
    k3: Annotated[float, _within(-1.0, 1.0)] = 0.0  # radial, factor of r⁶
    vignetting: Annotated[float, _within(0.0, 1.0)] = 0.0  # 0: none; 1: natural, cos⁴ of the angle to the axis

    @property
    def bends(self) -> bool:
        return any((self.k1, self.k2, self.p1, self.p2, self.k3))


@dataclass(frozen=True, slots=True)
class Sensor:
    """Noise of a sensor without colour filter: each channel counts its own electrons."""

    full_well_e: Annotated[float, _within(50.0, 1e6)] = 8000.0  # electrons that a channel counts for white
    read_noise_e: Annotated[float, _within(0.0, 1e4)] = 6.0  # electrons, standard deviation


@dataclass(frozen=True, slots=True)
class Exposure:
    """The exposure. Its middle is the time of the frame."""

    time_s: Annotated[float, _within(0.0, 0.2)] = 0.01  # s that the shutter is open
    poses: Annotated[int, _within(2, 64)] = 8  # number of rendered pictures, whose mean is the blurred picture


@dataclass(frozen=True, slots=True)
class Haze:
    """A level layer of haze above the ground, in addition to the haze of clear air (`sky.HAZE_LENGTH_M`)."""

    density_per_m: Annotated[float, _within(0.0, 0.5)] = 0.005  # 1/m, extinction; the visibility is about 3.9 / density
    height_m: Annotated[float, _within(10.0, 5000.0)] = 300.0  # m, top of the layer above the camera
    # linear RGB 0 … 2; None: the colour of the sky at the horizon
    color: tuple[LinearLight, LinearLight, LinearLight] | None = None


@dataclass(frozen=True, slots=True)
class Rain:
    """Falling drops: near ones are streaks, far ones a veil, and the sky is overcast."""

    rate_mm_h: Annotated[float, _within(0.1, 150.0)] = 10.0  # mm/h: 2 light, 10 steady, 50 a cloudburst
    wind_ned: tuple[Speed, Speed, Speed] = (0.0, 0.0, 0.0)  # m/s, carries the drops along


@dataclass(frozen=True, slots=True)
class Optics:
    """All options. None switches an effect off. `Optics()` is the camera of the benchmark."""

    lens: LensModel | None = None
    sensor: Sensor | None = None
    exposure: Exposure | None = None
    haze: Haze | None = None
    rain: Rain | None = None
    # seed of noise and drops, together with the flight's seed, the drone and the frame's id
    seed: Annotated[int, _within(0, SEED_MAX)] = 0

    def as_dict(self) -> dict[str, Any]:
        """Return the options that are on, as JSON values. `file.optics_of` is the inverse."""
        options = {name: value for name, value in asdict(self).items() if value is not None}
        return {
            name: {key: list(v) if isinstance(v, tuple) else v for key, v in value.items() if v is not None}
            if isinstance(value, dict)
            else value
            for name, value in options.items()
        }
