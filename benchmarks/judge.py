"""Measures how long `dronecats judge` takes for a thousand episodes, with their replies and stored verdicts.

    python -m benchmarks.judge [--json] [--episodes N] [--processes N] [--short]

First makes the episodes (not timed): random walks with the same logs as a real flight. Of every five episodes, four
have one drone and one has a fleet of four. Each lasts 300 s (its cap), with a decision every 2.6 s. `judge_s` is the
wall time for all episodes. `cpu_ms_per_episode` is the processor time per episode, summed over all processes.
`…_per_loop` is the same time, in units of an empty loop's time (`benchmarks/machine.py`). `--short` only checks that it
works.
"""

import json
import math
import random
import tempfile
import time
from pathlib import Path
from typing import Any

from benchmarks.machine import Machine, benchmark_parser, total_cpu_s
from dronecats.judge.episode import write_verdict
from dronecats.judge.metrics.judging import Judging, judged_episodes
from foundation.frames import Vec3
from foundation.protocol import CAP_S, POSE_PERIOD_S
from foundation.run_folder import layout
from foundation.run_folder.rows import Begin, Decision, End, FrameTruth, Pose
from foundation.run_folder.writing import write_lines

EVERY_S = 2.6  # s between two decisions
FLEET_EVERY, FLEET = 5, 4  # every fifth episode has a fleet, of four drones
GOAL_S = 5.0
TARGET: Vec3 = (20.0, 0.0, -0.7)  # m, NED


def write_episode(folder: Path, number: int) -> None:
    """Write logs, record and verdict of a random flight. `number` is the seed."""
    rng, drones = random.Random(number), FLEET if number % FLEET_EVERY == 0 else 1
    folder.mkdir(parents=True)
    truth: list[Any] = [Begin(t0_us=32_000_000, cap_s=CAP_S)]
    walks = [_Walk(rng) for _ in range(drones)]
    for k in range(int(CAP_S / POSE_PERIOD_S)):
        truth += [walk.pose(round(k * POSE_PERIOD_S + 0.01, 6), drone) for drone, walk in enumerate(walks)]
    decisions = []
    for step in range(int(CAP_S / EVERY_S)):
        t = round(EVERY_S * step + 0.09, 6)
        truth += [walk.frame(step, t, drone) for drone, walk in enumerate(walks)]
        actions = [_action(rng, step) for _ in walks]
        reply = json.dumps(actions[0] if drones == 1 else actions)
        decisions += [_decision(step, drone, t, reply, action) for drone, action in enumerate(actions)]
    truth.append(End(t=CAP_S, reason="cap"))
    write_lines(folder / layout.TRUTH, truth)
    write_lines(folder / layout.DECISIONS, decisions)
    record = {
        "id": folder.name, "map": "blocks", "cell": "approaching" if drones == 1 else "commanding",
        "target": {"position_ned": [20.0, 0.0, 0.0]},
        "candidates": [{"position_ned": [20.0, 8.0 * k, 0.0]} for k in (-1, 1, 2)] if drones > 1 else [],
    }  # fmt: skip
    (folder / layout.EPISODE).write_text(json.dumps(record), encoding="utf-8")
    write_verdict(folder)


class _Walk:
    """A random walk of one drone, which makes rows of the truth log."""

    def __init__(self, rng: random.Random) -> None:
        self._rng, self._yaw_deg = rng, 0.0
        self._place: Vec3 = (0.0, rng.uniform(-3.0, 3.0), -2.0)

    def pose(self, t: float, drone: int) -> Pose:
        self._step()
        return Pose(
            t=t, drone=drone, position_ned=self._place, yaw_deg=self._yaw_deg, target_ned=TARGET,
            distance_m=self._distance_m(), visible=abs(self._yaw_deg) < 40.0,
        )  # fmt: skip

    def frame(self, number: int, t: float, drone: int) -> FrameTruth:
        self._step()
        return FrameTruth(
            frame_id=number, t=t, drone=drone, position_ned=self._place, yaw_deg=self._yaw_deg, target_ned=TARGET,
            distance_m=self._distance_m(), distance_box_m=round(0.9 * self._distance_m(), 4),
            visible=abs(self._yaw_deg) < 40.0, visible_fraction=0.5, bearing_deg=self._yaw_deg,
            oracle_depth_m=round(0.95 * self._distance_m(), 4), target_frd=(9.1234, -0.4321, 1.0987),
            target_box=(412.25, 500.5, 460.75, 570.0),
        )  # fmt: skip

    def _step(self) -> None:
        north, east, down = self._place
        there = (north + self._rng.gauss(0.0, 0.3), east + self._rng.gauss(0.0, 0.3), down)
        self._place = (round(there[0], 4), round(there[1], 4), there[2])
        self._yaw_deg = round(math.remainder(self._yaw_deg + self._rng.gauss(0.0, 10.0), 360.0), 4)

    def _distance_m(self) -> float:
        return round(math.dist(self._place, TARGET), 4)


def _action(rng: random.Random, step: int) -> dict[str, Any]:
    if step % 40 == 39:
        return {"action": "finished"}
    if rng.random() < 0.3:
        return {"action": "rotate", "angle_deg": float(rng.randint(-90, 90))}
    point = [float(rng.randint(0, 1000)), float(rng.randint(0, 1000))]
    return {"action": "go", "point": point, "depth_m": round(rng.uniform(1.0, 30.0), 2)}


def _decision(step: int, drone: int, t: float, reply: str, action: dict[str, Any]) -> Decision:
    return Decision(
        step=step, drone=drone, frame_id=step, t_frame=t, t_decided=round(t + 0.5, 6), reply=reply, action=action,
        latency_s=0.5, tokens_in=1400, tokens_out=30, thinking=False, rate_hz=0.384615,
    )  # fmt: skip


def measured(episodes: int, processes: int | None) -> dict[str, Any]:
    """Return the figures."""
    with tempfile.TemporaryDirectory() as scratch:
        folders = [Path(scratch) / f"episode-{number:04}" for number in range(episodes)]
        for number, folder in enumerate(folders):
            write_episode(folder, number)
        megabytes = sum(path.stat().st_size for path in Path(scratch).glob("*/*")) / 1e6
        machine = Machine()
        began, spent = time.perf_counter(), total_cpu_s()
        doubtful = sum(episode.doubtful for episode in judged_episodes(folders, Judging(), processes))
        judge_s, cpu_ms = time.perf_counter() - began, 1e3 * (total_cpu_s() - spent) / episodes
        machine.look()
    return {
        "episodes": episodes,
        "megabytes": round(megabytes, 1),
        "doubtful": doubtful,
        "judge_s": round(judge_s, 2),
        "goal_s": GOAL_S,
        "cpu_ms_per_episode": round(cpu_ms, 2),
        "cpu_ms_per_episode_per_loop": machine.per_loop(cpu_ms),
        "machine": machine.figures(),
    }


def main() -> None:
    """Measure and print."""
    parser = benchmark_parser(__doc__, short="judge ten episodes, to check that it works")
    parser.add_argument("--episodes", type=int, default=1000, help="number of episodes (default 1000)")
    parser.add_argument("--processes", type=int, help="processes (default: chosen by the number of episodes)")
    args = parser.parse_args()
    figures = measured(10 if args.short else args.episodes, args.processes)
    if args.json:
        print(json.dumps(figures))
    else:
        print(
            f"{figures['episodes']} episodes, {figures['megabytes']} MB, in {figures['judge_s']} s (goal {GOAL_S:g} s)"
        )
        print(f"{figures['cpu_ms_per_episode']} ms of a processor each")


if __name__ == "__main__":
    main()
