"""What is to be flown, resolved before anything is started."""

from dataclasses import dataclass
from pathlib import Path

from dronecats.agent.latency import Latency, latency
from dronecats.agent.model import Request
from dronecats.border.camera import CameraModel
from dronecats.border.errors import UsageError
from episodes.record import EpisodeRecord

_DEFAULT, _CAMERA = Request("", (), False), CameraModel()
SAMPLING = {"temperature": _DEFAULT.temperature, "max_tokens": _DEFAULT.max_tokens}
CAMERA = {"width": _CAMERA.width, "height": _CAMERA.height, "hfov_deg": _CAMERA.hfov_deg}


@dataclass(frozen=True, slots=True)
class Plan:
    """One episode under one pilot."""

    episode: str  # id or file, as it was asked for
    record: EpisodeRecord
    pilot: str | None  # a built-in pilot; None when `model` flies
    model: str | None  # PROVIDER/NAME
    base_url: str | None
    speed: float | None  # × real time; None: lockstep, as fast as it goes
    latency: Latency
    seed: int
    airframe: str
    prompt_file: Path | None
    full: bool  # fly to the cap although the verdict is decided

    @property
    def pilot_name(self) -> str:
        return self.pilot or self.model or ""


def speed(text: str) -> float | None:
    """Return the factor on real time that --speed asks for; None for `max`. Raises UsageError."""
    if text == "max":
        return None
    try:
        factor = float(text)
    except ValueError:
        factor = 0.0
    if not 0.01 <= factor <= 100.0:
        raise UsageError(f"--speed wants max or a factor from 0.01 to 100, got '{text}'")
    return factor


def latency_for(text: str | None, factor: float | None) -> Latency:
    """Return the latency policy: by default latency passes as it passes, and in lockstep it is charged as measured."""
    if text is None:
        return latency("measured" if factor is None else "real")
    policy = latency(text)
    if factor is None and policy.charge is None:
        raise UsageError(
            "--latency real has no meaning with --speed max, where the vehicle's clock waits; use measured"
        )
    return policy
