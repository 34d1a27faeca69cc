"""The loops of the cascade that are studied, each closed around those inside it and open towards those outside."""

from dataclasses import dataclass

from dronecats.study.loop.feedback import ATTITUDE, RATE, VELOCITY
from foundation.errors import UsageError


@dataclass(frozen=True, slots=True)
class CascadeLoop:
    """One loop about one axis, and the small step that shows what it does."""

    name: str  # as `dronecats tune` has it
    group: str  # rate, attitude or velocity
    level: int  # RATE, ATTITUDE or VELOCITY: what is fed back
    axis: int  # 0, 1, 2: roll, pitch, yaw, or north, east, down
    step: float  # rad/s, rad or m/s: so small that nothing on the way saturates
    unit: str


TURNS = ("roll", "pitch", "yaw")
LOOPS = (
    *(CascadeLoop(f"{a} rate", "rate", RATE, k, 0.05, "rad/s") for k, a in enumerate(TURNS)),
    *(CascadeLoop(f"{a} attitude", "attitude", ATTITUDE, k, 0.02, "rad") for k, a in enumerate(TURNS)),
    CascadeLoop("horizontal velocity", "velocity", VELOCITY, 0, 0.1, "m/s"),
    CascadeLoop("vertical velocity", "velocity", VELOCITY, 2, 0.1, "m/s"),
)
GROUPS = ("rate", "attitude", "velocity")


def chosen(names: list[str] | None) -> tuple[CascadeLoop, ...]:
    """Return the loops of these groups or names, all where none is given. Raises UsageError for one that is none."""
    for name in names or ():
        if name not in GROUPS and name not in [loop.name for loop in LOOPS]:
            raise UsageError(
                f"--loops {name}: choose from {', '.join(GROUPS)} or {', '.join(loop.name for loop in LOOPS)}"
            )
    return tuple(loop for loop in LOOPS if not names or loop.group in names or loop.name in names)
