"""Compares the commanding part of a verdict with a second implementation by matrices (docs/commanding.md)."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from tests.judge.episode_logs import decision, frame, judge_folder, logs, outcome, write

RECORD = {
    "cell": "commanding",
    "target": {"position_ned": [20.0, 0.0, 0.0]},
    "candidates": [{"position_ned": [20.0, 8.0, 0.0]}, {"position_ned": [20.0, -8.0, 0.0]}],
}
PINHOLE = np.array([[640.0, 0.0, 640.0], [0.0, 640.0, 360.0], [0.0, 0.0, 1.0]])  # 1280 × 720, 90° across


def go(x, y, depth_m):
    return {"action": "go", "point": [x, y], "depth_m": depth_m}


def flight(steps, record=RECORD):
    """Return logs of steps. A step is a list of (pose or None, action), one per drone.

    A pose is (north, east, down, yaw in °).
    """
    decisions, truth = [], []
    for step, drones in enumerate(steps):
        for drone, (pose, action) in enumerate(drones):
            number = step * 10 + drone
            decisions.append({**decision(step, number, 5.0 + step, None, drone), "action": action})
            there = {} if pose is None else {"position_ned": [*pose[:3]], "yaw_deg": pose[3]}
            truth.append(frame(number, 4.5 + step, 9.0, drone=drone, **there))
    return logs(decisions, truth, record=record)


def projected(pose, action):
    """Return the world position of an action's point, by the inverse camera matrix and homogeneous transforms."""
    point = np.array(action["point"]) * [1.28, 0.72]
    across = np.linalg.inv(PINHOLE) @ [point[0], point[1], 1.0] * action["depth_m"]  # right, down, ahead
    yaw = np.deg2rad(pose[3])
    body = np.eye(4)
    body[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    body[:3, 3] = pose[:3]
    camera = np.array([[0, 0, 1, 0.5], [1, 0, 0, 0], [0, 1, 0, 0.1], [0, 0, 0, 1.0]])
    return (body @ camera @ [*across, 1.0])[:3]


def expected(steps, record):
    """Yield (identical_point, spread in m, places, nears) per step. Examples with near-ties are discarded."""
    things = np.array([record["target"]["position_ned"], *(c["position_ned"] for c in record["candidates"])])[:, :2]
    for drones in steps:
        gone = [action is not None and action["action"] == "go" for _, action in drones]
        is_identical = None
        if all(gone) and len(drones) > 1:
            points = np.array([action["point"] for _, action in drones])
            is_identical = bool((points == points[0]).all())
        places = [projected(*pair) if went and pair[0] else None for went, pair in zip(gone, drones, strict=True)]
        placed = np.array([p for p in places if p is not None])
        apart = None
        if len(placed) > 1:
            gaps = np.linalg.norm(placed[:, None] - placed[None], axis=-1)
            apart = gaps.sum() / (len(placed) * (len(placed) - 1))
        nears: list[int | None] = []
        for (pose, _), place in zip(drones, places, strict=True):
            if place is None:
                nears.append(None)
                continue
            way = place[:2] - np.array(pose[:2])
            length = np.linalg.norm(way)
            after = np.array(pose[:2]) + way * (3.0 / length if length > 3.0 else 1.0)
            closed = np.linalg.norm(things - pose[:2], axis=1) - np.linalg.norm(things - after, axis=1)
            order = np.sort(closed)
            assume(abs(order[-1]) > 1e-6 and order[-1] - order[-2] > 1e-6)
            nears.append(int(closed.argmax()) if closed.max() > 0 else None)
        yield is_identical, apart, places, nears


metres = st.integers(-4000, 4000).map(lambda n: n / 100)
poses = st.none() | st.tuples(metres, metres, metres, st.integers(-180, 360).map(float))
points = st.sampled_from([0, 448, 500, 612, 1000]) | st.integers(0, 1000)
actions = (
    st.builds(go, points, points, st.sampled_from([0.5, 2, 12, 40.25]))
    | st.builds(go, st.just(448), st.just(357), st.just(12))
    | st.sampled_from([None, {"action": "think"}, {"action": "rotate", "angle_deg": 30}])
)


@settings(max_examples=150)
@given(st.lists(st.lists(st.tuples(poses, actions), min_size=1, max_size=4), min_size=1, max_size=5))
def test_every_step_matches_the_second_implementation(steps):
    wanted = list(expected(steps, RECORD))
    commanding = outcome(flight(steps))["commanding"]
    assert [row["step"] for row in commanding["steps"]] == list(range(len(steps)))
    for row, (is_identical, apart, places, nears) in zip(commanding["steps"], wanted, strict=True):
        assert row["identical_point"] is is_identical
        assert row["spread_m"] == (None if apart is None else pytest.approx(apart, abs=6e-4))
        for place, want in zip(row["places_ned"], places, strict=True):
            assert (place is None) == (want is None)
            assert place is None or np.allclose(place, want, atol=6e-4)
        assert row["nears"] == nears
    every = [is_identical for is_identical, *_ in wanted if is_identical is not None]
    assert (commanding["all_go_steps"], commanding["identical_points"]) == (len(every), sum(every))
    assert commanding["identical_share"] == (round(sum(every) / len(every), 4) if every else None)
    spreads = [apart for _, apart, *_ in wanted if apart is not None]
    assert commanding["spread_m"] == (
        pytest.approx(np.median(spreads), abs=1.1e-3) if spreads else None
    )  # the value is rounded twice
    assert commanding["candidates_neared"] == len({n for *_, nears in wanted for n in nears} - {None})


def test_identical_points_are_counted_and_divided_candidates_are_neared():
    start = [(0.0, 2.0 * k, -1.5, 0.0) for k in range(4)]
    pasted = [(pose, go(448, 357, 12)) for pose in start]
    divided = [(pose, go(x, 500, 20)) for pose, x in zip(start, (300, 500, 750, 751), strict=True)]
    paired = [(pose, go(x, 357, 12)) for pose, x in zip(start, (448, 448, 449, 449), strict=True)]
    commanding = outcome(flight([pasted, divided, paired]))["commanding"]
    assert [row["identical_point"] for row in commanding["steps"]] == [True, False, False]
    assert commanding["identical_share"] == 0.3333
    assert commanding["steps"][0]["spread_m"] == pytest.approx(20 / 6, abs=1e-3)  # the spread of the drones themselves
    assert commanding["steps"][1]["nears"] == [2, 0, 1, 1]
    assert commanding["candidates_neared"] == 3


def test_late_steps_have_no_row_and_invalid_points_have_no_place():
    late = logs([{**decision(0, 1, 300.1), "action": go(1, 1, 1)}], [frame(1, 299.6, 9.0)], record=RECORD)
    assert outcome(late)["commanding"]["steps"] == []
    odd = [((0, 0, 0, 0), {"action": "go", **more}) for more in ({}, {"point": [1, "2"], "depth_m": 3})]
    assert outcome(flight([odd]))["commanding"]["steps"][0]["places_ned"] == [None, None]


@pytest.mark.parametrize("record", [None, {**RECORD, "cell": "approaching"}])
def test_verdicts_of_other_episodes_have_no_commanding_part(record):
    assert "commanding" not in outcome(flight([[((0, 0, 0, 0), go(1, 1, 1))]], record))


def test_commanding_part_needs_a_valid_episode_record(tmp_path):
    folder = write(tmp_path / "x", [{**decision(0, 1, 5.0), "action": go(500, 500, 9)}], [])
    assert "commanding" not in judge_folder(folder)
    for text in ("{", '{"cell": "commanding"}', '{"cell": "commanding", "target": {"position_ned": [1, 2]}}'):
        (folder / "episode.json").write_text(text)
        assert "commanding" not in judge_folder(folder)
    (folder / "episode.json").write_text(str(RECORD).replace("'", '"'))
    assert judge_folder(folder)["commanding"]["steps"][0]["drones"] == [0]
