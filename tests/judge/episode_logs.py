"""Builds the logs of an episode row by row, as the agent and the logger write them."""

import json
from pathlib import Path
from typing import Any

from dronecats.judge import episode, judged_flight
from dronecats.judge.metrics.judging import Judging, judged_episode, judged_episodes
from dronecats.report.recorded.run import recorded_runs
from foundation.protocol import RADIUS_M
from foundation.run_folder.reading import Logs, parse_row
from foundation.run_folder.rows import TRUTH_ROWS, Decision, FlownRecord

BEGIN = {"kind": "begin", "t": 0.0, "t0_us": 5}
END = {"kind": "end", "t": 300.0, "reason": "cap", "error": None}
DECIDED = {**END, "reason": "decided", "t": 30.0}


def decision(step, frame_id, t, action="finished", drone=0, **more):
    return {"step": step, "drone": drone, "frame_id": frame_id, "t_frame": t - 0.5, "t_decided": t,
            "action": {"action": action} if action else None, "error": None, **more}  # fmt: skip


def frame(frame_id, t, distance_m, visible=True, drone=0, **more):
    return {"kind": "frame", "frame_id": frame_id, "t": t, "drone": drone, "distance_m": distance_m,
            "visible": visible, **more}  # fmt: skip


def pose(t, distance_m, visible=True, drone=0, place=None, **more):
    return {"kind": "pose", "t": t, "drone": drone, "distance_m": distance_m, "visible": visible,
            "position_ned": place or [t, 0.0, -2.0], **more}  # fmt: skip


def logs(decisions=(), truth=(), begin=BEGIN, end=END, record=None) -> Logs:
    """Return Logs with these rows. `truth` holds all rows of truth.jsonl except the first and the last."""

    def row(fields, kind):
        made, fault = parse_row(fields, kind)
        assert fault is None, fault
        return made

    return Logs(
        decisions=tuple(row(d, Decision) for d in decisions),
        frames={(r["drone"], r["frame_id"]): row(r, TRUTH_ROWS["frame"]) for r in truth if r["kind"] == "frame"},
        poses=tuple(row(r, TRUTH_ROWS["pose"]) for r in truth if r["kind"] == "pose"),
        begin=begin and row(begin, TRUTH_ROWS["begin"]),
        end=end and row(end, TRUTH_ROWS["end"]),
        hits=tuple(row(r, TRUTH_ROWS["hit"]) for r in truth if r["kind"] == "hit"),
        clears=tuple(row(r, TRUTH_ROWS["clear"]) for r in truth if r["kind"] == "clear"),
        resets=tuple(row(r, TRUTH_ROWS["reset"]) for r in truth if r["kind"] == "reset"),
        record=record and row(record, FlownRecord),
    )


def judge_folder(folder: Path, delta_m: float = RADIUS_M) -> dict[str, Any]:
    """Return the output of `dronecats judge --json` for an episode folder."""
    return judged_episode(folder, Judging(delta_m=delta_m)).as_json()


def judge_run(run: Path) -> dict[str, Any]:
    """Return the output of `dronecats judge --json` for a run."""
    (recorded,) = recorded_runs([run])
    judged = judged_episodes(recorded.episodes, Judging())
    return {episode.folder.resolve().name: episode.as_json() for episode in judged}


def outcome(flight: Logs, *radius) -> dict[str, Any]:
    """Return the verdict of these logs in the form of verdict.json."""
    return judged_flight.outcome(flight, *radius).as_json()


def write_verdict(folder: Path) -> dict[str, Any]:
    """Judge an episode folder, write its verdict.json, and return the stored verdict."""
    return episode.write_verdict(folder).as_json()


def write(folder: Path, decisions, truth) -> Path:
    """Write the two logs of an episode folder and return the folder. It is created if it is missing."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "decisions.jsonl").write_text("".join(json.dumps(row) + "\n" for row in decisions))
    (folder / "truth.jsonl").write_text("".join(json.dumps(row) + "\n" for row in truth))
    return folder
