"""`DroneCATS-v0`: one episode of one drone, or of a fleet under one command, as a Gymnasium environment.

    import gymnasium
    import dronecats.bench.bridges.gymnasium_env
    env = gymnasium.make("DroneCATS-v0", episodes=["residential-approaching-01"])

Observed are the picture and the instruction, as the agent's model gets them; an action is one of the four. Of a fleet
there is a picture and an action for each drone (`gymnasium_spaces.py`). The same controller, autopilot, logger and
verifier fly and judge it as fly every pilot, and its folder is a run's.
"""

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import gymnasium
import numpy as np
from numpy.typing import NDArray

from dronecats.agent.models.model import Request
from dronecats.bench.bridges import spaces
from dronecats.bench.bridges.outside_flight import OutsideFlight, OutsideReply
from dronecats.bench.bridges.spaces import Acted, Seen
from dronecats.flight.spec.flight_spec import LATENCY, FlightSpec, Outside, Simulated
from dronecats.flight.spec.latency_trace import latency_policy
from episodes.records import catalogue, suites
from foundation.errors import InfrastructureError, UsageError
from foundation.protocol import CAP_S

ENV_ID = "DroneCATS-v0"


class DroneCatsEnv(gymnasium.Env[Seen, Acted]):
    """An episode. `reset` begins a flight of the next one; a step ends when the next pictures are there.

    terminated: the verdict is decided, which within an episode only success does. truncated: its time is over.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 1}  # noqa: RUF012  # as Gymnasium declares it

    def __init__(
        self,
        episodes: Sequence[str] = (),
        *,
        reward: Literal["none", "verdict"] = "none",
        latency: str = LATENCY,
        seconds: float = CAP_S,
        out: str | Path | None = None,
        policy: str = "policy",
        render_mode: str | None = None,
    ) -> None:
        """`episodes`: ids or files, of which `reset` takes one after another; none: the one-drone suite.

        `reward`: nothing ever, or 1 for the step with which the episode is won. `out`: where the flights are kept, a
        folder each; None: nowhere. `policy`: what run.json calls who acts. Raises UsageError
        for episodes of different numbers of drones, which have different spaces.
        """
        self._records = {each: catalogue.load(each) for each in episodes or suites.ids("one-drone")}
        self._names = list(self._records)
        self._drones = len(self._records[self._names[0]].starts)
        for name, record in self._records.items():
            if len(record.starts) != self._drones:
                others = f"{len(record.starts)} drones, and {self._names[0]} for {self._drones}"
                raise UsageError(f"{name} is for {others}: each number wants an environment of its own")
        self._reward, self._latency, self._seconds, self._policy = reward, latency, seconds, policy
        self._kept = None if out is not None else tempfile.TemporaryDirectory(prefix="dronecats-")
        self._out = Path(out if out is not None else self._kept.name)  # type: ignore[union-attr]
        self._begun = 0
        self._flight: OutsideFlight | None = None
        self.render_mode = render_mode
        self.observation_space = spaces.observation_space(self._drones)
        self.action_space = spaces.action_space(self._drones)
        self._frames: NDArray[np.uint8] = np.zeros(spaces.frames_shape(self._drones), np.uint8)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Seen, dict[str, Any]]:
        """Begin a flight: of `options["episode"]`, or with a seed of the episode that it draws, else of the next one.

        Equal seeds give equal flights. Raises UsageError, InfrastructureError.
        """
        super().reset(seed=seed)
        self._end()
        if options and "episode" in options:
            name = str(options["episode"])
            if name not in self._records:
                raise UsageError(f"{name} is none of the environment's episodes")
        else:
            name = self._names[self._begun % len(self._names) if seed is None else seed % len(self._names)]
        drawn = int(self.np_random.integers(2**31 - 1))
        self._begun += 1
        spec = FlightSpec(
            episode=name,
            simulated=Simulated(speed=None),
            outside=Outside(harness="gymnasium", name=self._policy),
            latency=latency_policy(self._latency),
            seconds=self._seconds,
            seed=drawn,
        )
        self._flight = OutsideFlight(spec, self._out / f"{self._begun:06d}")
        question = self._flight.question()
        if question is None:
            raise InfrastructureError(f"the flight ended before its first picture: {self._flight.result().error}")
        return self._seen(question), {"episode": self._records[name].id}

    def step(self, action: Acted) -> tuple[Seen, float, bool, bool, dict[str, Any]]:
        """Fly an action to its end, and return what is seen then. Raises InfrastructureError when the flight broke."""
        if self._flight is None:
            raise gymnasium.error.ResetNeeded("there is no flight; call reset")
        self._flight.answer(OutsideReply(spaces.joint_reply(action, self._drones)))
        question = self._flight.question()
        if question is not None:
            return self._seen(question), 0.0, False, False, {}
        flight, self._flight = self._flight, None
        result = flight.result()
        if result.outcome == "error":
            raise InfrastructureError(f"the flight is nobody's failure: {result.error}")
        won = result.outcome == "success"
        last = spaces.seen(self._frames.copy(), flight.instruction)
        return last, float(won and self._reward == "verdict"), won, not won, {"verdict": result.as_json()}

    def render(self) -> NDArray[np.uint8] | None:
        """Return the newest picture, (360, 640, 3) RGB; of n drones one above the other, (n · 360, 640, 3)."""
        return self._frames.reshape(-1, *self._frames.shape[-2:]).copy() if self.render_mode == "rgb_array" else None

    def close(self) -> None:
        """End the flight, and remove what nobody wanted kept."""
        self._end()
        if self._kept is not None:
            self._kept.cleanup()

    def _end(self) -> None:
        if self._flight is not None:
            self._flight.close()
            self._flight = None

    def _seen(self, question: Request) -> Seen:
        assert self._flight is not None
        self._frames = spaces.frames(question.images_jpeg)
        return spaces.seen(self._frames, self._flight.instruction)


if ENV_ID not in gymnasium.registry:
    gymnasium.register(id=ENV_ID, entry_point=f"{__name__}:{DroneCatsEnv.__name__}")
