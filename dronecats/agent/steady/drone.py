"""One vehicle of the steady agent: a go is a place that it flies to, from wherever it is when the reply comes."""

import math

from dronecats.agent.action import Action, Go
from dronecats.agent.controller import turn
from dronecats.agent.drone import Aircraft, Drone
from dronecats.agent.steady.leg import Leg, SeenPlace, leg, seen_place, steered
from dronecats.agent.steady.pursuit import Pursuit
from foundation.camera import CameraModel
from foundation.frames import Vec3, wrap_pi
from foundation.protocol import NEAR_M, STEP_S, STRIDE_MAX_M
from foundation.setpoints import Hold

TURNS_FIRST = math.radians(
    30.0
)  # off the nose, beyond which it turns on the spot: else the nose comes round on the way
SHORT_M = 0.3  # m by which a stride may have come out too short
STREAMED_S = 0.5  # s that one setpoint of a leg lives without the next: whoever stops steering stops flying


class SteadyDrone(Drone):
    """Flies what was decided last until the next decision is there. It advances by itself at every tick."""

    def __init__(self, index: int, aircraft: Aircraft, camera_model: CameraModel) -> None:
        super().__init__(index, aircraft, camera_model)
        self.period_s = 0.0  # s from one decision to the next, as far as they are known
        self._pursuit = Pursuit()
        self._seen_s = 0.0  # s of the aircraft's clock, when the picture was taken
        self._place: SeenPlace | None = None  # that is to be flown to
        self._leg: Leg | None = None
        self._course: float | None = None  # rad, of the leg
        self._resting = False  # the leg has come to its end before the next decision

    def see(self, time_us: int) -> None:
        """Remember where it was, and when, when its picture was taken."""
        super().see(time_us)
        self._seen_s = time_us / 1e6

    def plan(self, action: Action | None) -> None:
        """Take an action, None for an unreadable reply; `begin` flies it."""
        self._leg = self._course = self._place = None
        self._resting = False
        if not isinstance(action, Go):
            super().plan(action)
            return
        self._settle()
        assert self._seen is not None  # a picture was asked about
        seen = seen_place(action, self._seen, self.history.camera)
        self._pursuit.see(self._seen_s, seen.lens_ned, seen.place_ned)
        if seen.reach <= 0.0:
            super().plan(None)
            return
        self._place = seen
        self._segments, self._counts_from = [], None
        here = self.aircraft.sight(self.aircraft.time_us)
        off = wrap_pi(self._course_of(seen, here.position_ned) - here.heading)
        if abs(off) > TURNS_FIRST:
            self._counts_from = here  # where the nose is now; what is seen stays seen from where its picture was taken
            self._segments = [turn(off)]

    def begin(self, now_s: float) -> None:
        """Fly what was planned from now on."""
        if self._segments:
            super().begin(now_s)
        elif self._place is not None:
            self._begin_leg(now_s)
        else:
            self.aircraft.fly(Hold())

    def advance(self, now_s: float) -> None:
        """Steer on, or go on to what follows a turn."""
        if self._segments:
            super().advance(now_s)
            if not self._segments and self._place is not None:
                self._begin_leg(now_s)
        elif self._leg is not None:
            self._steer(now_s)

    def asks(self, now_s: float, age_s: float) -> bool:
        """Return whether it is time for the next picture, of which the reply comes `age_s` later.

        During a turn it never is: what is looked for there is what is seen after it. Nor before the vehicle has flown a
        stride from where the picture before was taken, as the history says of the last action that it did.
        """
        if self._segments:
            last = self._segments[-1]
            return not last.settle_s and self._place is None and now_s >= self._segment_ends_s - age_s
        if self._leg is None:
            return True
        if self._careful or now_s < self._leg.due_s - age_s:
            return self._resting or now_s >= self._leg.due_s
        return now_s >= self._leg.due_s or self._flown_m() >= STRIDE_MAX_M - SHORT_M

    def _flown_m(self) -> float:
        """Return how far it is from where the picture was taken on which it acts, m."""
        assert self._place is not None
        return math.dist(self.aircraft.sight(self.aircraft.time_us).position_ned, self._place.from_ned)

    @property
    def _careful(self) -> bool:
        """Whether the reply asked for a short stride, of which the end is looked at before the next one."""
        return self._place is not None and self._place.depth_m < NEAR_M

    def _place_now(self, seen: SeenPlace) -> tuple[Vec3, Vec3]:
        """Return where what was pointed at is by now, and how it moves (m, m/s, local frame)."""
        now_s = self.aircraft.time_us / 1e6
        believed = self._pursuit.at(now_s)
        velocity = believed.velocity_ned if believed else (0.0, 0.0, 0.0)
        if believed and seen.depth_m >= NEAR_M:
            return believed.place_ned, velocity
        old_s = now_s - self._seen_s  # a short stride says how far to go, and nothing of how far off the thing is
        north, east, down = seen.place_ned
        return (north + velocity[0] * old_s, east + velocity[1] * old_s, down), velocity

    def _course_of(self, seen: SeenPlace, here: Vec3) -> float:
        """Return the course (rad) to what was pointed at: of a short stride the one that its picture shows."""
        place, origin = (seen.place_ned, seen.lens_ned) if self._careful else (self._place_now(seen)[0], here)
        return math.atan2(place[1] - origin[1], place[0] - origin[0])

    def _begin_leg(self, now_s: float) -> None:
        seen = self._place
        assert seen is not None
        goal, velocity = self._goal(seen)
        here = self.aircraft.sight(self.aircraft.time_us).position_ned
        self._leg = leg(goal, velocity, here, now_s, self.period_s, level=seen.level, careful=self._careful)
        self._course = self._course_of(seen, here)
        self._steer(now_s)

    def _goal(self, seen: SeenPlace) -> tuple[Vec3, Vec3]:
        """Return where to, and how that moves on (m, m/s, local frame): the share of the way that may be flown.

        What moves takes the goal along. Of a short stride no farther than to where the place was: a pilot that names
        the same small depth again and again would else be flown after ever faster.
        """
        old_s = self.aircraft.time_us / 1e6 - self._seen_s
        place, velocity = self._place_now(seen)
        if self._careful:
            stride = [seen.reach * (p - lens) for p, lens in zip(seen.place_ned, seen.lens_ned, strict=True)]
            gone = [v * (old_s + STEP_S) for v in velocity]
            rest = (1.0 - seen.reach) * math.dist(seen.place_ned, seen.lens_ned)
            held = min(1.0, rest / max(math.hypot(*gone), 1e-9))
            north, east, down = (f + s + held * g for f, s, g in zip(seen.from_ned, stride, gone, strict=True))
            return (north, east, down), (0.0, 0.0, 0.0)
        north, east, down = (
            f + (1.0 - seen.reach) * v * old_s + seen.reach * (p - lens)
            for f, v, p, lens in zip(seen.from_ned, velocity, place, seen.lens_ned, strict=True)
        )
        return (north, east, down), velocity

    def _steer(self, now_s: float) -> None:
        assert self._leg is not None
        here = self.aircraft.sight(self.aircraft.time_us).position_ned
        flown = steered(self._leg, here, now_s, self._course, resting=self._resting)
        self._resting = flown is None
        if flown is None:
            self.aircraft.fly(Hold())
            return
        self._course = flown.seen.heading
        self.aircraft.fly(flown.setpoint, min(STREAMED_S, flown.valid_s), flown.seen)
