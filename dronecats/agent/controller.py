"""The fixed geometric controller (paper, appendix "Execution"), and `Drone`, which flies the planned segments.

One action becomes at most a turn and a move. The geometry is solved once per step, without feedback; the autopilot
tracks the result. Angles count from the heading that the vehicle had when the picture was taken, so a go flies towards
its image point even if the vehicle has turned since.
"""

import math
from dataclasses import dataclass
from typing import Protocol

from dronecats.agent.action import Action, Finished, Go, Rotate, Think
from dronecats.agent.prompt import History
from foundation.camera import CameraModel
from foundation.protocol import (
    BEARING_DEADBAND_DEG,
    BRAKE_M,
    CLIMB_DEADBAND,
    NEAR_M,
    NEAR_SCALE,
    POINT_SPAN,
    STEP_S,
    STRIDE_MAX_M,
    YAW_RATE_DEG,
)
from foundation.setpoints import Hold, PicturePose, Setpoint, Turn, Velocity

YAW_RATE = math.radians(YAW_RATE_DEG)  # rad/s
SETTLE_S = 3.0  # s; in a gust or with a slow vehicle, a turn may last this much longer than angle / YAW_RATE


@dataclass(frozen=True, slots=True)
class Segment:
    """One setpoint and how long it is flown."""

    setpoint: Setpoint
    duration_s: float
    settle_s: float = 0.0  # s, longest extra time until the vehicle has reached the heading


def displacement(go: Go, camera: CameraModel) -> tuple[float, float, float]:
    """Return the offset of the point (right, forward, up; m), back-projected with the pilot's depth.

    Forward and up are axes of the vehicle. The depth is along the optical axis of the camera, which may be pitched.
    """
    f = camera.focal_px
    px, py = go.x * camera.width / POINT_SPAN, go.y * camera.height / POINT_SPAN
    right, above = (px - camera.width / 2.0) / f * go.depth_m, (camera.height / 2.0 - py) / f * go.depth_m
    if not camera.pitch_deg:
        return right, go.depth_m, above
    c, s = math.cos(math.radians(camera.pitch_deg)), math.sin(math.radians(camera.pitch_deg))
    return right, go.depth_m * c - above * s, go.depth_m * s + above * c


def plan(action: Action | None, camera: CameraModel) -> tuple[Segment, ...]:
    """Return the segments that fly `action`, in order; None (an unreadable reply) holds for one step."""
    match action:
        case Go():
            return _go(action, camera)
        case Rotate(angle_deg):
            return (turn(math.radians(angle_deg)),) if angle_deg else (Segment(Hold(), STEP_S),)
        case Think() | Finished() | None:
            return (Segment(Hold(), STEP_S),)


def _go(go: Go, camera: CameraModel) -> tuple[Segment, ...]:
    right, forward, up = displacement(go, camera)
    bearing = math.atan2(right, forward)
    move = _move(math.hypot(right, forward), up, go.depth_m, bearing)
    if abs(bearing) <= math.radians(BEARING_DEADBAND_DEG):
        return (move,)  # the vehicle turns its nose while it moves
    return (turn(bearing, onto_line=isinstance(move.setpoint, Velocity)), move)


def turn(angle: float, *, onto_line: bool = False) -> Segment:
    """Return the turn by an angle (rad, + right) from the heading when the picture was taken.

    `onto_line`: a move follows. During the turn, the vehicle holds the nearest place on the line of this move.
    """
    return Segment(Turn(math.copysign(YAW_RATE, angle), angle, onto_line), abs(angle) / YAW_RATE, SETTLE_S)


def _move(ahead: float, up: float, depth_m: float, bearing: float) -> Segment:
    if depth_m < BRAKE_M or ahead <= 0.0:
        return Segment(Hold(), STEP_S)
    if abs(up) < CLIMB_DEADBAND * ahead:
        up = 0.0
    scale = min(1.0, STRIDE_MAX_M / math.hypot(ahead, up))
    if depth_m < NEAR_M:
        scale *= NEAR_SCALE
    climb = up * scale / STEP_S if up else None
    return Segment(Velocity(ahead * scale / STEP_S, climb, bearing), STEP_S)


class Aircraft(Protocol):
    """One drone over MAVLink. `hil.link.link.Link` implements it."""

    @property
    def time_us(self) -> int:
        """µs, the vehicle's clock at its newest telemetry."""
        ...

    @property
    def steady(self) -> bool:
        """True when the nose has reached the heading of the current turn and has stopped turning."""
        ...

    def sight(self, time_us: int) -> PicturePose:
        """Return the estimated pose of the vehicle at a time of its clock (µs). Raises LinkError."""
        ...

    def fly(self, setpoint: Setpoint, seconds: float | None = None, seen: PicturePose | None = None) -> None:
        """Stream this setpoint from the next tick on, and a hold after `seconds` of vehicle time.

        The setpoint's angles count from the heading of `seen`.
        """
        ...

    def listen(self) -> None:
        """Read the messages that have arrived, without waiting, so that `time_us` is up to date."""
        ...

    def tick(self) -> None:
        """Wait for the next telemetry tick (20 Hz of vehicle time), then send the setpoint. Raises LinkError."""
        ...


class Drone:
    """One drone, which flies one action after another. `loop.Decider` chooses the actions."""

    def __init__(self, index: int, aircraft: Aircraft, camera_model: CameraModel) -> None:
        self.index, self.aircraft = index, aircraft
        self.history = History(camera_model)
        self.thinks_next = False  # the newest reply was a think: the next call reasons at length
        self._segments: list[Segment] = []  # segments of the current action that are still to be flown
        self._segment_ends_s = 0.0
        self._seen: PicturePose | None = None  # pose when the picture of the current action was taken
        self._counts_from: PicturePose | None = None  # pose from which angles count; None: `_seen`
        self._seen_us = 0  # µs on the vehicle's clock, time of `_seen`

    @property
    def busy(self) -> bool:
        """True while the drone flies an action."""
        return bool(self._segments)

    def see(self, time_us: int) -> None:
        """Remember the pose at the time of a picture (µs, vehicle's clock). The next action is relative to it."""
        self.aircraft.listen()  # telemetry may have arrived while the frame was under way
        # once per picture: later, the link may no longer have the telemetry of that time
        if self._seen is None or time_us != self._seen_us:
            self._seen, self._seen_us = self.aircraft.sight(time_us), time_us

    def _settle(self) -> None:
        """Look up the pose of the picture again if it was extrapolated, because newer telemetry may have arrived."""
        if self._seen is not None and self._seen.carried_on:
            self._seen = self.aircraft.sight(self._seen_us)

    def plan(self, action: Action | None) -> None:
        """Plan an action, None for an unreadable reply. `begin` flies it."""
        camera = self.history.camera.at_pitch(self._seen.gimbal_pitch if self._seen else None)
        self._segments, self._counts_from = list(plan(action, camera)), None

    def begin(self, now_s: float) -> None:
        """Start to fly the plan."""
        self._next_segment(now_s, now_s)

    def advance(self, now_s: float) -> None:
        """Start the next segment if the current one has been flown."""
        if self._segments and self._is_over(now_s):
            settled = self._segments.pop(0).settle_s > 0.0
            self._next_segment(now_s if settled else self._segment_ends_s, now_s)

    def _is_over(self, now_s: float) -> bool:
        """Return whether the segment has been flown. A turn may last `settle_s` longer, until the vehicle is steady."""
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
