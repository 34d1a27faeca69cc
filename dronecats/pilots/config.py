"""What a built-in pilot's process is told when it starts."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class PilotConfig:
    """A pilot behind an endpoint on the loopback."""

    pilot: str  # its name in the roster
    port: int = 0  # TCP; 0: one that the system chose
