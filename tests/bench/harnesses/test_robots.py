"""The Inspect Robots embodiment: it conforms, the rollout of Inspect flies it, and our verifier scores it."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from inspect_robots.conformance import assert_embodiment_conformant
from inspect_robots.eval import eval as evaluate
from inspect_robots.policy import PolicyBase, PolicyInfo
from inspect_robots.rollout import TrialRecord, derive_seed
from inspect_robots.types import Action, ActionChunk

from dronecats.bench.harnesses import robots
from dronecats.bench.harnesses.robots import DroneEmbodiment, Verdict5m, dronecats_task
from foundation.errors import InfrastructureError, UsageError
from foundation.protocol import CAP_S, SETPOINT_HZ


class Turns(PolicyBase):
    """Turns to the right, and declares arrival every third time."""

    def __init__(self, embodiment):
        self.info = PolicyInfo(
            name="turns", action_space=embodiment.info.action_space, observation_space=embodiment.info.observation_space
        )
        self.pictures = []

    def act(self, observation):
        self.pictures.append(observation.images["forward"])
        kind = 3.0 if len(self.pictures) % 3 == 0 else 1.0
        return ActionChunk([Action(np.array([kind, 0.0, 0.0, 1.0, 45.0]))])


def test_the_embodiment_conforms_flies_and_is_scored(tmp_path):
    embodiment = DroneEmbodiment(seconds=8.0, out=tmp_path / "runs")
    assert_embodiment_conformant(embodiment.info)
    policy = Turns(embodiment)
    task = dronecats_task("residential-approaching-03")
    (log,) = evaluate(task, policy, embodiment, log_dir=str(tmp_path / "logs"))
    embodiment.close()
    assert log.status == "success"
    (folder,) = (tmp_path / "runs").glob("seed-*/residential-approaching-03")
    rows = [json.loads(line) for line in (folder / "decisions.jsonl").open()]
    kinds = [row["action"]["action"] for row in rows]
    assert kinds[:3] == ["rotate", "rotate", "finished"]
    assert rows[0]["action"]["angle_deg"] == 45.0
    assert len(policy.pictures) == len(rows)
    assert policy.pictures[0].shape == (360, 640, 3)
    assert json.loads((folder / "verdict.json").read_text())["outcome"] == "failure"
    assert len(list(Path(tmp_path / "logs").rglob("*.json"))) >= 1


def test_a_trial_that_the_step_limit_ends_is_not_scored(tmp_path):
    embodiment = DroneEmbodiment(seconds=60.0, out=tmp_path / "runs")
    task = dataclasses.replace(dronecats_task("residential-approaching-03"), max_steps=2)
    (log,) = evaluate(task, Turns(embodiment), embodiment, log_dir=str(tmp_path / "logs"))
    embodiment.close()
    assert log.status == "error"
    assert "not scored" in str(log.error)
    assert log.results.metrics == {}


def test_a_trial_without_a_step_is_not_scored():
    with pytest.raises(InfrastructureError, match="no step and is not scored"):
        Verdict5m()(TrialRecord(scene_id="residential-approaching-03", epoch=0, seed=0), None)


def test_the_time_limit_comes_before_the_step_limit():
    assert (dronecats_task("residential-approaching-03").max_steps or 0) >= CAP_S * SETPOINT_HZ


def test_each_epoch_has_its_own_run_folder(tmp_path, refused):
    runs = refused(robots)
    embodiment = DroneEmbodiment(out=tmp_path)
    scenes = dronecats_task("residential-approaching-03,residential-approaching-01").scenes
    for epoch in (0, 1):
        for scene in scenes:
            with pytest.raises(UsageError, match="no flight"):
                embodiment.reset(scene, seed=derive_seed(0, scene.init_seed, epoch))
    assert len(set(runs)) == 4  # episodes, epochs
    assert len({run for _, run in runs}) == 2  # the episodes of an epoch share a run
    assert {run.parent for _, run in runs} == {tmp_path}


def test_a_task_contains_only_the_episodes_with_one_drone():
    task = dronecats_task("quick")
    assert len(task.scenes) == 8
    assert {scene.metadata["cell"] for scene in task.scenes} == {
        "approaching", "searching", "tracking", "search-and-track"
    }  # fmt: skip
