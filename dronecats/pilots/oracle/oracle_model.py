"""Implements the model interface for pilots that know the truth. The truth comes from the simulator's truth bus."""

import math
from collections.abc import Callable
from dataclasses import replace

from dronecats.agent.models.model import Model, Reply, Request
from dronecats.pilots import actions
from dronecats.pilots import scripted as commander
from dronecats.pilots.oracle import oracle
from dronecats.pilots.oracle.oracle import TrueState, TruthPilot
from episodes.maps.scene import Instance
from episodes.records.record import StartPose
from episodes.world.fleet import DronePose
from episodes.world.world import World
from foundation.camera import CameraModel
from foundation.errors import ModelError
from foundation.frames import quat_yaw, wrap_pi
from foundation.truth import KEPT, NewestTruth, Origin, TruthSample

AHEAD_S = 0.5  # s, interval over which the target's velocity is computed


class OracleModel(Model):
    """Model whose replies come from a pilot that knows the truth, by default the oracle."""

    def __init__(
        self,
        world: World,
        camera: CameraModel,
        origin: Origin,
        listen: Callable[[], None],
        name: str = "oracle",
        pilot: TruthPilot = oracle.reply_nearest,
        *,
        kept: int = KEPT,
        obeys: bool = True,
        looks: bool = False,
    ) -> None:
        """`listen` is called before each answer. It passes the waiting bytes of the truth bus to `feed`.

        kept: truth samples to keep per drone, for pictures of earlier times. obeys: if a request has only one drone,
        the drone flies to the candidate that the commander's goal in the prompt names. looks: measure the target's
        visibility, for a pilot that needs it.
        """
        self.name = name
        self._world, self._camera, self._listen, self._pilot = world, camera, listen, pilot
        self._truth = NewestTruth(origin, kept)
        self._taken: dict[int, int] = {}  # drone → time of the drone's picture, µs
        self.feed = self._truth.feed  # accepts bytes of the truth bus
        self._obeys, self._looks = obeys, looks
        if looks:
            world.warm_up()
        self._t0_us: int | None = None

    def begin(self, t0_us: int) -> None:
        self._t0_us = t0_us

    def ask(self, request: Request) -> Reply:
        """Return the reply for all drones of the request, which has one picture per drone."""
        self._listen()
        drones = range(request.drone, request.drone + len(request.images_jpeg))
        self._taken = dict(zip(drones, request.taken_us, strict=False))
        if len(drones) == 1 and self._obeys:
            return Reply(self._reply_alone(request.drone, request.step, actions.read_prompt(request.text).command), 0.0)
        return Reply(self._pilot([self._state(drone, request.step) for drone in drones]), 0.0)

    def _reply_alone(self, drone: int, step: int, command: str) -> str:
        """Return the action of the only drone in a request: it flies to the candidate that the goal `command` names.

        At a candidate that is not the target the drone does not declare; the reply is `think`.
        """
        place, state = commander.place_in_goal(command), self._state(drone, step)
        row = candidates_in_row(self._world, self._world.record.starts[drone])
        if place is None or place > len(row) or row[place - 1] is self._world.target:
            return self._pilot([state])
        candidate = replace(state, target_ned=row[place - 1].centre_ned, target_velocity_ned=(0.0, 0.0, 0.0))
        reply = self._pilot([candidate])
        return actions.think() if reply == actions.finished() else reply

    def _state(self, drone: int, step: int) -> TrueState:
        taken_us = self._taken.get(drone)
        at_picture = None if taken_us is None else self._truth.at(drone, taken_us)
        sample = at_picture[0] if at_picture else self._truth.of(drone)
        if sample is None:
            raise ModelError(f"the pilot {self.name} has received no pose of drone {drone + 1}")
        t_s = 0.0 if self._t0_us is None else max(0.0, (sample.time_us - self._t0_us) / 1e6)
        here, soon = self._world.target_centre(t_s), self._world.target_centre(t_s + AHEAD_S)
        north, east, down = ((b - a) / AHEAD_S for a, b in zip(here, soon, strict=True))
        camera = self._camera.at_pitch(sample.gimbal_pitch)
        return TrueState(
            sample.position_ned, quat_yaw(sample.attitude), sample.attitude, here, (north, east, down), camera,
            drone, step, self._visible(sample, t_s) if self._looks else True,
        )  # fmt: skip

    def _visible(self, sample: TruthSample, t_s: float) -> bool:
        """Return whether the target is visible from the pose, measured as by the logger. Other drones may hide it."""
        fleet = self._truth.at(sample.drone, sample.time_us)
        neighbours = [DronePose(d.position_ned, d.attitude) for d in fleet[1].values()] if fleet else []
        camera = self._camera.at_pitch(sample.gimbal_pitch)
        return bool(self._world.measure(t_s, sample.position_ned, sample.attitude, camera, neighbours).visible)


def candidates_in_row(world: World, start: StartPose) -> list[Instance]:
    """Return the target and its look-alikes from left to right, as seen from a start pose."""
    candidates = world.target_and_lookalikes
    yaw, (north, east, _) = math.radians(start.yaw_deg), start.position_ned

    def bearing(candidate: Instance) -> float:
        middle = candidate.centre_ned
        return wrap_pi(math.atan2(middle[1] - east, middle[0] - north) - yaw)

    return sorted(candidates, key=bearing)
