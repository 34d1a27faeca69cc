"""Compares the diagnostics with a naive implementation of docs/run-folder.md on a fine time grid.

Times are multiples of 1/16 s, which a float represents exactly.
"""

import math
from collections.abc import Callable, Iterable
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dronecats.judge.diagnostics import drone_diagnostics, fleet_diagnostics
from foundation.run_folder.rows import FrameTruth
from tests.judge.episode_logs import BEGIN, END, decision, frame, logs, outcome, pose

TICK_S = 1 / 16
GAP_TICKS = 12  # 0.75 s
CAP_TICKS = 4800  # 300 s

distance = st.none() | st.integers(0, 40).map(lambda n: n / 4)
visible = st.sampled_from([True, True, False, False, None])
place = st.tuples(*[st.integers(-8, 8).map(float)] * 3).map(list)
between = st.sampled_from([8, 8, 8, 8, 4, 12, 13, 40])


@st.composite
def rows(draw, drone):
    """Draw a drone's poses and frames in any order, with gaps, unmeasured rows and times near the start or the cap."""
    drawn, at = [], draw(st.sampled_from([0, 1, 12, 13, CAP_TICKS - 40]))
    for spacing, d, v, position in draw(st.lists(st.tuples(between, distance, visible, place), max_size=12)):
        drawn.append(pose(at * TICK_S, d, v, drone, position))
        at += spacing
    at = draw(st.sampled_from([-1, 2, 30, CAP_TICKS - 30]))
    for number, (spacing, d, v) in enumerate(draw(st.lists(st.tuples(between, distance, visible), max_size=5))):
        drawn.append(frame(number, at * TICK_S, d, v, drone))
        at += spacing
    return draw(st.permutations(drawn))


@st.composite
def flights(draw):
    truth = [row for drone in range(draw(st.integers(1, 3))) for row in draw(rows(drone))]
    end = draw(st.sampled_from([END, {**END, "t": 302.0}, {**END, "t": 9.0, "reason": "decided"}, None]))
    return logs((), truth, end=end)


class Naive:
    """Computes one drone's diagnostics by the definition, tick by tick."""

    def __init__(self, flight, drone, delta_m, cap_s=300.0):
        everything = [r for r in (*flight.poses, *flight.frames.values()) if r.t <= cap_s]
        measured = [r for r in everything if not (r.distance_m is None and r.visible is None)]
        end_s = max([r.t for r in measured] + ([flight.end.t] if flight.end else []), default=0.0)
        self.end = round(min(cap_s, end_s) / TICK_S)
        self.delta_m = delta_m
        self.rows = [r for r in measured if r.drone == drone]
        self.poses = [p for p in flight.poses if p.drone == drone and p.t <= cap_s]
        states = [self.state(tick + 0.5) for tick in range(self.end)]
        self.dwell_s = TICK_S * sum(s is not None and s.visible is True and self.near(s) for s in states)
        self.untraced_s = TICK_S * sum(s is None for s in states)
        self.longest_loss_s, run = 0.0, 0.0
        for state in states:
            run = run + TICK_S if state is not None and state.visible is False else 0.0
            self.longest_loss_s = max(self.longest_loss_s, run)

    def near(self, row):
        return row.distance_m is not None and row.distance_m <= self.delta_m

    def state(self, tick):
        """Return the row that is valid at this tick, or None in a gap."""
        ticks = sorted({r.t / TICK_S for r in self.rows})
        before, after = [t for t in ticks if t <= tick], [t for t in ticks if t > tick]
        until = after[0] if after else self.end
        since = before[-1] if before else 0
        if not ticks or until - since > GAP_TICKS:
            return None
        at = before[-1] if before else after[0]
        same = [r for r in self.rows if r.t / TICK_S == at]
        return next((r for r in same if isinstance(r, FrameTruth) == bool(before)), same[0])

    def figures(self):
        distances = [r.distance_m for r in self.rows if r.distance_m is not None]
        by_time = sorted(self.rows, key=lambda r: (r.t, isinstance(r, FrameTruth)))
        start = next((r.distance_m for r in by_time if r.distance_m is not None), None)
        looked = any(r.visible is not None for r in self.rows)
        path_m = 0.0
        for p in self.poses:
            later = [q for q in self.poses if q.t > p.t]
            following = min(later, key=lambda q: q.t, default=None)
            if following and (following.t - p.t) / TICK_S <= GAP_TICKS:
                path_m += sum((a - b) ** 2 for a, b in zip(p.position_ned, following.position_ned, strict=True)) ** 0.5
        return {
            "min_distance_m": min(distances) if distances else None,
            "start_distance_m": start,
            "approach_ratio": (start - min(distances)) / start if start else None,
            "oracle_success": any(d <= self.delta_m for d in distances) if distances else None,
            "first_seen_s": min((r.t for r in self.rows if r.visible), default=None),
            "dwell_s": self.dwell_s if looked and distances else None,
            "longest_loss_s": self.longest_loss_s if looked else None,
            "path_m": path_m,
            "flown_s": max(r.t for r in self.rows),
            "untraced_s": self.untraced_s,
        }


def assert_same(diagnostics, naive):
    for name, value in naive.items():
        assert getattr(diagnostics, name) == (None if value is None else pytest.approx(value, abs=6e-4)), name


@settings(max_examples=150, deadline=None)
@given(flights(), st.sampled_from([1.0, 5.0]))
def test_every_drone_matches_the_definition(flight, delta_m):
    by_drone = drone_diagnostics(flight, delta_m)
    drones = {row.drone for row in (*flight.poses, *flight.frames.values())}
    for drone in drones:
        naive = Naive(flight, drone, delta_m)
        assert (drone in by_drone) == bool(naive.rows)
        if naive.rows:
            assert_same(by_drone[drone], naive.figures())


BEST: dict[str, Callable[[Iterable[Any]], Any]] = {
    "min_distance_m": min, "start_distance_m": min, "approach_ratio": max, "oracle_success": max, "first_seen_s": min,
    "dwell_s": max, "longest_loss_s": min, "path_m": sum, "flown_s": max, "untraced_s": max,
}  # fmt: skip


@settings(max_examples=50, deadline=None)
@given(flights())
def test_a_fleet_has_the_values_of_its_best_drone_and_the_sum_of_its_paths(flight):
    by_drone = drone_diagnostics(flight)
    fleet = fleet_diagnostics(by_drone)
    assert (fleet is None) == (not by_drone)
    for name, best in BEST.items() if fleet else ():
        values = [
            value for value in (getattr(diagnostics, name) for diagnostics in by_drone.values()) if value is not None
        ]
        expected = best(values) if values else None
        assert getattr(fleet, name) == (pytest.approx(expected, abs=1e-3) if expected is not None else None), name


def trace(until_s, seen=lambda t: True, distance_m=lambda t: 9.0, drone=0):
    return [pose(k / 2, distance_m(k / 2), seen(k / 2), drone) for k in range(int(2 * until_s) + 1)]


def test_longest_loss_covers_a_target_that_stays_lost_or_is_never_seen():
    lost = drone_diagnostics(logs((), trace(300, lambda t: t < 10)))[0]
    assert lost.longest_loss_s == 290.0
    never = drone_diagnostics(logs((), trace(300, lambda t: False)))[0]
    assert (never.longest_loss_s, never.first_seen_s) == (300.0, None)
    late = drone_diagnostics(logs((), trace(300, lambda t: t >= 299.5)))[0]
    assert late.longest_loss_s == 299.5  # visible only at the end: almost the value of a target that is never visible


def test_losses_are_computed_per_drone_and_the_fleet_has_the_shortest():
    flight = logs((), trace(20, lambda t: t < 5) + trace(20, lambda t: t >= 5, drone=1), end={**END, "t": 20.0})
    by_drone = drone_diagnostics(flight)
    assert (by_drone[0].longest_loss_s, by_drone[1].longest_loss_s) == (15.0, 5.0)
    fleet = fleet_diagnostics(by_drone)
    assert fleet is not None
    assert fleet.longest_loss_s == 5.0


def test_fleet_dwell_is_the_longest_of_one_drone_and_not_the_sum():
    both = trace(10, distance_m=lambda t: 3.0) + trace(10, distance_m=lambda t: 4.0, drone=1)
    fleet = fleet_diagnostics(drone_diagnostics(logs((), both, end={**END, "t": 10.0})))
    assert fleet is not None
    assert fleet.dwell_s == 10.0


def test_untraced_time_is_reported():
    flight = logs((), [row for row in trace(60) if not 10 < row["t"] < 40])
    diagnostics = drone_diagnostics(flight)[0]
    assert diagnostics.untraced_s == 30.0 + 240.0  # the gap, and the time from the last pose to the cap
    assert diagnostics.path_m == pytest.approx(30.0)


@settings(deadline=None)
@given(
    st.lists(st.tuples(st.floats(0, 8), st.booleans(), st.sampled_from([10.0, 299.9, 300.0, 300.04])), min_size=1),
    st.floats(0.5, 9),
)
def test_a_success_is_an_oracle_success_with_a_visible_target(declared, delta_m):
    decisions = [
        {**decision(n, n, 0.0), "t_frame": t, "t_decided": min(t, 300.0)} for n, (_, _, t) in enumerate(declared)
    ]
    truth = [frame(n, t, d, v) for n, (d, v, t) in enumerate(declared)]
    verdict = outcome(logs(decisions, [pose(0.0, 20.0, False), *truth]), delta_m)
    if verdict["outcome"] == "success":
        assert verdict["diagnostics"]["oracle_success"]
        assert verdict["diagnostics"]["first_seen_s"] is not None
        assert verdict["diagnostics"]["min_distance_m"] <= verdict["ne_m"]


def test_the_verdict_has_a_row_per_drone():
    truth = [
        *trace(300),
        *trace(300, distance_m=lambda t: 4.0, drone=1),
        frame(0, 9.5, 9.0),
        frame(1, 9.5, 4.0, drone=1),
    ]
    decisions = [decision(0, 0, 10.0), decision(0, 1, 10.0, drone=1)]
    verdict = outcome(logs(decisions, truth, begin=BEGIN))
    first, second = verdict["drones"]
    assert (first["drone"], first["declarations"], first["qualifying"], first["min_distance_m"]) == (0, 1, 0, 9.0)
    assert (second["drone"], second["declarations"], second["qualifying"], second["dwell_s"]) == (1, 1, 1, 300.0)
    assert verdict["diagnostics"]["path_m"] == pytest.approx(first["path_m"] + second["path_m"])
    assert math.isclose(verdict["diagnostics"]["min_distance_m"], 4.0)


def test_turns_beyond_the_allowed_angle_are_counted():
    def turned(step, angle_deg, t=5.0):
        action = {"action": "rotate", "angle_deg": angle_deg}
        return {**decision(step, step, t, "rotate"), "action": action}

    angles = [90, -90.0, 90.5, -120, 360]
    flight = [turned(step, angle) for step, angle in enumerate(angles)]
    assert outcome(logs([*flight, turned(5, 180, 300.5)]))["wide_rotations"] == 3
    assert "wide_rotations" not in outcome(logs(flight[:2]))
    assert "wide_rotations" not in outcome(logs([{**turned(0, 0), "action": {"action": "rotate"}}]))
