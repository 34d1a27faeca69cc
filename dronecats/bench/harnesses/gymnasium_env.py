"""`DroneCATS-v0`: one episode of one drone, or of a fleet with one policy, as a Gymnasium environment.

    import gymnasium
    import dronecats.bench.harnesses.gymnasium_env
    env = gymnasium.make("DroneCATS-v0", episodes=["residential-approaching-01"])

An observation is the picture and the instruction, as the agent's model gets them. An action is go, rotate, think or
finished. A fleet has a picture and an action per drone. Controller, autopilot, logger and judge are those of
`dronecats fly`. Each flight writes a run folder.
"""

import itertools
import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict, Discrete, Text, Tuple
from numpy.typing import NDArray

from dronecats.agent.models.model import Request
from dronecats.bench.harnesses.outside_flight import KINDS, PICTURE_SHAPE, OutsideFlight, picture, reply
from dronecats.flight.spec.flight_spec import LATENCY, ExternalHarness, FlightSpec, Simulated, latency_policy
from episodes.records import catalogue
from foundation.errors import InfrastructureError, UsageError
from foundation.protocol import CAP_S, POINT_SPAN

ENV_ID = "DroneCATS-v0"
DEPTH_MAX_M = 300.0
ANGLE_MAX_DEG = 90.0
CHARACTERS = frozenset(map(chr, range(32, 0x2100)))  # characters that an instruction may have

# {"frame": (360, 640, 3) uint8 RGB, "instruction": str}; for n drones, "frames": (n, 360, 640, 3) instead of "frame"
EnvObservation = dict[str, Any]
EnvAction = dict[str, Any] | tuple[dict[str, Any], ...]  # a tuple: one action per drone of a fleet
# an action: {"kind": 0 … 3, "point": (2,) 0 … 1000, "depth_m": (1,) m, "angle_deg": (1,) °}


class DroneCatsEnv(gymnasium.Env[EnvObservation, EnvAction]):
    """The environment. `reset` begins a flight of the next episode; a step ends when the next pictures arrive.

    terminated: the flight succeeded. truncated: the flight ended without success, for example at its time limit.
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
        """`episodes`: ids or files, which `reset` takes one after another; empty: the one-drone suite.

        `reward`: with "none" always 0; with "verdict" 1 for the last step of a success, else 0. `out`: each flight gets
        a folder in it, named by the next free number. Without `out`, a flight's folder is removed at the next `reset`
        or `close`. `policy`: the pilot's name in run.json. Raises UsageError for episodes with different numbers of
        drones, because their spaces differ.
        """
        self._records = {name: catalogue.load(name) for name in episodes or catalogue.suite_ids("one-drone")}
        self._names = list(self._records)
        self._drones = len(self._records[self._names[0]].starts)
        for name, record in self._records.items():
            if len(record.starts) != self._drones:
                raise UsageError(
                    f"{name} is for {len(record.starts)} drones, and {self._names[0]} for {self._drones}: "
                    "each number of drones needs its own environment"
                )
        self._reward, self._latency, self._seconds, self._policy = reward, latency, seconds, policy
        self._kept = None if out is not None else tempfile.TemporaryDirectory(prefix="dronecats-")
        self._out = Path(out if out is not None else self._kept.name)  # type: ignore[union-attr]
        self._begun = 0  # number of flights begun so far; selects the next episode
        self._run: Path | None = None  # folder of the newest flight
        self._numbers = itertools.count(1)  # names of the flights' folders; skips folders of other environments
        self._flight: OutsideFlight | None = None
        self.render_mode = render_mode
        self.observation_space = observation_space(self._drones)
        self.action_space = action_space(self._drones)
        self._frames: NDArray[np.uint8] = np.zeros(frames_shape(self._drones), np.uint8)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[EnvObservation, dict[str, Any]]:
        """Begin a flight of `options["episode"]`, else of the episode that the seed selects, else of the next one.

        Equal seeds give equal flights. Raises UsageError, InfrastructureError.
        """
        super().reset(seed=seed)
        self._end()
        if options and "episode" in options:
            name = str(options["episode"])
            if name not in self._records:
                raise UsageError(f"{name} is not an episode of this environment")
        else:
            name = self._names[self._begun % len(self._names) if seed is None else seed % len(self._names)]
        drawn = int(self.np_random.integers(2**31 - 1))
        self._begun += 1
        spec = FlightSpec(
            episode=name,
            simulated=Simulated(speed=None),
            outside=ExternalHarness(harness="gymnasium", name=self._policy),
            latency=latency_policy(self._latency),
            seconds=self._seconds,
            seed=drawn,
        )
        self._flight = OutsideFlight(spec, self._new_run())
        question = self._flight.question()
        if question is None:
            raise InfrastructureError(f"the flight ended before its first image: {self._flight.result().error}")
        return self._seen(question), {"episode": self._records[name].id}

    def step(self, action: EnvAction) -> tuple[EnvObservation, float, bool, bool, dict[str, Any]]:
        """Fly an action to its end; return the next observation. Raises InfrastructureError when the flight fails."""
        if self._flight is None:
            raise gymnasium.error.ResetNeeded("no flight is in progress. Call reset first")
        self._flight.answer(joint_reply(action, self._drones))
        question = self._flight.question()
        if question is not None:
            return self._seen(question), 0.0, False, False, {}
        flight, self._flight = self._flight, None
        result = flight.result()
        if result.outcome == "error":
            raise InfrastructureError(f"the flight ended in an error and is not scored: {result.error}")
        won = result.outcome == "success"
        last = observation(self._frames.copy(), flight.instruction)
        return last, float(won and self._reward == "verdict"), won, not won, {"verdict": result.as_json()}

    def render(self) -> NDArray[np.uint8] | None:
        """Return the newest picture, (360, 640, 3) RGB; with n drones, the stacked pictures, (n · 360, 640, 3)."""
        return self._frames.reshape(-1, *self._frames.shape[-2:]).copy() if self.render_mode == "rgb_array" else None

    def close(self) -> None:
        """End the flight, and remove the folders if there is no `out`."""
        self._end()
        if self._kept is not None:
            self._kept.cleanup()

    def _end(self) -> None:
        if self._flight is not None:
            self._flight.close()
            self._flight = None
        if self._kept is not None and self._run is not None:
            shutil.rmtree(self._run, ignore_errors=True)
            self._run = None

    def _new_run(self) -> Path:
        """Create and return the folder with the next free number. Raises UsageError."""
        for number in self._numbers:
            self._run = self._out / f"{number:06d}"
            try:
                self._run.mkdir(parents=True)  # atomic: environments that share a folder get different numbers
                break
            except FileExistsError:
                continue
            except OSError as error:
                raise UsageError(f"the run folder {self._run} cannot be written: {error.strerror}") from None
        assert self._run is not None
        return self._run

    def _seen(self, question: Request) -> EnvObservation:
        assert self._flight is not None
        self._frames = frames(question.images_jpeg)
        return observation(self._frames, self._flight.instruction)


class Instruction(Text):
    """A text space whose `repr` shows the size of the character set, not all characters."""

    def __repr__(self) -> str:
        return f"Instruction({self.min_length}, {self.max_length}, charset of {len(self.character_set):,} characters)"


def observation_space(drones: int) -> Dict:
    pictures = Box(0, 255, frames_shape(drones), np.uint8)
    instruction = Instruction(max_length=1000, charset=CHARACTERS)
    return Dict({"frame" if drones == 1 else "frames": pictures, "instruction": instruction})


def action_space(drones: int) -> gymnasium.Space[Any]:
    """Return the space of an action, or of a tuple of one action per drone."""
    return _action() if drones == 1 else Tuple([_action() for _ in range(drones)])


def _action() -> Dict:
    return Dict(
        {
            "kind": Discrete(len(KINDS)),
            "point": Box(0.0, POINT_SPAN, (2,), np.float32),
            "depth_m": Box(0.1, DEPTH_MAX_M, (1,), np.float32),
            "angle_deg": Box(-ANGLE_MAX_DEG, ANGLE_MAX_DEG, (1,), np.float32),
        }
    )


def joint_reply(action: EnvAction, drones: int) -> str:
    """Return an action as the text of a reply. Raises ValueError unless there is one action per drone."""
    if isinstance(action, dict):
        action = (action,)
    if len(action) != drones:
        raise ValueError(f"{drones} drones need one action each, got {len(action)}")
    replies = [
        reply(int(a["kind"]), a["point"], float(np.ravel(a["depth_m"])[0]), float(np.ravel(a["angle_deg"])[0]))
        for a in action
    ]
    return replies[0] if drones == 1 else f"[{', '.join(replies)}]"


def frames_shape(drones: int) -> tuple[int, ...]:
    """Return the shape of all pictures: (360, 640, 3), or (n, 360, 640, 3) for a fleet."""
    return PICTURE_SHAPE if drones == 1 else (drones, *PICTURE_SHAPE)


def frames(images_jpeg: Sequence[bytes]) -> NDArray[np.uint8]:
    """Return the pictures of a question in `frames_shape`."""
    pictures = [picture(jpeg) for jpeg in images_jpeg]
    return pictures[0] if len(pictures) == 1 else np.stack(pictures)


def observation(pictures: NDArray[np.uint8], instruction: str) -> EnvObservation:
    """Return the observation of pictures in `frames_shape`."""
    return {"frame" if pictures.ndim == len(PICTURE_SHAPE) else "frames": pictures, "instruction": instruction}


if ENV_ID not in gymnasium.registry:
    gymnasium.register(id=ENV_ID, entry_point=f"{__name__}:{DroneCatsEnv.__name__}")
