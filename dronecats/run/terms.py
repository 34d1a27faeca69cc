"""What a flight of somebody else's vehicle is flown on: who decides, what may be done to the vehicle, within what."""

import argparse
import math
from dataclasses import asdict, dataclass
from typing import Any

from dronecats.agent.latency import Latency
from dronecats.agent.loop import CAP_S
from dronecats.agent.models.openai_chat import ChatModel
from dronecats.agent.models.providers import split
from dronecats.agent.prompt import Prompt
from dronecats.pilots import roster
from dronecats.run.episode import Authority
from dronecats.run.plan import SAMPLING, latency_for
from foundation.errors import UsageError
from foundation.redaction import redacted_url
from hil.link.envelope import Limits
from hil.link.envelope_file import load as load_envelope

SILENCE_S = 30.0  # wall seconds that a cable may be out; what the vehicle does meanwhile is its own failsafe's matter
FRAMES_S = 10.0  # wall seconds without a fresh frame after which the flight ends
PATIENCE_S = 60.0  # s without a reply of the model after which the vehicle is brought to an end of its flight


@dataclass(frozen=True, slots=True)
class Terms:
    """Everything that was asked for and is possible."""

    pilot: str | None  # a built-in pilot; None when `model` flies
    model: str | None  # PROVIDER/NAME
    base_url: str | None
    prompt: Prompt
    latency: Latency
    seconds: float  # of vehicle time, the length of the flight
    patience_s: float
    authority: Authority
    limits: Limits

    @property
    def pilot_name(self) -> str:
        return self.pilot or self.model or ""

    def configuration(self, connect: str, camera: dict[str, Any]) -> dict[str, Any]:
        """Return what run.json holds."""
        return {
            "pilot": self.pilot,
            "model": self.model,
            "base_url": redacted_url(self.base_url) if self.base_url else None,
            "prompt_sha256": self.prompt.digest,
            "sampling": SAMPLING,
            "clock": "the vehicle's",
            "latency": self.latency.name,
            "connect": connect,
            "camera": camera,
            "envelope": asdict(self.limits),
            "authority": asdict(self.authority),
        }


def terms(args: argparse.Namespace) -> Terms:
    """Return the terms that a user's words ask for. Raises UsageError."""
    pilot = None if args.model else roster.check(args.pilot or "vision")
    seconds = CAP_S if args.seconds is None else args.seconds
    if not (math.isfinite(seconds) and 0.0 < seconds <= CAP_S):
        raise UsageError(f"--seconds wants more than 0 and at most {CAP_S:g}, got {seconds:g}")
    patience_s = PATIENCE_S if args.patience is None else args.patience
    if not 1.0 <= patience_s <= CAP_S:
        raise UsageError(f"--patience wants 1 to {CAP_S:g} seconds, got {patience_s:g}")
    if args.model:
        model = ChatModel(*split(args.model), args.base_url)
        model.check()
        model.close()
    return Terms(
        pilot=pilot,
        model=args.model,
        base_url=args.base_url,
        prompt=Prompt.load(args.prompt),
        latency=latency_for(args.latency, 1.0),
        seconds=seconds,
        patience_s=patience_s,
        authority=Authority(arm=args.arm, then=args.then or ("land" if args.arm else "hold"), dry=args.dry_run),
        limits=load_envelope(args.envelope, Limits()) if args.envelope else Limits(),
    )
