"""The oracle behind the interface a model has: it listens on the truth bus. Built by the run, never by the agent."""

import json
from collections.abc import Callable

from dronecats.agent.model import Reply, Request
from dronecats.border.camera import CameraModel
from dronecats.border.errors import ModelError
from dronecats.border.frames import quat_yaw
from dronecats.border.truth import NewestTruth, Origin
from dronecats.pilots import oracle
from episodes.world import World

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
        self._listen()
        replies = [self._reply(drone) for drone in range(len(request.images_jpeg))]
        text = replies[0] if len(replies) == 1 else json.dumps([json.loads(reply) for reply in replies])
        return Reply(text, 0.0)

    def close(self) -> None:
        pass

    def _reply(self, drone: int) -> str:
        sample = self._truth.of(drone)
        if sample is None:
            raise ModelError(f"the oracle has not heard where drone {drone} is")
        t_s = 0.0 if self._t0_us is None else max(0.0, (sample.time_us - self._t0_us) / 1e6)
        here, soon = self._world.target_centre(t_s), self._world.target_centre(t_s + AHEAD_S)
        north, east, down = ((b - a) / AHEAD_S for a, b in zip(here, soon, strict=True))
        return oracle.reply(
            sample.position_ned, quat_yaw(sample.attitude), sample.attitude, self._camera, here, (north, east, down)
        )
