"""What is done to a simulated flight on purpose: its pictures, its wire, its vehicle. Seeded, in vehicle time.

What a reply takes is the latency policy's (`dronecats/agent/latency.py`). The defaults disturb nothing.
"""

import math
from dataclasses import dataclass

from foundation.errors import UsageError
from hil.impairment.channel import Impairment

PERFECT = Impairment()
DEAF = 0.95  # share of lost telemetry above which no decision is made, so that there is nothing to score
RECALLED_S = 15.0  # s; the logger measures a picture that was taken up to 20 s ago


def _within(what: str, value: float, low: float, high: float, unit: str = "") -> None:
    if not low <= value <= high:
        raise UsageError(f"{what} is {low:g} to {high:g}{f' {unit}' if unit else ''}, got {value:g}")


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameFaults:
    """What becomes of a picture between the camera and the agent."""

    delay_s: float = 0.0  # s from the shutter until the agent has it
    dropped: float = 0.0  # share of pictures that never come: the next is waited for
    stale: float = 0.0  # share of questions that get the picture of the question before
    rate_hz: float | None = None  # pictures are taken so often and the newest is got; None: whenever one is asked for

    def __post_init__(self) -> None:
        """Raise UsageError for what no camera does."""
        _within("a picture's delay", self.delay_s, 0.0, 60.0, "s")
        _within("the share of dropped pictures", self.dropped, 0.0, 0.95)
        _within("the share of stale pictures", self.stale, 0.0, 1.0)
        if self.rate_hz is not None:
            _within("the pictures' rate", self.rate_hz, 0.1, 100.0, "Hz")
            _within("of pictures at a rate, their delay and a period together", self.reach_s, 0.0, RECALLED_S, "s")

    @property
    def reach_s(self) -> float:
        """How long ago (s) a picture may be taken for which nobody has asked then; 0 where there is no rate."""
        return 0.0 if self.rate_hz is None else self.delay_s + 1.0 / self.rate_hz


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkFaults:
    """What the MAVLink wire between agent and autopilot does, each way."""

    to_vehicle: Impairment = PERFECT
    from_vehicle: Impairment = PERFECT

    def __post_init__(self) -> None:
        """Raise UsageError for a wire on which nobody could fly."""
        if self.from_vehicle.loss > DEAF:
            raise UsageError(
                f"an agent that hears nothing decides nothing: the loss from the vehicle is 0 to {DEAF:g}, got"
                f" {self.from_vehicle.loss:g}; to.loss=1 is one way only"
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleFaults:
    """What makes the vehicle harder to fly, whether our autopilot flies it or a PX4."""

    wind_ned: tuple[float, float, float] = (0.0, 0.0, 0.0)  # m/s, steady, towards north, east, down
    gusts_w20: float = 0.0  # m/s, Dryden gusts (MIL-F-8785C), the wind speed 20 ft above the ground
    payload_kg: float = 0.0  # fixed under the body, which the autopilot was not tuned for
    gps_delay_s: float = 0.0  # s on top of the receiver's own, which the autopilot is not told of
    gps_noise: float = 1.0  # × the receiver's own errors; what it reports of them stays
    estimator_noise: float = 1.0  # × noise and drift of gyroscope, accelerometer, compass and barometer
    setpoint_hz: float | None = None  # how often the agent sends its setpoint; None: as always
    stalled: float = 0.0  # share of seconds in which the host holds the simulator up; real time only
    stall_s: float = 0.5  # s that it does

    def __post_init__(self) -> None:
        """Raise UsageError for what no flight bears."""
        for name, speed in (("wind", math.hypot(*self.wind_ned)), ("wind of the gusts", self.gusts_w20)):
            _within(f"the {name}", speed, 0.0, 30.0, "m/s")
        _within("the payload", self.payload_kg, 0.0, 20.0, "kg")
        _within("the GPS delay", self.gps_delay_s, 0.0, 1.4, "s")
        _within("the factor on GPS noise", self.gps_noise, 0.0, 100.0)
        _within("the factor on sensor noise", self.estimator_noise, 0.0, 100.0)
        _within("the share of stalled seconds", self.stalled, 0.0, 1.0)
        _within("a stall", self.stall_s, 0.0, 10.0, "s")
        if self.setpoint_hz is not None:
            _within("the setpoints' rate", self.setpoint_hz, 2.0, 50.0, "Hz")  # below 2 Hz a PX4 leaves offboard


@dataclass(frozen=True, slots=True, kw_only=True)
class Disturbances:
    """All of them together."""

    frame: FrameFaults = FrameFaults()
    link: LinkFaults = LinkFaults()
    vehicle: VehicleFaults = VehicleFaults()


UNHINDERED = LinkFaults()
UNDISTURBED = Disturbances()
