"""What the agent needs of what it flies: a clock, something to stream, and the next tick of telemetry."""

from typing import Protocol

from foundation.setpoints import Setpoint, Sight


class Aircraft(Protocol):
    """One drone over MAVLink; `hil.link.link.Link` is the one there is."""

    @property
    def time_us(self) -> int:
        """µs, the vehicle's clock at its newest telemetry."""
        ...

    @property
    def steady(self) -> bool:
        """Whether the nose is where the turn under way wants it, and has stopped turning."""
        ...

    def sight(self, time_us: int) -> Sight:
        """Return where the vehicle was at a time of its clock (µs), by its own estimate. Raises LinkError."""
        ...

    def fly(self, setpoint: Setpoint, seconds: float | None = None, seen: Sight | None = None) -> None:
        """From the next tick on, stream this setpoint, and after `seconds` of vehicle time a hold in its stead.

        `seen` is what the setpoint's angles are counted from.
        """
        ...

    def listen(self) -> None:
        """Take in what has already arrived, without waiting, so that `time_us` is the newest there is."""
        ...

    def tick(self) -> None:
        """Wait for the next telemetry tick (20 Hz of vehicle time), then send the setpoint. Raises LinkError."""
        ...
