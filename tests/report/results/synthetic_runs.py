"""Writes run folders like those of a benchmark, with shipped records, without flying."""

import json
from pathlib import Path
from typing import Any

from dronecats.agent.prompt import Prompt
from dronecats.flight.spec.flight_spec import FlightSpec, Simulated
from dronecats.flight.spec.spec_file import as_redacted_json
from dronecats.judge.episode import write_verdict
from episodes.records import catalogue
from foundation.protocol import POSE_PERIOD_S
from foundation.run_folder import folder as folders
from tests.judge.episode_logs import BEGIN, END, frame, pose, write

START_M, SPEED = 20.0, 1.0  # m from the target, and m/s towards it
SECONDS = 24.0  # length of the log, whose end row says that the episode ended at its cap


def write_run(folder: Path, ids: tuple[str, ...], pilot: str = "oracle", seed: int = 0, **settings: Any) -> Path:
    """Write a run of these episodes and return its folder. Each drone flies straight to its target."""
    spec = FlightSpec(pilot=pilot, simulated=Simulated(speed=None, rendered=False), seed=seed, **settings)
    folder.mkdir(parents=True, exist_ok=True)
    configuration = {"flight": as_redacted_json(spec), "agent": "dronecats.run.pilot.papers_agent",
            "prompt_sha256": Prompt.load().digest, "clock": "lockstep", "camera": None}  # fmt: skip
    folders.write_run(folder, configuration)
    for id in ids:
        write_episode(folder / id, declares=pilot != "failing:never-declares")
    return folder


def write_episode(folder: Path, declares: bool = True) -> Path:
    """Write an episode. All drones fly to within a metre of the target. The first declares there if `declares`."""
    record = catalogue.FOLDER / f"{folder.name}.json"
    drones = range(len(json.loads(record.read_text())["starts"]))
    decisions, truth = [], [BEGIN]
    for step in range(5):
        t = 4.0 * step + 3.0
        word = [_action("finished" if declares and step == 4 and drone == 0 else "go") for drone in drones]
        reply = json.dumps(word if len(drones) > 1 else word[0])
        for drone in drones:
            frame_id = step * len(drones) + drone
            truth.append(frame(frame_id, t - 0.5, _distance(t - 0.5), drone=drone, bearing_deg=2.0 * drone))
            decisions.append(
                {"step": step, "drone": drone, "frame_id": frame_id, "t_frame": t - 0.5, "t_decided": t,
                 "reply": reply, "action": word[drone], "error": None, "latency_s": 0.5,
                 "tokens_in": 900, "tokens_out": 20 + drone}
            )  # fmt: skip
    for drone in drones:
        for k in range(int(SECONDS / POSE_PERIOD_S) + 1):
            t = k * POSE_PERIOD_S
            truth.append(pose(t, _distance(t), drone=drone, place=[START_M - _distance(t), 0.0, -2.0],
                              target_ned=[START_M, 0.0, -2.0]))  # fmt: skip
    truth.append({**END, "t": 300.0})
    write(folder, decisions, truth)
    (folder / "episode.json").write_text(record.read_text(encoding="utf-8"), encoding="utf-8")
    write_verdict(folder)
    return folder


def tell_incidents(folder: Path, *rows: dict[str, Any]) -> None:
    """Add hits, clears and resets to an episode's truth.jsonl, mark them as complete, and judge it again."""
    path = folder / "truth.jsonl"
    begin, *rest = path.read_text(encoding="utf-8").splitlines()
    begun = json.dumps({**json.loads(begin), "contacts": True, "resets": True})
    lines = [begun, *map(json.dumps, rows), *rest]
    path.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
    write_verdict(folder)


def hit(t: float, what: str = "house-25", speed: float | None = 1.2, crash: bool = False) -> dict[str, Any]:
    """Return the row of a hit of the first drone."""
    return {"kind": "hit", "t": t, "drone": 0, "what": what, "closing_speed": speed, "crash": crash}


def clear(t: float, contact_s: float) -> dict[str, Any]:
    """Return the row of the end of a contact."""
    return {"kind": "clear", "t": t, "drone": 0, "contact_s": contact_s}


def reset(t: float, count: int = 1) -> dict[str, Any]:
    """Return the row of a reset of the heading."""
    return {"kind": "reset", "t": t, "drone": 0, "count": count, "quantities": ["yaw"], "yaw_deg": -87.0,
            "position_m": 0.0, "height_m": 0.0, "velocity_mps": 0.0}  # fmt: skip


def _distance(t: float) -> float:
    return max(1.0, START_M - SPEED * t)


def _action(kind: str) -> dict[str, Any]:
    go = {"action": "go", "point": [500.0, 480.0], "depth_m": 12.5}
    return go if kind == "go" else {"action": kind}
