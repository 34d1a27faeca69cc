"""What the agent needs of what it flies: a clock, something to stream, and the next tick of telemetry."""

from typing import Protocol

from dronecats.agent.action import Action
from dronecats.agent.controller import Segment, plan
from dronecats.agent.history import History
from foundation.camera import CameraModel
from foundation.setpoints import Hold, Setpoint, Sight


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


class Drone:
    """Flies one action after the other; who decides on them, alone or for several together, is another matter."""

    def __init__(self, index: int, aircraft: Aircraft, camera_model: CameraModel) -> None:
        self.index, self.aircraft = index, aircraft
        self.history = History(camera_model)
        self.thinks_next = False  # its newest reply asked to reason at length in the next call
        self._segments: list[Segment] = []  # what is still to be flown of the current action
        self._segment_ends_s = 0.0
        self._seen: Sight | None = None  # where it was when the picture was taken on which it acts
        self._counts_from: Sight | None = None  # the angles of what it flies, where not from there
        self._seen_us = 0  # µs, its clock, when that was taken

    @property
    def busy(self) -> bool:
        """Whether its action is still being flown."""
        return bool(self._segments)

    def see(self, time_us: int) -> None:
        """Remember where it was when its picture was taken: the angles of the next action count from there."""
        self.aircraft.listen()  # a frame takes its time to come, which is not the model's
        if self._seen is None or time_us != self._seen_us:  # the same again may be older than what is remembered
            self._seen, self._seen_us = self.aircraft.sight(time_us), time_us

    def _settle(self) -> None:
        """Look once more where it was then, if nobody had told: telemetry may have come since."""
        if self._seen is not None and self._seen.carried_on:
            self._seen = self.aircraft.sight(self._seen_us)

    def plan(self, action: Action | None) -> None:
        """Take an action, None for an unreadable reply; `begin` flies it."""
        self._segments, self._counts_from = list(plan(action, self.history.camera)), None

    def begin(self, now_s: float) -> None:
        """Fly what was planned from now on."""
        self._next_segment(now_s, now_s)

    def advance(self, now_s: float) -> None:
        """Go on to the next segment when one has been flown."""
        if self._segments and self._is_over(now_s):
            settled = self._segments.pop(0).settle_s > 0.0
            self._next_segment(now_s if settled else self._segment_ends_s, now_s)

    def _is_over(self, now_s: float) -> bool:
        """Return whether the segment has been flown; a turn has been when the vehicle has made it, and stands."""
        late_s = now_s - self._segment_ends_s
        return late_s >= -1e-9 and (self.aircraft.steady or late_s >= self._segments[0].settle_s)

    def _next_segment(self, starts_s: float, now_s: float) -> None:
        if self._segments:
            self._settle()
            segment = self._segments[0]
            self._segment_ends_s = starts_s + segment.duration_s
            seconds = self._segment_ends_s + segment.settle_s - now_s
            self.aircraft.fly(segment.setpoint, seconds, self._counts_from or self._seen)
        else:
            self.aircraft.fly(Hold())
