"""The failure modes of the paper, each tested near its threshold."""

import math
from itertools import product
from pathlib import Path
from typing import Any

import pytest

from dronecats.judge.judged_flight import JudgedFlight
from dronecats.judge.metrics.failure_mode import failure_mode, share_ahead, stride
from tests.judge.episode_logs import END, decision, frame, logs, pose

STRIDE = {"action": "go", "point": [500, 500], "depth_m": 9.0}
FAR_M = 20.0


def episode(
    middle_action=None,
    ahead=1.0,
    nearest_m=FAR_M,
    to_and_fro=0,
    turned_deg=0.0,
    way_m=8.0,
    strides=10,
    drones=1,
    **more,
):
    """Return a flight of 100 steps that ends at its cap. All drones act identically.

    `middle_action`: action of step 50; `ahead`: share of steps with the target ahead; `to_and_fro`: m flown sideways,
    in addition to the `way_m` flown forwards.
    """
    decisions, truth = [], []
    for drone in range(drones):
        for step in range(100):
            action = (
                {"action": middle_action}
                if middle_action and step == 50
                else STRIDE
                if step < strides
                else {"action": "think"}
            )
            bearing_deg = 45.0 if step < round(100 * ahead) else -45.1
            number = 1000 * drone + step
            decisions.append({**decision(step, number, 2.0 + 2.5 * step, None, drone), "action": action})
            near_m = nearest_m if step == 50 else FAR_M
            truth.append(frame(number, 1.5 + 2.5 * step, near_m, True, drone, bearing_deg=bearing_deg))
        for k in range(601):
            part = k / 600
            swing = to_and_fro / 600 if k % 2 else 0.0
            yaw = turned_deg * part
            place = [way_m * part, swing, -2.0]
            truth.append(pose(k / 2, FAR_M, True, drone, place, yaw_deg=math.remainder(yaw, 360.0)))
    decisions.sort(key=lambda d: (d["step"], d["drone"]))
    return JudgedFlight(Path("somewhere"), {}, logs(decisions, truth, end=more.get("end", END)))


def test_a_flight_has_the_first_mode_whose_condition_holds():
    flights: list[tuple[str, dict[str, Any]]] = [
        ("success", {"middle_action": "finished", "nearest_m": 4.0}),
        ("declared", {"middle_action": "finished"}),
        ("declared", {"middle_action": "finished", "ahead": 0.0, "way_m": 1.0}),
        ("arrived", {"nearest_m": 5.0}),
        ("arrived", {"nearest_m": 4.9, "ahead": 0.0, "way_m": 1.0}),
        ("did not move", {"way_m": 4.9}),
        ("did not move", {"way_m": 4.9, "ahead": 0.0, "turned_deg": 1000.0}),
        ("never closed", {"way_m": 4.9, "strides": 1}),  # "did not move" needs at least 5 m of commanded strides
        ("never grounded", {"ahead": 0.09}),
        ("never closed", {"ahead": 0.10}),
        ("never grounded", {"ahead": 0.09, "to_and_fro": 90.0, "turned_deg": 800.0}),
        ("oscillated", {"to_and_fro": 90.0, "turned_deg": 721.0}),
        ("never closed", {"to_and_fro": 90.0, "turned_deg": 719.0}),
        ("never closed", {"to_and_fro": 60.0, "turned_deg": 721.0}),
        ("oscillated", {"to_and_fro": 90.0, "turned_deg": -721.0, "nearest_m": 6.0}),
        ("never closed", {"nearest_m": 14.1}),
        ("timed out", {"nearest_m": 13.9}),
    ]
    for (mode, flight), drones in product(flights, (1, 3)):
        assert failure_mode(episode(**flight, drones=drones)) == mode, (flight, drones)


def test_unscored_flights_have_no_mode():
    assert failure_mode(episode(end={**END, "reason": "error", "error": "x"})) is None
    assert failure_mode(episode(end=None)) is None


def test_the_share_ahead_of_a_fleet_is_that_of_its_best_drone():
    first, second = episode(ahead=0.0), episode(ahead=0.5)
    both = JudgedFlight(
        Path("x"), {}, logs(
            [*rows_of(first, 0), *rows_of(second, 1)], [*frames_of(first, 0), *frames_of(second, 1)],
        ),
    )  # fmt: skip
    assert share_ahead(both) == 0.5


def rows_of(judged, drone):
    return [
        {**decision(d.step, d.frame_id, d.t_decided, None, drone), "t_frame": d.t_frame} for d in judged.logs.decisions
    ]


def frames_of(judged, drone):
    return [
        frame(f.frame_id, f.t, f.distance_m, True, drone, bearing_deg=f.bearing_deg)
        for f in judged.logs.frames.values()
    ]


def test_stride_lengths_match_the_controller():
    for depth_m, flown_m in [(1.9, 0.0), (2.0, 1.2), (4.9, 1.8), (5.0, 3.0), (40.0, 3.0)]:
        assert stride(depth_m) == pytest.approx(flown_m), depth_m
