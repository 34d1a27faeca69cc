"""What is to be flown, resolved before anything is started."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dronecats.agent.latency import Latency, latency
from dronecats.agent.models.model import Request
from dronecats.pilots import roster
from episodes import catalogue
from episodes.optics.file import load as load_optics
from episodes.optics.options import Optics
from episodes.record import EpisodeRecord
from foundation.camera import CameraModel
from foundation.errors import UsageError
from hil.link.envelope import SIMULATED, Limits
from hil.link.envelope_file import load as load_envelope
from vehicles import airframe as airframes

SEED_MAX = 2**31 - 1
LOCKSTEP_LATENCY = "fixed:0.5"  # two replies a second, the paper's smallest model served alone; see docs/latency.md
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
    rendered: bool = True  # False: grey frames, for a pilot that does not look at them
    optics: Optics | None = None  # what the camera and the weather are like; None: as in the benchmark
    limits: Limits | None = SIMULATED  # the safety envelope; None: none at all
    autopilot: str = "ours"  # or px4: a real PX4 flies the simulated vehicle
    px4: str | None = None  # the command that starts it; None: it is waited for

    @property
    def camera(self) -> dict[str, Any] | None:
        """Return what run.json says of the camera: its geometry, and the options that are not the benchmark's."""
        if not self.rendered:
            return None
        return {**CAMERA, "optics": self.optics.as_dict()} if self.optics else CAMERA

    @property
    def pilot_name(self) -> str:
        return self.pilot or self.model or ""


def resolve(
    *,
    episode: str | None = None,
    pilot: str | None = None,
    model: str | None = None,
    base_url: str | None = None,
    factor: str | None = None,
    latency: str | None = None,
    seed: int | None = None,
    airframe: str | None = None,
    prompt_file: Path | None = None,
    full: bool = False,
    rendered: bool = True,
    optics_file: Path | None = None,
    envelope_file: Path | None = None,
    unlimited: bool = False,
    autopilot: str | None = None,
    px4: str | None = None,
) -> Plan:
    """Return the plan that a user's words ask for, None standing for the default. Raises UsageError."""
    multiple = speed(factor or "1")
    seed = 0 if seed is None else seed
    if not 0 <= seed <= SEED_MAX:
        raise UsageError(f"--seed wants a whole number from 0 to {SEED_MAX}, got {seed}")
    airframes.load(airframe or "x500")
    if unlimited and envelope_file:
        raise UsageError("--no-envelope and --envelope FILE contradict each other; choose one")
    if not rendered and (model or roster.looks(pilot or "vision")):
        raise UsageError(
            "only the oracle and the blind can fly without rendering; every other pilot looks at the frames"
        )
    if px4 and autopilot != "px4":
        raise UsageError("--px4 goes with --autopilot px4; add it or leave --px4 out")
    return Plan(
        episode=episode or catalogue.DEFAULT,
        record=catalogue.load(episode or catalogue.DEFAULT),
        pilot=None if model else roster.check(pilot or "vision"),
        model=model,
        base_url=base_url,
        speed=multiple,
        latency=latency_for(latency, multiple),
        seed=seed,
        airframe=airframe or "x500",
        prompt_file=prompt_file,
        full=full,
        rendered=rendered,
        optics=load_optics(optics_file) if optics_file else None,
        limits=None if unlimited else load_envelope(envelope_file, SIMULATED) if envelope_file else SIMULATED,
        autopilot=autopilot or "ours",
        px4=px4,
    )


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
    """Return the latency policy: by default latency passes as it passes, and in lockstep every reply costs the same."""
    if text is None:
        return latency(LOCKSTEP_LATENCY if factor is None else "real")
    policy = latency(text)
    if factor is None and policy.charge is None:
        raise UsageError(
            "--latency real has no meaning with --speed max, where the vehicle's clock waits; use fixed:SECONDS"
        )
    return policy
