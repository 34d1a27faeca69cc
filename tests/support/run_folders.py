"""Synthetic run folders as a flight leaves them: a drone flies north, stride by stride, to its target."""

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from dronecats.agent.action import action_from
from dronecats.agent.prompt import History, Prompt, labels
from foundation.camera import CameraModel
from foundation.protocol import HISTORY_LENGTH
from foundation.run_folder import layout
from foundation.run_folder.writing import PromptLog

TARGET = (20.0, 3.0, -1.0)  # m NED
PERIOD_S = 2.6
POINTS = ([250.0, 400.0], [640.0, 333.0], [512.0, 700.0], [100.0, 900.0], [875.0, 125.0])


def run_folder(
    folder: Path,
    episodes: Mapping[str, str],
    *,
    pilot: str | None = "vision",
    model: Mapping[str, Any] | None = None,
    seed: int = 0,
    drones: int = 1,
    steps: int = 6,
    period_s: float = PERIOD_S,
    pictures: bool = True,
    reply_text: str | None = None,
    **configuration: Any,
) -> Path:
    """Write a run of `episodes` (name → instruction), and return its folder. Drone 0 declares at the last step.

    `reply_text` replaces the text of every reply. The actions stay the same.
    """
    folder.mkdir(parents=True)
    flight = {"pilot": None if model else pilot, "model": model, "seed": seed, "command": "flat",
              "latency": "fixed:0.5", "simulated": {"rendered": pictures}}  # fmt: skip
    about = {"flight": flight, "prompt_sha256": Prompt.load().digest, "clock": "lockstep", **configuration}
    (folder / layout.RUN).write_text(json.dumps(about))
    for name, instruction in episodes.items():
        episode_folder(
            folder / name,
            instruction,
            drones=drones,
            steps=steps,
            period_s=period_s,
            pictures=pictures,
            reply_text=reply_text,
        )
    return folder


def episode_folder(
    folder: Path,
    instruction: str,
    *,
    drones: int = 1,
    steps: int = 6,
    period_s: float = PERIOD_S,
    pictures: bool = True,
    reply_text: str | None = None,
) -> None:
    """Write the folder of one episode. The name of the folder is MAP-CELL-NUMBER."""
    folder.mkdir(parents=True)
    map_name, _, rest = folder.name.partition("-")
    (folder / layout.EPISODE).write_text(json.dumps({
        "version": 1, "id": folder.name, "map": map_name, "map_seed": 1, "cell": rest.rpartition("-")[0],
        "instruction": instruction, "target": {"asset": "suv", "paint": "cyan", "position_ned": [*TARGET[:2], 0.0]},
        "candidates": [{"asset": "suv", "paint": "cyan", "position_ned": [20.0, -9.0, 0.0]}] * (drones > 1),
    }))  # fmt: skip
    decisions: list[dict[str, Any]] = []
    truth: list[dict[str, Any]] = [{"kind": "begin", "t": 0.0, "t0_us": 5, "cap_s": steps * period_s}]
    histories, prompts = [History(CameraModel()) for _ in range(drones)], PromptLog(folder / layout.PROMPTS)
    for step in range(steps):
        past = "\n".join(history.render() for history in histories)
        text = Prompt.load().render(instruction, past, HISTORY_LENGTH, "xy", drones)
        ids = [step * drones + drone for drone in range(drones)]
        prompts.write("pilot", 0, step, 0.1 + step * period_s, ids, labels(drones), text)
        t = round(0.1 + step * period_s, 2)
        actions = [action(step, drone, steps) for drone in range(drones)]
        reply = reply_text if reply_text is not None else json.dumps(actions if drones > 1 else actions[0])
        for drone, what in enumerate(actions):
            histories[drone].append(action_from(what))
            frame_id = step * drones + drone
            decisions.append({
                "step": step, "drone": drone, "frame_id": frame_id, "t_frame": t, "t_decided": round(t + 0.5, 2),
                "reply": reply, "action": what, "error": None, "latency_s": 0.5, "tokens_in": 1000 + step,
                "tokens_out": 14, "thinking": False, "rate_hz": 0.4 if step else None,
            })  # fmt: skip
            truth.append({"kind": "frame", "frame_id": frame_id, **measured(t, drone), "distance_box_m": 1.0,
                          "visible_fraction": 0.9, "bearing_deg": 8.5, "oracle_depth_m": 7.0})  # fmt: skip
    prompts.close()
    end = steps * period_s
    truth += [{"kind": "pose", **measured(k / 2, drone)} for k in range(math.ceil(2 * end)) for drone in range(drones)]
    truth.append({"kind": "end", "t": end, "reason": "cap", "error": None})
    lines(folder / layout.DECISIONS, decisions)
    lines(folder / layout.TRUTH, truth)
    frames = folder / layout.FRAMES
    frames.mkdir()
    for decision in decisions if pictures else ():
        picture(frames / layout.frame_name(decision["frame_id"], decision["drone"]), decision["frame_id"])


def action(step: int, drone: int, steps: int) -> dict[str, Any]:
    """Return a drone's action: `go`, once `rotate`, and at the last step `finished` (drone 0) or `think` (others)."""
    if step == steps - 1:
        return {"action": "think" if drone else "finished"}
    if step == 1:
        return {"action": "rotate", "angle_deg": -30.0 - drone}
    return {"action": "go", "point": POINTS[(step + drone) % len(POINTS)], "depth_m": 6.5}


def measured(t: float, drone: int) -> dict[str, Any]:
    """Return a drone's position at a time, and its distance from the target."""
    place = (min(17.0, 1.3 * t), 2.0 * drone, -2.0)
    return {"t": t, "drone": drone, "position_ned": place, "yaw_deg": 5.0, "target_ned": TARGET,
            "distance_m": round(math.dist(place, TARGET), 4), "visible": True}  # fmt: skip


def picture(path: Path, number: int) -> None:
    """Write a JPEG that differs for every number."""
    rows = np.random.default_rng(number).integers(60, 200, (9, 16, 3), np.uint8)
    cv2.imwrite(str(path), cv2.resize(rows, (320, 180), interpolation=cv2.INTER_CUBIC))


def lines(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write a file of JSON lines."""
    path.write_text("".join(json.dumps(row) + "\n" for row in rows))
