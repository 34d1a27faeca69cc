"""The oracle behind the interface a model has: it listens on the truth bus. Built by the run, never by the agent."""

import math
from collections.abc import Callable

from dronecats.agent.models.model import Reply, Request
from dronecats.pilots import briefing, oracle, places
from dronecats.pilots import reply as reply_text
from episodes.check.candidates import centre
from episodes.record import StartPose
from episodes.scene import Instance
from episodes.world import World
from foundation.camera import CameraModel
from foundation.errors import ModelError
from foundation.frames import quat_yaw, wrap_pi
from foundation.truth import NewestTruth, Origin, TruthSample

AHEAD_S = 0.5  # s, over which the target's velocity is taken


class OracleModel:
    """Answers with the text that `oracle.reply` writes, one JSON object per drone."""

    name = "oracle"

    def __init__(self, world: World, camera: CameraModel, origin: Origin, listen: Callable[[], None]) -> None:
        """`listen` is called before each answer, to read what is waiting on the bus into `feed`."""
        self._world, self._camera, self._listen = world, camera, listen
        self._truth = NewestTruth(origin)
        self.feed = self._truth.feed  # bytes of the truth bus go in here
        self._t0_us: int | None = None

    def begin(self, t0_us: int) -> None:
        self._t0_us = t0_us

    def ask(self, request: Request) -> Reply:
        """Answer for every picture's drone. Of a fleet the nearest flies, the others hover: one arrival is enough."""
        self._listen()
        drones = range(request.drone, request.drone + len(request.images_jpeg))
        if len(drones) == 1:
            return Reply(self._alone(request.drone, briefing.read(request.text).command), 0.0)
        nearest = min(drones, key=self._distance_m)
        replies = [self._reply(drone) if drone == nearest else reply_text.think() for drone in drones]
        return Reply(reply_text.fleet(replies), 0.0)

    def check(self) -> None:
        """It is here."""

    def close(self) -> None:
        pass

    def _sample(self, drone: int) -> TruthSample:
        sample = self._truth.of(drone)
        if sample is None:
            raise ModelError(f"the oracle has not heard where drone {drone} is")
        return sample

    def _time_s(self, time_us: int) -> float:
        return 0.0 if self._t0_us is None else max(0.0, (time_us - self._t0_us) / 1e6)

    def _distance_m(self, drone: int) -> float:
        sample = self._sample(drone)
        return math.dist(sample.position_ned, self._world.target_centre(self._time_s(sample.time_us)))

    def _alone(self, drone: int, command: str) -> str:
        """Return the action of one drone that is asked for alone: it goes to the candidate that its command points to.

        At one that is not the target it stops and says nothing, as whoever had read its inscription would.
        """
        place = places.told(command)
        row = in_a_row(self._world, self._world.record.starts[drone])
        if place is None or place > len(row) or row[place - 1] is self._world.target:
            return self._reply(drone)
        sample, there = self._sample(drone), centre(row[place - 1])
        said = oracle.reply(sample.position_ned, quat_yaw(sample.attitude), sample.attitude, self._camera, there)
        return reply_text.think() if said == reply_text.finished() else said

    def _reply(self, drone: int) -> str:
        sample = self._sample(drone)
        t_s = self._time_s(sample.time_us)
        here, soon = self._world.target_centre(t_s), self._world.target_centre(t_s + AHEAD_S)
        north, east, down = ((b - a) / AHEAD_S for a, b in zip(here, soon, strict=True))
        return oracle.reply(
            sample.position_ned, quat_yaw(sample.attitude), sample.attitude, self._camera, here, (north, east, down)
        )


def in_a_row(world: World, start: StartPose) -> list[Instance]:
    """Return the target and its look-alikes from left to right, as a start faces them; the target alone without any."""
    things = [one for one in world.scene.instances if one is world.target or one.name.startswith("candidate-")]
    yaw, (north, east, _) = math.radians(start.yaw_deg), start.position_ned

    def off(one: Instance) -> float:
        there = centre(one)
        return wrap_pi(math.atan2(there[1] - east, there[0] - north) - yaw)

    return sorted(things, key=off)
