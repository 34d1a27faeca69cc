"""The steady agent: drones keep flying while a question is under way, and fly a `go` to a place, not in a direction."""

import math
from collections import deque
from collections.abc import Callable, Generator, Sequence
from statistics import median

from dronecats.agent.action import Action, Go
from dronecats.agent.cockpit import Cockpit
from dronecats.agent.controller import Aircraft, Drone, turn
from dronecats.agent.loop import Decider, PaperAgent, PendingQuestion, Questions, Tally
from dronecats.agent.steady.leg import Leg, SeenPlace, leg_to, seen_place, steer
from dronecats.agent.steady.pursuit import Pursuit
from foundation.camera import CameraModel, Frame
from foundation.frames import Vec3, course, wrap_pi
from foundation.protocol import NEAR_M, STEP_S, STRIDE_MAX_M
from foundation.run_folder.rows import Decision
from foundation.setpoints import Hold

TURNS_FIRST = math.radians(30.0)  # angle from the nose beyond which the drone turns on the spot before it flies
SHORT_M = 0.3  # m; a full stride (STRIDE_MAX_M) counts as flown when at most this distance is left
STREAMED_S = 0.5  # s for which the drone flies a setpoint of a leg (flight to a place) if no new one comes


class SteadyDrone(Drone):
    """Flies the last action until the next decision. It advances at every tick."""

    def __init__(self, index: int, aircraft: Aircraft, camera_model: CameraModel) -> None:
        super().__init__(index, aircraft, camera_model)
        self.period_s = 0.0  # estimated s from one decision to the next
        self._pursuit = Pursuit()
        self._place: SeenPlace | None = None  # destination of a go
        self._leg: Leg | None = None
        self._course: float | None = None  # rad, last course on the leg
        self._resting = False  # the drone has reached the goal or the leg has ended, and there is no new decision

    def plan(self, action: Action | None) -> None:
        """Plan an action (None: the reply was unreadable). `begin` flies it."""
        self._leg = self._course = self._place = None
        self._resting = False
        if not isinstance(action, Go):
            super().plan(action)
            return
        self._settle()
        assert self._seen is not None  # every action has a picture
        seen = seen_place(action, self._seen, self.history.camera)
        self._pursuit.see(self._seen_us / 1e6, seen.lens_ned, seen.place_ned)
        if seen.reach <= 0.0:
            super().plan(None)
            return
        self._place = seen
        self._segments, self._counts_from = [], None
        here = self.aircraft.sight(self.aircraft.time_us)
        off = wrap_pi(self._course_of(seen, here.position_ned) - here.heading)
        if abs(off) > TURNS_FIRST:
            self._counts_from = here  # `off` counts from the present heading
            self._segments = [turn(off)]

    def begin(self, now_s: float) -> None:
        if self._segments:
            super().begin(now_s)
        elif self._place is not None:
            self._begin_leg(now_s)
        else:
            self.aircraft.fly(Hold())

    def advance(self, now_s: float) -> None:
        """Steer on the leg, or start the leg after a turn."""
        if self._segments:
            super().advance(now_s)
            if not self._segments and self._place is not None:
                self._begin_leg(now_s)
        elif self._leg is not None:
            self._steer(now_s)

    def wants_picture(self, now_s: float, age_s: float) -> bool:
        """Return whether it is time for the next picture; its reply is expected `age_s` later.

        - during a turn: no, because the model needs the view after the turn
        - during a hold: in its last `age_s` seconds
        - during a short stride: when the decision is due, or the drone rests
        - on another leg, until `age_s` before the decision is due: when the drone rests
        - on another leg, after that time: when the decision is due, or the drone has flown a full stride since the last
          picture (the prompt's history implies full strides)
        """
        if self._segments:
            last = self._segments[-1]
            return not last.settle_s and self._place is None and now_s >= self._segment_ends_s - age_s
        if self._leg is None:
            return True
        if self._careful or now_s < self._leg.due_s - age_s:
            return self._resting or now_s >= self._leg.due_s
        return now_s >= self._leg.due_s or self._stride_m() >= STRIDE_MAX_M - SHORT_M

    def _stride_m(self) -> float:
        """Return the drone's distance (m) from the place where it took the last picture."""
        assert self._place is not None
        return math.dist(self.aircraft.sight(self.aircraft.time_us).position_ned, self._place.from_ned)

    @property
    def _careful(self) -> bool:
        """True for a short stride (depth below NEAR_M). The next picture is taken at its end."""
        return self._place is not None and self._place.depth_m < NEAR_M

    def _place_now(self, seen: SeenPlace) -> tuple[Vec3, Vec3]:
        """Return the present position and velocity of the place that was pointed at (m, m/s, local frame)."""
        now_s = self.aircraft.time_us / 1e6
        believed = self._pursuit.at(now_s)
        velocity = believed.velocity_ned if believed else (0.0, 0.0, 0.0)
        if believed and seen.depth_m >= NEAR_M:
            return believed.place_ned, velocity
        old_s = now_s - self._seen_us / 1e6  # a depth below NEAR_M is the distance to fly, not to the object
        north, east, down = seen.place_ned
        return (north + velocity[0] * old_s, east + velocity[1] * old_s, down), velocity

    def _course_of(self, seen: SeenPlace, here: Vec3) -> float:
        """Return the course (rad) to the place that was pointed at; for a short stride, the course in the picture."""
        place, origin = (seen.place_ned, seen.lens_ned) if self._careful else (self._place_now(seen)[0], here)
        return course(origin, place)

    def _begin_leg(self, now_s: float) -> None:
        seen = self._place
        assert seen is not None
        goal, velocity = self._goal(seen)
        here = self.aircraft.sight(self.aircraft.time_us).position_ned
        self._leg = leg_to(goal, velocity, here, now_s, self.period_s, level=seen.level, careful=self._careful)
        self._course = self._course_of(seen, here)
        self._steer(now_s)

    def _goal(self, seen: SeenPlace) -> tuple[Vec3, Vec3]:
        """Return the goal of the leg and its velocity (m, m/s, local frame).

        The goal is at the fraction `reach` of the way to the place, and moves with the target. The goal of a short
        stride does not move and is at most as far as the place in the picture. Without this limit, a drone would fly
        faster and faster if its pilot named the same small depth again and again.
        """
        old_s = self.aircraft.time_us / 1e6 - self._seen_us / 1e6
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
        steered = steer(self._leg, here, now_s, self._course, resting=self._resting)
        self._resting = steered is None
        if steered is None:
            self.aircraft.fly(Hold())
            return
        self._course = steered.seen.heading
        self.aircraft.fly(steered.setpoint, min(STREAMED_S, steered.valid_s), steered.seen)


AGES_KEPT = 5  # number of last replies from which the age of the next picture is estimated


class SteadyDecider(Decider):
    """Asks one question at a time, like the paper's decider, but while the drones fly the last action."""

    def __init__(
        self,
        questions: Questions,
        drones: Sequence[SteadyDrone],
        cockpit: Cockpit,
        now_s: Callable[[], float],
        tally: Tally,
    ) -> None:
        super().__init__(questions, drones, cockpit, now_s, tally)
        self._steady = drones
        self._ages: deque[float] = deque(maxlen=AGES_KEPT)  # s, ages of the pictures at their decisions

    @property
    def age_s(self) -> float:
        """Expected age of a picture at its reply, s of vehicle time: the median over the last AGES_KEPT replies."""
        return median(self._ages) if self._ages else 0.0

    def _decide(self, frames: Sequence[Frame], asking: PendingQuestion, thinking: bool, now_s: float) -> list[Decision]:
        self._ages.append(max(self._now_s() - self._since_begin_s(frame) for frame in frames))
        for drone in self._steady:
            drone.period_s = self.age_s
        return super()._decide(frames, asking, thinking, now_s)

    def _act(self, cap_s: float) -> Generator[None, None, None]:
        """Yield until it is time for the next picture. The drones keep flying."""
        while self._now_s() < cap_s:
            if all(drone.wants_picture(self._now_s(), self.age_s) for drone in self._steady):
                return
            yield


class SteadyAgent(PaperAgent):
    """Flies one episode with steady drones. Like `PaperAgent`, it has one decider for each group of drones."""

    drone_type, decider_type = SteadyDrone, SteadyDecider

    def _tick(self) -> None:
        for drone in self._drones:
            drone.aircraft.tick()
        for drone in self._drones:
            drone.advance(self.now_s)
        self._cockpit.on_tick()
