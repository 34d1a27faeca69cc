"""`DroneCATS-v0`: Gymnasium's own checker, rewards and verdicts, and the run folder of its flights."""

import json
import warnings

import cv2
import gymnasium
import numpy as np
import pytest
from gymnasium.spaces import Text
from gymnasium.utils.env_checker import check_env

from dronecats.agent.models.model import Request
from dronecats.bench.harnesses import gymnasium_env
from dronecats.bench.harnesses.gymnasium_env import ENV_ID
from dronecats.bench.harnesses.outside_flight import picture
from foundation.errors import UsageError
from foundation.run_folder.folder import prepare
from foundation.run_folder.layout import frame_name

EPISODE, FLEET = "residential-approaching-03", "blocks-commanding-01"
DECLARE = {"kind": 3, "point": np.zeros(2, np.float32), "depth_m": np.ones(1, np.float32),
           "angle_deg": np.zeros(1, np.float32)}  # fmt: skip


def made(**options):
    return gymnasium.make(ENV_ID, **{"episodes": [EPISODE], "seconds": 5.0, **options}).unwrapped


@pytest.mark.slow  # starts about twenty flights
def test_the_env_checker_of_gymnasium_reports_no_problem():
    env = made(render_mode="rgb_array")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=".*symmetric and normalized space.*")  # the paper's units
        check_env(env)
    env.close()


def test_an_episode_is_truncated_at_its_time_limit_with_a_verdict(tmp_path):
    env = made(out=tmp_path, reward="verdict")
    seen, about = env.reset(seed=0)
    assert about == {"episode": EPISODE}
    assert seen in env.observation_space
    assert "motorcycle" in seen["instruction"]
    assert seen["frame"].std() > 10.0  # not a uniform grey image
    steps = 0
    while True:
        seen, reward, terminated, truncated, about = env.step(DECLARE)
        steps += 1
        if terminated or truncated:
            break
    assert (reward, terminated, truncated) == (0.0, False, True)
    assert about["verdict"]["outcome"] == "failure"
    (folder,) = tmp_path.glob(f"*/{EPISODE}")
    decisions = [json.loads(line) for line in (folder / "decisions.jsonl").open()]
    assert [row["action"] for row in decisions] == [{"action": "finished"}] * steps
    assert json.loads((folder.parent / "run.json").read_text())["flight"]["outside"]["harness"] == "gymnasium"
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(DECLARE)


class ParkedFlight:
    """A flight that begins and never moves."""

    instruction = "go to the motorcycle"

    def __init__(self, spec, run):
        prepare(run / spec.episode)

    def question(self):
        return Request("text", (picture_jpeg(),), thinking=False)

    def close(self):
        pass


def picture_jpeg():
    return cv2.imencode(".jpg", np.zeros((360, 640, 3), np.uint8))[1].tobytes()


def test_environments_may_share_a_folder(tmp_path, monkeypatch):
    monkeypatch.setattr(gymnasium_env, "OutsideFlight", ParkedFlight)
    first, second = made(out=tmp_path), made(out=tmp_path)
    for env in (first, second, first, made(out=tmp_path)):
        env.reset(seed=0)
    first.close()
    assert sorted(run.name for run in tmp_path.iterdir()) == ["000001", "000002", "000003", "000004"]
    assert all((run / EPISODE).is_dir() for run in tmp_path.iterdir())


def test_flights_without_a_folder_are_removed_at_the_next_reset(monkeypatch):
    monkeypatch.setattr(gymnasium_env, "OutsideFlight", ParkedFlight)
    env = made()
    for _ in range(3):
        env.reset(seed=0)
        assert len(list(env._out.iterdir())) == 1
    env.close()
    assert not env._out.exists()


def test_a_fleet_takes_one_action_per_drone(tmp_path):
    env = made(episodes=[FLEET], out=tmp_path, render_mode="rgb_array")
    seen, about = env.reset(seed=0)
    assert seen in env.observation_space
    assert seen["frames"].shape == (4, 360, 640, 3)
    assert env.render().shape == (4 * 360, 640, 3)
    assert len({frame.tobytes() for frame in seen["frames"]}) == 4  # each drone has its own frame
    joint = tuple({**DECLARE, "kind": 1, "angle_deg": np.array([turn], np.float32)} for turn in (10, 20, -30, 40))
    assert joint in env.action_space
    terminated = truncated = False
    while not (terminated or truncated):
        last, _, terminated, truncated, about = env.step(joint)
    assert last in env.observation_space
    assert about["verdict"]["outcome"] == "failure"
    (folder,) = tmp_path.glob(f"*/{FLEET}")
    decisions = [json.loads(line) for line in (folder / "decisions.jsonl").open()]
    first = [row for row in decisions if row["step"] == 0]
    assert [(row["drone"], row["action"]["angle_deg"]) for row in first] == [(0, 10), (1, 20), (2, -30), (3, 40)]
    for row, frame in zip(first, seen["frames"], strict=True):  # in the order of the drones
        kept = folder / "frames" / frame_name(row["frame_id"], row["drone"])
        np.testing.assert_array_equal(picture(kept.read_bytes()), frame)
    with pytest.raises(ValueError, match=r"4 .*1"):
        gymnasium_env.joint_reply(DECLARE, 4)


def test_episodes_of_one_environment_must_have_the_same_number_of_drones():
    with pytest.raises(UsageError, match=f"{FLEET} .*4 .*{EPISODE} .*1"):
        made(episodes=[EPISODE, FLEET])


def test_the_instruction_space_prints_on_one_line_and_equals_a_text_space():
    space = gymnasium_env.observation_space(1)
    assert len(str(space)) < 200
    assert "1000" in str(space)
    assert space["instruction"] == Text(1000, charset=gymnasium_env.CHARACTERS)
