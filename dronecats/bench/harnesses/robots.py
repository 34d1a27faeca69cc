"""Runs the benchmark in Inspect Robots. The drone is the embodiment, an episode is a scene, the judge is the scorer.

    inspect-robots list
    eval("dronecats", policy=MyPolicy(), embodiment="dronecats")

An action is five numbers, in the order of `LABELS`: the kind of action (rounded), and its arguments. Arguments that
the kind does not need are ignored.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from inspect_robots.embodiment import RENDERABLE, RESETTABLE, SEEDABLE, EmbodimentBase, EmbodimentInfo
from inspect_robots.errors import EmbodimentFault
from inspect_robots.rollout import TrialRecord
from inspect_robots.scene import Scene
from inspect_robots.scene import Target as SceneTarget
from inspect_robots.scorer import Score
from inspect_robots.spaces import ActionSemantics, Box, CameraSpec, ObservationSpace
from inspect_robots.task import Task
from inspect_robots.types import Action, Observation, StepResult

from dronecats.agent.models.model import Request
from dronecats.bench.harnesses.outside_flight import KINDS, PICTURE_SHAPE, OutsideFlight, picture, reply
from dronecats.flight.spec.flight_spec import LATENCY, ExternalHarness, FlightSpec, Simulated, latency_policy
from dronecats.judge.episode import verdict_of
from episodes.records import catalogue
from foundation.errors import InfrastructureError, UsageError
from foundation.protocol import CAP_S, POINT_SPAN, SETPOINT_HZ
from foundation.run_folder.folder import fresh_run
from foundation.run_folder.results import SCORED, Result

CAMERA = "forward"
FOLDER = "dronecats_folder"  # key of the flight's folder in a step's info
LABELS = ("kind", "point_x", "point_y", "depth_m", "angle_deg")
LOW = np.array([0.0, 0.0, 0.0, 0.1, -90.0])
HIGH = np.array([len(KINDS) - 1.0, POINT_SPAN, POINT_SPAN, 300.0, 90.0])
STEPS_MAX = int(CAP_S * SETPOINT_HZ)  # not reached before the time limit: a step lasts at least a tick
NOTES = """One step is one decision. `kind`: 0 go, 1 rotate, 2 think, 3 finished.
go: fly towards the picture's point (`point_x`, `point_y`, 0 to 1000 from the upper left corner), which is `depth_m`
away; at most 3 m a step. rotate: turn by `angle_deg`, + right. think: hover. finished: claim to have arrived, within
5 m and with the target in view; the flight goes on, and a false claim costs nothing."""


class DroneEmbodiment(EmbodimentBase):
    """A simulated drone with the project's autopilot. The id of a scene is the id of an episode."""

    def __init__(
        self, latency: str = LATENCY, seconds: float = CAP_S, out: str | Path | None = None, policy: str = "policy"
    ) -> None:
        """`latency`: the vehicle time that a decision costs.

        `out`: folder that gets one run folder per seed (each epoch has its own seed); None: a new one per flight.
        `policy`: name of the policy in the run folder.
        """
        self._latency, self._seconds, self._policy = latency, seconds, policy
        self._out = None if out is None else Path(out)
        self._flight: OutsideFlight | None = None
        height, width, channels = PICTURE_SHAPE
        self.info = EmbodimentInfo(
            name="dronecats",
            action_space=Box(
                shape=(len(LABELS),),
                low=LOW,
                high=HIGH,
                semantics=ActionSemantics(control_mode="eef_delta_pos", frame="camera", dim_labels=LABELS),
            ),
            observation_space=ObservationSpace(cameras=(CameraSpec(CAMERA, height, width, channels),)),
            is_simulated=True,
            capabilities=frozenset({SEEDABLE, RESETTABLE, RENDERABLE}),
            docs=NOTES,
        )

    def reset(self, scene: Scene, *, seed: int | None = None) -> Observation:
        """Begin a flight of the scene's episode. Raises EmbodimentFault when there is no first picture."""
        self.close()
        spec = FlightSpec(
            episode=str(scene.metadata.get("episode", scene.id)),
            simulated=Simulated(speed=None),
            outside=ExternalHarness(harness="inspect-robots", name=self._policy),
            latency=latency_policy(self._latency),
            seconds=self._seconds,
            seed=(seed or 0) % 2**31,
        )
        if len(catalogue.load(spec.episode or "").starts) != 1:
            raise UsageError(f"{scene.id} is for several drones, but this embodiment is one drone")
        run = fresh_run(spec.pilot_name) if self._out is None else self._out / f"seed-{spec.seed}"
        self._flight = OutsideFlight(spec, run)
        question = self._flight.question()
        if question is None:
            raise EmbodimentFault(f"the flight ended before its first image: {self._flight.result().error}")
        return self._seen(question)

    def step(self, action: Action) -> StepResult:
        """Fly one action to its end. Raises EmbodimentFault when the flight fails."""
        flight = self._flight
        if flight is None:
            raise EmbodimentFault("no flight is in progress. Reset the embodiment first")
        kind, x, y, depth_m, angle_deg = (float(number) for number in np.clip(action.data, LOW, HIGH))
        flight.answer(reply(round(kind), (x, y), depth_m, angle_deg))
        question = flight.question()
        if question is not None:
            return StepResult(self._seen(question), info={FOLDER: str(flight.folder)})
        self._flight = None
        result = flight.result()
        if result.outcome not in SCORED:
            raise EmbodimentFault(f"the flight ended in an error and is not scored: {result.error}")
        return _ended(flight, result)

    def close(self) -> None:
        """End the flight, if there is one."""
        if self._flight is not None:
            self._flight.close()
            self._flight = None

    def _seen(self, question: Request) -> Observation:
        assert self._flight is not None
        return Observation(images={CAMERA: picture(question.images_jpeg[0])}, instruction=self._flight.instruction)


def _ended(flight: OutsideFlight, result: Result) -> StepResult:
    won = result.outcome == "success"
    info: Mapping[str, Any] = {FOLDER: str(flight.folder), "verdict": result.as_json()}
    seen = Observation(images={CAMERA: np.zeros(PICTURE_SHAPE, np.uint8)}, instruction=flight.instruction)
    return StepResult(seen, terminated=won, termination_reason="success" if won else None, truncated=not won, info=info)


@dataclass(frozen=True)
class Verdict5m:
    """Scores a flight with the judge, only from the logs in its folder.

    Raises InfrastructureError for a flight that is not scored. Inspect Robots then records an error and no score.
    """

    name: str = "dronecats"

    def __call__(self, record: TrialRecord, target: SceneTarget | None) -> Score:
        folder = next((step.result.info[FOLDER] for step in reversed(record.steps) if FOLDER in step.result.info), None)
        if folder is None:
            raise InfrastructureError(f"{record.scene_id} has no step and is not scored")
        verdict = verdict_of(Path(str(folder)))
        if verdict.outcome not in SCORED:  # for example, `max_steps` ended the trial
            reason = verdict.error or verdict.outcome
            raise InfrastructureError(f"the flight of {record.scene_id} did not end and is not scored: {reason}")
        return Score(value=verdict.outcome == "success", explanation=verdict.outcome, metadata={"ne_m": verdict.ne_m})


def dronecats_task(suite: str = "one-drone") -> Task:
    """Return the one-drone episodes of a suite, or of comma-separated ids and files, as a task."""
    names = catalogue.episodes_of(suite)
    scenes = []
    for name in names:
        record = catalogue.load(name)
        if len(record.starts) == 1:
            about = {"episode": name, "map": record.map, "cell": record.cell}
            scenes.append(Scene(id=record.id, instruction=record.instruction, metadata=about))
    return Task(name=f"dronecats-{suite}", scenes=scenes, scorer=Verdict5m(), max_steps=STEPS_MAX)
