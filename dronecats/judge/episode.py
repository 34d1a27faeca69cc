"""The outcome of an episode folder: success, failure, or error, which is nobody's score."""

import json
import math
from pathlib import Path
from typing import Any

from dronecats.border.errors import UsageError
from dronecats.judge.diagnostics import diagnostics
from dronecats.judge.distances import distances
from dronecats.judge.files import Logs, UnmeasuredError, declarations, finished, json_object, last_action, read
from dronecats.judge.verdict import CAP_S, DELTA_M, Verdict, judge


def outcome(logs: Logs, delta_m: float = DELTA_M) -> dict[str, Any]:
    """Return the whole verdict of an episode's logs.

    A qualifying declaration is a success however the flight ended. Without one, a flight that the logger did not see
    end at the cap or by decision, or one with an unmeasured frame, is an error of the infrastructure, never a failure.
    Where nobody knew the truth `success` is None: the outcome is unknown, or "distance only" with `distances`, when the
    autopilot's own estimate and a surveyed target tell how near it came, though not whether the target was in view.
    """
    claims = finished(logs)
    measured = distances(logs, delta_m)
    try:
        verdict = judge(declarations(logs), last_action(logs), delta_m) if logs.true else Verdict(False, None, None)
        error = None if verdict.success else _interrupted(logs)
    except UnmeasuredError as unmeasured:
        verdict, error = Verdict(False, None, None), str(unmeasured)
    steps = max((d["step"] + 1 for d in logs.decisions), default=0)
    deciding = verdict.deciding
    return {
        "outcome": "error" if error else _named(verdict, logs.true, measured is not None),
        "success": verdict.success if logs.true else None,
        "ne_m": verdict.ne_m,
        "delta_m": delta_m,
        "steps": steps,
        "declarations": sum(d["t_decided"] <= CAP_S for d in claims),
        "declarations_after_cap": sum(d["t_decided"] > CAP_S for d in claims),
        "deciding": (
            {"step": deciding.step, "drone": deciding.drone, "t": deciding.t, "distance_m": deciding.distance_m}
            if deciding
            else None
        ),
        "error": error,
        "diagnostics": diagnostics(logs, delta_m),
        **({} if logs.true else {"distances": measured}),
    }


def _named(verdict: Verdict, true: bool, measured: bool) -> str:
    if true:
        return "success" if verdict.success else "failure"
    return "distance only" if measured else "unknown"


def _interrupted(logs: Logs) -> str | None:
    if logs.begin is None:
        return "the episode never began"
    if logs.end is None:
        return "the log breaks off: the logger did not see the episode end"
    if logs.end["reason"] in ("cap", "decided"):
        return None
    return str(logs.end.get("error") or logs.end["reason"])


def judge_folder(folder: Path, delta_m: float = DELTA_M) -> dict[str, Any]:
    """Return `outcome` of an episode folder, with `stored_agrees`: whether verdict.json says the same.

    None when there is no verdict.json, or when it was made with another radius. Raises UsageError.
    """
    result = outcome(read(folder), delta_m)
    stored = json_object(folder / "verdict.json")
    agrees = None
    if stored is not None and stored.get("delta_m") == delta_m:
        agrees = all(stored.get(key) == result[key] for key in ("outcome", "success", "ne_m", "declarations"))
    return {**result, "stored_agrees": agrees}


def judge_run(run: Path, delta_m: float = DELTA_M) -> dict[str, dict[str, Any]]:
    """Return the verdict of every episode of a run folder (or of the one episode folder given), by episode id."""
    if not math.isfinite(delta_m) or delta_m <= 0:
        raise UsageError(f"--delta wants a radius in metres above 0, got {delta_m:g}")
    if not run.is_dir():
        raise UsageError(f"there is no folder {run}")
    folders = [run] if (run / "decisions.jsonl").exists() else sorted(p.parent for p in run.glob("*/decisions.jsonl"))
    if not folders:
        raise UsageError(f"{run} holds no episode: a folder with decisions.jsonl and truth.jsonl is wanted")
    return {folder.resolve().name: _judged(folder, delta_m) for folder in folders}


def _judged(folder: Path, delta_m: float) -> dict[str, Any]:
    """One damaged episode is an error of its own and does not keep the others of a run from being judged."""
    try:
        return judge_folder(folder, delta_m)
    except UsageError as damage:
        nothing = Logs((), {}, (), None, None)
        return {**outcome(nothing, delta_m), "error": str(damage), "stored_agrees": None}


def write_verdict(folder: Path, delta_m: float = DELTA_M) -> dict[str, Any]:
    """Judge an episode folder, store verdict.json in it, and return the verdict."""
    result = outcome(read(folder), delta_m)
    (folder / "verdict.json").write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
    return result
