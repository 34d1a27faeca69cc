"""What the agent needs of a vehicle: a clock, something to stream, and the next tick of telemetry."""

from typing import Protocol

from dronecats.border.setpoints import Setpoint


class Vehicle(Protocol):
    """One drone over MAVLink; `hil.link.Link` is the one there is."""

    @property
    def time_us(self) -> int:
        """µs, the vehicle's clock at its newest telemetry."""
        ...

    def fly(self, setpoint: Setpoint, seconds: float | None = None) -> None:
        """From the next tick on, stream this setpoint, and after `seconds` of vehicle time a hold in its stead."""
        ...

    def listen(self) -> None:
        """Take in what has already arrived, without waiting, so that `time_us` is the newest there is."""
        ...

    def tick(self) -> None:
        """Wait for the next telemetry tick (20 Hz of vehicle time), then send the setpoint. Raises LinkError."""
        ...
