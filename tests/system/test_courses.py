"""The course of a go and the turn of a rotate, compared with the truth, without a pilot that corrects each step."""

import json

import pytest

from dronecats.cli.main import main
from tests.support.flight import fly_beginning
from tests.system.courses import holds, record, start_errors


@pytest.fixture(scope="module")
def high_up(tmp_path_factory):
    """An episode 25 m above the ground, without obstacles."""
    from episodes.records import catalogue

    path = tmp_path_factory.mktemp("episode") / "high-up.json"
    episode = json.loads(catalogue.load("residential-approaching-01").to_json())
    episode["id"], episode["starts"][0]["position_ned"][2] = "high-up", -25.0
    path.write_text(json.dumps(episode))
    return path


def fly(tmp_path, episode, seed, *words):
    pilot = record(tmp_path / "replies.jsonl", seed)
    out = tmp_path / f"run-{seed}"
    arguments = ["--episode", str(episode), "--pilot", f"recorded:{pilot}", "--out", str(out), "--full", *words]
    assert main(["fly", "--sitl", *arguments]) == 0
    return next(path.parent for path in out.glob("*/decisions.jsonl"))


@pytest.mark.parametrize(
    ("latency", "seed", "seconds"),
    [
        ("fixed:0.1", 1, 90),
        pytest.param("fixed:1", 2, 160, marks=pytest.mark.slow),
        pytest.param("fixed:4", 3, 300, marks=pytest.mark.slow),
    ],
)
def test_a_go_flies_to_its_pixel_and_a_rotate_turns_by_its_angle_after_any_action(
    high_up, tmp_path, latency, seed, seconds
):
    pilot = record(tmp_path / "replies.jsonl", seed)
    words = ("--episode", str(high_up), "--pilot", f"recorded:{pilot}", "--latency", latency, "--seed", str(seed))
    holds(fly_beginning(tmp_path / "run", seconds, *words))


@pytest.mark.slow
def test_courses_and_turns_are_correct_with_delayed_telemetry(high_up, tmp_path):
    """At the time of the picture, the newest received position and heading are half a second old."""
    words = ("--speed", "max", "--latency", "fixed:1", "--link", "from.delay=0.5", "--seed", "5")
    holds(fly(tmp_path, high_up, 5, *words))


@pytest.mark.slow("flies five minutes at three times real time")
def test_courses_and_turns_are_correct_over_real_sockets(high_up, tmp_path):
    holds(fly(tmp_path, high_up, 4, "--latency", "real", "--speed", "3"), share=0.9)


BEGINNINGS = ("residential-approaching-01", "campus-searching-02", "campus-tracking-03", "residential-tracking-04")


@pytest.mark.parametrize(("seed", "episode"), list(enumerate(BEGINNINGS)))
def test_an_episode_begins_at_its_recorded_start(tmp_path, episode, seed):
    words = ("--pilot", "oracle", "--episode", episode, "--seed", str(seed))
    across_m, vertically_m, yaw_deg = start_errors(fly_beginning(tmp_path / "run", 1.0, *words))
    assert vertically_m <= 0.1
    assert yaw_deg <= 1.0
    # only GPS gives the position; its error drifts by 6 cm per axis until the episode begins
    assert across_m <= 0.2
