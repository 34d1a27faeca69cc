"""Writes study folders as a campaign leaves them, without flights. Success follows a given law."""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dronecats.bench.matrix import ChosenSuite, choose_suite
from dronecats.flight.spec.flight_spec import FlightSpec, Simulated
from dronecats.flight.spec.spec_file import as_redacted_json
from dronecats.judge.episode import write_verdict
from dronecats.study import design, folder
from dronecats.study.plan import StudyPlan, plan
from foundation.protocol import POSE_PERIOD_S
from foundation.run_folder import folder as folders
from foundation.run_folder.results import Level
from tests.judge.episode_logs import BEGIN, END, frame, pose, write

TRACKING = tuple(f"{place}-tracking-{k:02}" for place in ("campus", "residential") for k in range(1, 11))
APPROACHING = tuple(f"{place}-approaching-{k:02}" for place in ("campus", "residential") for k in range(1, 11))
RUN_FIELDS: dict[str, Any] = {
    "agent": "dronecats.run.pilot.papers_agent", "prompt_sha256": "c" * 64, "code_sha256": "a" * 64,
    "clock": "lockstep", "camera": {"width": 1280, "height": 720, "hfov_deg": 90.0},
    "protocol": {"RADIUS_M": 5.0, "CAP_S": 300.0}, "suite": {"name": "all", "version": 1, "sha256": "5" * 64},
}  # fmt: skip
SECONDS = 16.0  # s, duration of a log
SPEED = 1.2  # m/s, of the target in a tracking episode

Law = Callable[[str, Mapping[str, Level]], float]  # pilot and levels → log odds of success in the median episode


def falling(half: float = 1.2, slope: float = -1.5) -> Law:
    """Return a law with a success rate of 50 % at a latency of `half` s, and at twice that latency for the oracle."""
    return lambda pilot, levels: slope * (float(levels["latency"]) - half * (2.0 if pilot == "oracle" else 1.0))


def write_study(
    out: Path,
    axes: Mapping[str, Sequence[Level]],
    law: Law,
    *,
    pilots: Sequence[str] = ("vision",),
    episodes: Sequence[str] = TRACKING[:4],
    flights: int = 1,
    scatter: float = 1.0,
    made: Callable[[list[design.Axis]], design.Design] = design.full,
    held: Mapping[str, Level] | None = None,
    errors: float = 0.0,
    seed: int = 0,
    same_draws: bool = True,
) -> StudyPlan:
    """Write the folder of a completed study, and return its plan.

    Each episode has its own intercept. With `same_draws`, one draw decides a flight at every level, like one seed.
    Without it, each flight has its own draw. `errors` is the share of flights that the infrastructure broke.
    """
    suite: ChosenSuite = choose_suite(list(episodes), [])
    simulated = Simulated(speed=None, rendered=False)
    base = [(pilot, FlightSpec(pilot=pilot, simulated=simulated, full=True)) for pilot in pilots]
    points = made([design.Axis(name=name, levels=tuple(levels)) for name, levels in axes.items()])
    study_plan = plan("made-up", base, suite, points, held=held or {}, flights=flights)
    folder.write(out, study_plan.study)
    bench = {
        "suite": {"name": "all"},
        "runs": [{"name": run.name, "episodes": list(episodes)} for run in study_plan.entries],
    }
    (out / "bench.json").write_text(json.dumps(bench))
    rng = np.random.default_rng(seed)
    own = dict(zip(episodes, rng.normal(0.0, scatter, len(episodes)), strict=True))
    for place, (entry, run) in enumerate(zip(study_plan.entries, study_plan.study.runs, strict=True)):
        (out / entry.name).mkdir()
        folders.write_run(out / entry.name, {**RUN_FIELDS, "flight": as_redacted_json(entry.flight)})
        for episode in episodes:
            draw = np.random.default_rng(
                [*_number(episode, run.flight_number, seed), *([] if same_draws else [place])]
            ).random(2)
            chance = 1.0 / (1.0 + math.exp(-law(entry.flight.pilot or "", run.levels) - own[episode]))
            write_flown(
                out / entry.name / episode, bool(draw[0] < chance), latency_s=float(run.levels.get("latency", 0.5)),
                broken=bool(draw[1] < errors),
            )  # fmt: skip
    return study_plan


def write_flown(folder: Path, success: bool, latency_s: float = 0.5, broken: bool = False) -> None:
    """Write an episode that ends at its time cap. Its target moves if its cell is `tracking`."""
    cell = folder.name.partition("-")[2].rpartition("-")[0]
    period, speed = latency_s + 2.5, SPEED if cell == "tracking" else 0.0
    near = 3.0 if success else 8.0 + latency_s
    decisions, truth = [], [BEGIN]
    for step in range(int(SECONDS / period)):
        t = 0.1 + step * period
        kind = "finished" if (step + 1) * period > SECONDS - period else "go"
        word = {"action": "go", "point": [500.0, 480.0], "depth_m": 12.5} if kind == "go" else {"action": kind}
        seen = {"target_ned": [20.0 + speed * t, 0.0, -1.0], "target_frd": [_away(t, near), 0.0, 1.0]}
        truth.append(frame(step, t, _away(t, near), **seen))
        decisions.append({
            "step": step, "drone": 0, "frame_id": step, "t_frame": t, "t_decided": t + latency_s, "reply": "",
            "action": word, "error": None, "latency_s": latency_s, "tokens_in": 900, "tokens_out": 20,
            "rate_hz": 1 / period if step else None,
        })  # fmt: skip
    for k in range(int(SECONDS / POSE_PERIOD_S) + 1):
        t = k * POSE_PERIOD_S
        truth.append(pose(t, _away(t, near), visible=t > 2.0 + latency_s, place=[t, 0.0, -2.0],
                          target_ned=[20.0 + speed * t, 0.0, -1.0]))  # fmt: skip
    truth.append({**END, "error": "it broke", "reason": "error", "t": 9.0} if broken else END)
    write(folder, decisions, truth)
    record = {"version": 1, "id": folder.name, "map": folder.name.partition("-")[0], "cell": cell, "instruction": "go"}
    (folder / "episode.json").write_text(json.dumps(record))
    write_verdict(folder)


def change_run(folder: Path, **fields: Any) -> None:
    """Change fields of a run.json."""
    path = folder / "run.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), **fields}))


def change_flight(folder: Path, **fields: Any) -> None:
    """Change fields of the flight in a run.json."""
    path = folder / "run.json"
    document = json.loads(path.read_text())
    path.write_text(json.dumps({**document, "flight": {**document["flight"], **fields}}))


def _away(t: float, near: float) -> float:
    return max(near, 20.0 - 1.5 * t)


def _number(episode: str, flight: int, seed: int) -> list[int]:
    return [*episode.encode(), flight, seed]
