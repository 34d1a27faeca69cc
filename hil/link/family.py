"""What differs between one family of autopilots and another, as a link sees it. PX4's is `px4.py`."""

from typing import Protocol

from foundation.mavlink import dialect
from hil.link.offboard import OffboardSetpoint


class Family(Protocol):
    """One family. Modes have PX4's names everywhere: what another family calls otherwise, its file translates."""

    @property
    def name(self) -> str:
        """For a sentence."""
        ...

    @property
    def autopilot(self) -> int:
        """HEARTBEAT.autopilot, a MAV_AUTOPILOT."""
        ...

    @property
    def homeward(self) -> tuple[str, ...]:
        """Modes after which nothing more is ordered: they end on the ground."""
        ...

    def mode_name(self, custom_mode: int) -> str:
        """Return the mode of a HEARTBEAT or CURRENT_MODE."""
        ...

    def mode_parameters(self, mode: str) -> tuple[float, float]:
        """Return parameters 2 and 3 of MAV_CMD_DO_SET_MODE. Raises KeyError for a mode that there is not."""
        ...

    def goes_on_to(self, mode: str) -> tuple[str, ...]:
        """Return the modes into which an autopilot goes on by itself from this one."""
        ...

    def ending(self, then: str) -> str:
        """Return the mode that ends a flight as asked: land, return or hold."""
        ...

    def setpoint_message(
        self, setpoint: OffboardSetpoint, time_boot_ms: int, system: int, component: int
    ) -> dialect.MAVLink_message:
        """Return the message that carries an offboard setpoint, in the frame and with the mask that are understood."""
        ...
