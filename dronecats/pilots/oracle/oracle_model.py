"""A pilot that is told the truth, behind the interface a model has: it listens on the truth bus. Built by the run."""

import math
from collections.abc import Callable
from dataclasses import replace

from dronecats.agent.models.model import Reply, Request
from dronecats.pilots import briefing
from dronecats.pilots import reply as reply_text
from dronecats.pilots.oracle import oracle
from dronecats.pilots.oracle.sight import Knowing, TrueSight
from dronecats.pilots.scripted import places
from episodes.authoring.check.candidates import centre
from episodes.maps.scene import Instance
from episodes.records.record import StartPose
from episodes.world.fleet import DronePose
from episodes.world.world import World
from foundation.camera import CameraModel
from foundation.errors import ModelError
from foundation.frames import quat_yaw, wrap_pi
from foundation.truth import KEPT, NewestTruth, Origin, TruthSample

AHEAD_S = 0.5  # s, over which the target's velocity is taken


class OracleModel:
    """Answers with the text of a pilot that is told the truth: the oracle's, one JSON object per drone."""

    def __init__(
        self,
        world: World,
        camera: CameraModel,
        origin: Origin,
        listen: Callable[[], None],
        name: str = "oracle",
        pilot: Knowing = oracle.nearest_flies,
        *,
        kept: int = KEPT,
        obeys: bool = True,
        looks: bool = False,
    ) -> None:
        """`listen` is called before each answer, to read what is waiting on the bus into `feed`.

        `kept`: how many samples of the truth of each drone are remembered, for pictures that come late. `obeys`: a
        drone that is asked for alone goes where its command says. `looks`: the pilot asks whether the target is
        visible, which has to be measured.
        """
        self.name = name
        self._world, self._camera, self._listen, self._pilot = world, camera, listen, pilot
        self._truth = NewestTruth(origin, kept)
        self._taken: dict[int, int] = {}  # drone → µs, when the picture was taken that it is asked for on
        self.feed = self._truth.feed  # bytes of the truth bus go in here
        self._obeys, self._looks = obeys, looks
        self._t0_us: int | None = None

    def begin(self, t0_us: int) -> None:
        self._t0_us = t0_us

    def ask(self, request: Request) -> Reply:
        """Answer for every picture's drone."""
        self._listen()
        drones = range(request.drone, request.drone + len(request.images_jpeg))
        self._taken = dict(zip(drones, request.taken_us, strict=False))
        if len(drones) == 1 and self._obeys:
            return Reply(self._alone(request.drone, request.step, briefing.read(request.text).command), 0.0)
        return Reply(self._pilot([self._sight(drone, request.step) for drone in drones]), 0.0)

    def check(self) -> None:
        """It is here."""

    def close(self) -> None:
        pass

    def _alone(self, drone: int, step: int, command: str) -> str:
        """Return the action of one drone that is asked for alone: it goes to the candidate that its command points to.

        At one that is not the target it stops and says nothing, as whoever had read its inscription would.
        """
        place, sight = places.told(command), self._sight(drone, step)
        row = in_a_row(self._world, self._world.record.starts[drone])
        if place is None or place > len(row) or row[place - 1] is self._world.target:
            return self._pilot([sight])
        there = replace(sight, target_ned=centre(row[place - 1]), target_velocity_ned=(0.0, 0.0, 0.0))
        said = self._pilot([there])
        return reply_text.think() if said == reply_text.finished() else said

    def _sight(self, drone: int, step: int) -> TrueSight:
        taken_us = self._taken.get(drone)
        known = None if taken_us is None else self._truth.at(drone, taken_us)
        sample = known[0] if known else self._truth.of(drone)
        if sample is None:
            raise ModelError(f"the {self.name} has not heard where drone {drone + 1} is")
        t_s = 0.0 if self._t0_us is None else max(0.0, (sample.time_us - self._t0_us) / 1e6)
        here, soon = self._world.target_centre(t_s), self._world.target_centre(t_s + AHEAD_S)
        north, east, down = ((b - a) / AHEAD_S for a, b in zip(here, soon, strict=True))
        return TrueSight(
            sample.position_ned, quat_yaw(sample.attitude), sample.attitude, here, (north, east, down), self._camera,
            drone, step, self._visible(sample, t_s) if self._looks else True,
        )  # fmt: skip

    def _visible(self, sample: TruthSample, t_s: float) -> bool:
        """Return whether the target is visible from there, by the logger's own measure, the other drones around."""
        known = self._truth.at(sample.drone, sample.time_us)
        others = known[1].values() if known else ()
        around = [DronePose(one.position_ned, one.attitude) for one in others]
        return self._world.measure(t_s, sample.position_ned, sample.attitude, self._camera, around).visible


def in_a_row(world: World, start: StartPose) -> list[Instance]:
    """Return the target and its look-alikes from left to right, as a start faces them; the target alone without any."""
    things = world.target_and_lookalikes
    yaw, (north, east, _) = math.radians(start.yaw_deg), start.position_ned

    def off(one: Instance) -> float:
        there = centre(one)
        return wrap_pi(math.atan2(there[1] - east, there[0] - north) - yaw)

    return sorted(things, key=off)
