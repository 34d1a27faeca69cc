"""Delays of the host and delays of the model are measured separately. All clocks are simulated."""

import json
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dronecats.agent.cockpit import Cockpit, HostPace
from dronecats.agent.latency import LatencyPolicy
from dronecats.agent.loop import PaperAgent, Questions
from dronecats.agent.models.model import Reply
from dronecats.agent.prompt import Prompt
from dronecats.judge.diagnostics import STALL_S, delayed, host_stalls
from foundation.run_folder.reading import rows
from foundation.run_folder.rows import Decision
from foundation.run_folder.writing import LineLog
from foundation.threads import InlineExecutor
from tests.agent.flown_wire import CAMERA, Clock, Views


class Wall:
    """A wall clock."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


def tick_at(wall: Wall, pace: HostPace, wall_s: float, vehicle_s: float) -> None:
    wall.now_s = wall_s
    pace.tick(vehicle_s)


@pytest.mark.parametrize("speed", [0.5, 1.0, 4.0])
def test_a_vehicle_clock_that_keeps_pace_has_no_lag(speed: float) -> None:
    wall = Wall()
    pace = HostPace(wall, speed)
    watch = pace.watch()
    for k in range(100):
        tick_at(wall, pace, 0.05 * k / speed, 12.0 + 0.05 * k)
    lag_s, waited_s = watch.take()
    assert (lag_s, waited_s) == pytest.approx((0.0, 0.0), abs=1e-9)


def test_a_recovered_stall_counts_in_one_step_of_each_decider() -> None:
    wall = Wall()
    pace = HostPace(wall, 1.0)
    watch, other = pace.watch(), pace.watch()
    tick_at(wall, pace, 0.0, 5.0)
    tick_at(wall, pace, 0.6, 5.1)  # the vehicle's clock stops for 0.5 s
    tick_at(wall, pace, 0.7, 5.7)  # and catches up
    assert watch.take()[0] == pytest.approx(0.5)
    tick_at(wall, pace, 0.8, 5.8)
    assert watch.take()[0] == pytest.approx(0.0, abs=1e-9)
    assert other.take()[0] == pytest.approx(0.5)  # each decider has its own steps


def test_a_stall_at_the_start_of_a_step_counts_in_that_step() -> None:
    wall = Wall()
    pace = HostPace(wall, 1.0)
    watch = pace.watch()
    tick_at(wall, pace, 0.0, 5.0)
    watch.take()
    tick_at(wall, pace, 0.55, 5.05)
    assert watch.take()[0] == pytest.approx(0.5)


def test_lost_time_does_not_count_as_lag_of_later_steps() -> None:
    wall = Wall()
    pace = HostPace(wall, 1.0)
    watch = pace.watch()
    tick_at(wall, pace, 0.0, 0.0)
    tick_at(wall, pace, 3.0, 0.05)
    assert watch.take()[0] == pytest.approx(2.95)
    for k in range(1, 40):
        tick_at(wall, pace, 3.0 + 0.05 * k, 0.05 + 0.05 * k)
    assert watch.take()[0] == pytest.approx(0.0, abs=1e-9)


@given(st.lists(st.tuples(st.floats(0.0, 1.0), st.floats(0.0, 1.0)), min_size=1, max_size=30))
def test_the_lag_is_the_largest_increase_of_delay_between_two_ticks(steps: list[tuple[float, float]]) -> None:
    wall, late, vehicle_s = Wall(), [], 0.0
    pace = HostPace(wall, 1.0)
    watch = pace.watch()
    for wall_s, flown_s in steps:
        vehicle_s += flown_s
        tick_at(wall, pace, wall.now_s + wall_s, vehicle_s)
        late.append(wall.now_s - vehicle_s)
    naive = max(b - a for k, a in enumerate(late) for b in late[k:])
    assert watch.take()[0] == pytest.approx(naive, abs=1e-9)


class Slow:
    """A model whose reply takes time on the wall clock while the vehicle flies on."""

    name = "slow"

    def __init__(self, delays: Callable[[int], None]) -> None:
        self._delays, self._asked = delays, 0

    def ask(self, request: object) -> Reply:
        self._asked += 1
        self._delays(self._asked)
        return Reply(json.dumps({"action": "rotate", "angle_deg": 30}), 0.1)

    def check(self) -> None:
        pass

    def close(self) -> None:
        pass


class Late(Views):
    """A camera that takes time on the wall clock for its third image."""

    def __init__(self, wall: Wall) -> None:
        super().__init__()
        self._wall, self._taken = wall, 0

    def newest(self, drone=0):
        self._taken += 1
        if self._taken == 3:
            self._wall.now_s += 0.4
        return super().newest(drone)


def test_a_decision_logs_host_delays_separately_from_model_latency(tmp_path) -> None:
    wall, vehicle = Wall(), Clock()
    pace = HostPace(wall, 1.0)
    stalls = {60: 0.4}  # the simulator stops at this tick

    def on_tick() -> None:
        ticks = vehicle.time_us // 50_000
        wall.now_s += 0.05 + stalls.pop(ticks, 0.0)
        pace.tick(vehicle.time_us / 1e6)

    log = LineLog(tmp_path / "decisions.jsonl")
    cockpit = Cockpit(
        aircraft=[vehicle], camera=Late(wall), camera_model=CAMERA, log=log, frames_dir=tmp_path,
        executor=InlineExecutor(), t0_us=0, on_tick=on_tick, host=pace,
    )  # fmt: skip
    policy = LatencyPolicy.parse("fixed:2.0")  # slower than any host in this test
    PaperAgent(Questions(Slow(lambda _count: None), Prompt.load(None), "go", policy), cockpit).fly(14.0)
    log.close()
    decisions = list(rows(tmp_path / "decisions.jsonl", Decision))
    assert len(decisions) >= 5
    assert [delayed(decision) for decision in decisions] == [False, True, True, *[False] * (len(decisions) - 3)]
    assert decisions[1].host_lag_s == pytest.approx(0.4, abs=0.06)
    assert decisions[2].frame_wait_s == pytest.approx(0.4, abs=0.06)
    assert host_stalls(decisions) == 2
    assert all(decision.latency_s == 2.0 for decision in decisions)


def test_without_a_host_clock_there_are_no_host_fields(tmp_path) -> None:
    log = LineLog(tmp_path / "decisions.jsonl")
    cockpit = Cockpit(
        aircraft=[Clock()], camera=Views(), camera_model=CAMERA, log=log, frames_dir=tmp_path,
        executor=InlineExecutor(), t0_us=0,
    )  # fmt: skip
    PaperAgent(
        Questions(Slow(lambda _count: None), Prompt.load(None), "go", LatencyPolicy.parse("fixed:0.5")), cockpit
    ).fly(5.0)
    log.close()
    assert "host" not in (tmp_path / "decisions.jsonl").read_text()
    assert "frame_wait" not in (tmp_path / "decisions.jsonl").read_text()


@pytest.mark.parametrize(
    ("lag_s", "wait_s", "is_delayed"), [(STALL_S, STALL_S, False), (STALL_S + 0.001, 0.0, True), (0.0, 0.3, True)]
)
def test_a_decision_is_delayed_only_beyond_the_stall_threshold(lag_s: float, wait_s: float, is_delayed: bool) -> None:
    step = Decision(
        step=0, drone=0, frame_id=0, t_frame=0.0, t_decided=1.0, action=None, host_lag_s=lag_s, frame_wait_s=wait_s
    )
    assert delayed(step) is is_delayed
    assert host_stalls([step, step]) == int(is_delayed)  # the rows of a fleet's step count once
