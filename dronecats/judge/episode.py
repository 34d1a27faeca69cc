"""The outcome of an episode folder: success, failure, or what is nobody's score: error, censored, unknown."""

import math
from dataclasses import asdict
from pathlib import Path
from typing import Any

from dronecats.judge import contradictions
from dronecats.judge.diagnostics import of_drones, of_fleet
from dronecats.judge.distances import distances
from dronecats.judge.files import Logs, json_object, read
from dronecats.judge.measured import declarations, finished, last_action, reasons
from dronecats.judge.measures import NOTHING_KNOWN, measures
from dronecats.judge.stored import compare
from dronecats.judge.verdict import CAP_S, DELTA_M, Measured, Verdict, judge
from foundation.errors import InfrastructureError, UsageError
from foundation.json_file import write_json

NOTHING = Logs((), {}, (), None, None)


def outcome(logs: Logs, delta_m: float = DELTA_M) -> dict[str, Any]:
    """Return the whole verdict of an episode's logs. Table of its keys: docs/run-folder.md.

    A qualifying declaration is a success however the flight ended. Without one, a flight that the logger did not see
    end at the cap or by decision, one whose logs contradict their own end, or one with an unmeasured declaration is an
    error of the infrastructure, never a failure; and a flight that was cut off as decided at another radius is
    censored. Where nobody knew the truth `success` is None: the outcome is unknown, or "distance only" with
    `distances`, when the autopilot's own estimate and a surveyed target tell how near it came, though not whether the
    target was in view.
    """
    told = declarations(logs) if logs.true else []
    last = last_action(logs) if logs.true else None
    verdict = judge(told, last, delta_m) if logs.true else Verdict(False, None, None)
    estimated = distances(logs, delta_m)
    error = None if verdict.success else _fault(logs, verdict)
    named = "error" if error else _named(logs, verdict, estimated is not None)
    scored = verdict if named in ("success", "failure") else Verdict(False, None, None)
    claims = finished(logs)
    drones = of_drones(logs, delta_m)
    fleet = of_fleet(drones)
    whole = error is None and logs.end is not None and logs.end["reason"] == "cap"
    return {
        "outcome": named,
        "success": scored.success if logs.true and named != "censored" else None,
        "ne_m": scored.ne_m,
        "delta_m": delta_m,
        "censored": named in ("success", "censored") and not whole,
        "steps": max((d["step"] + 1 for d in logs.decisions), default=0),
        "declarations": sum(d["t_decided"] <= CAP_S for d in claims),
        "declarations_after_cap": sum(d["t_decided"] > CAP_S for d in claims),
        **asdict(measures(told, delta_m, whole=whole) if logs.true else NOTHING_KNOWN),
        "deciding": _deciding(scored.deciding),
        "error": error,
        "note": _note(scored, last),
        "diagnostics": asdict(fleet) if fleet else {},
        "drones": [
            {"drone": drone, **_declared(told, drone, delta_m), **asdict(each)} for drone, each in drones.items()
        ],
        **({} if logs.true else {"distances": estimated}),
    }


def succeeded(logs: Logs) -> bool:
    """Return whether a declaration already qualifies, whatever is still to come."""
    return logs.true and bool(judge(declarations(logs), None).success)


def _fault(logs: Logs, verdict: Verdict) -> str | None:
    """Return why what is no success is no failure either, None when it is one."""
    return reasons(verdict.unknown) or contradictions.ending(logs) or contradictions.gaps(logs)


def _named(logs: Logs, verdict: Verdict, estimated: bool) -> str:
    if not logs.true:
        return "distance only" if estimated else "unknown"
    if verdict.success:
        return "success"
    return "censored" if logs.end and logs.end["reason"] == "decided" else "failure"


def _note(verdict: Verdict, last: Measured | None) -> str | None:
    """Return what the verdict leaves open though it stands, a sentence."""
    if verdict.success and verdict.unknown:
        return f"deciding and ne_m are of the first declaration known to qualify: {reasons(verdict.unknown)}"
    if not verdict.success and last is not None and last.unknown and verdict.ne_m is None:
        return f"no declaration qualifies, and ne_m is not known: {last.unknown}"
    return None


def _deciding(declaration: Measured | None) -> dict[str, Any] | None:
    if declaration is None:
        return None
    step, drone, t, distance_m = declaration.step, declaration.drone, declaration.t, declaration.distance_m
    return {"step": step, "drone": drone, "t": t, "distance_m": distance_m}


def _declared(told: list[Measured], drone: int, delta_m: float) -> dict[str, int]:
    own = [d for d in told if d.drone == drone]
    return {"declarations": len(own), "qualifying": sum(d.qualifies(delta_m) is True for d in own)}


def judge_folder(
    folder: Path, delta_m: float = DELTA_M, reread: contradictions.Rereading | None = None
) -> dict[str, Any]:
    """Return `outcome` of an episode folder, and how it compares with what else stands there. Raises UsageError.

    `stored_agrees`: whether verdict.json says the same, None when there is none or it is of another radius, with
    `stored_differs`, the names of what differs, and `stored_older`, whether an older version stored it.
    `contradictions`: where the logs do not hold together, sentences; replies are read again by `reread`.
    """
    logs = read(folder)
    result = outcome(logs, delta_m)
    found = contradictions.of_logs(logs) + contradictions.of_folder(
        folder.resolve().name, json_object(folder / "episode.json")
    )
    return {
        **result,
        **_stored(folder / "verdict.json", result),
        "contradictions": found + (contradictions.of_replies(logs, reread) if reread else []),
    }


def _stored(path: Path, result: dict[str, Any]) -> dict[str, Any]:
    stored = json_object(path)
    if stored is None:
        damaged = path.exists()
        return {"stored_agrees": False if damaged else None, "stored_differs": [], "stored_older": False}
    if stored.get("delta_m") != result["delta_m"]:
        return {"stored_agrees": None, "stored_differs": [], "stored_older": False}
    found = compare(stored, result)
    return {"stored_agrees": not found.differing, "stored_differs": [*found.differing], "stored_older": found.older}


def judge_run(
    run: Path, delta_m: float = DELTA_M, reread: contradictions.Rereading | None = None
) -> dict[str, dict[str, Any]]:
    """Return `judge_folder` of every episode of a run folder (or of the one episode folder given), by episode id.

    One damaged episode is an error of its own and keeps no other from being judged. Raises UsageError.
    """
    if not math.isfinite(delta_m) or delta_m <= 0:
        raise UsageError(f"--delta wants a radius in metres above 0, got {delta_m:g}")
    if not run.is_dir():
        raise UsageError(f"there is no folder {run}")
    folders = [run] if (run / "decisions.jsonl").exists() else sorted(p.parent for p in run.glob("*/decisions.jsonl"))
    if not folders:
        raise UsageError(f"{run} holds no episode: a folder with decisions.jsonl and truth.jsonl is wanted")
    return {folder.resolve().name: _judged(folder, delta_m, reread) for folder in folders}


def _judged(folder: Path, delta_m: float, reread: contradictions.Rereading | None) -> dict[str, Any]:
    try:
        return judge_folder(folder, delta_m, reread)
    except UsageError as damage:
        result = _damaged(damage, delta_m)
        return {**result, **_stored(folder / "verdict.json", result), "contradictions": []}


def _damaged(damage: UsageError, delta_m: float) -> dict[str, Any]:
    return {**outcome(NOTHING, delta_m), **asdict(NOTHING_KNOWN), "error": str(damage)}


def write_verdict(folder: Path, delta_m: float = DELTA_M) -> dict[str, Any]:
    """Judge an episode folder, store verdict.json in it, and return the verdict; of damaged logs it is an error.

    Raises InfrastructureError when it cannot be stored.
    """
    result = verdict_of(folder, delta_m)
    path = folder / "verdict.json"
    try:
        write_json(path, result)
    except OSError as full:
        raise InfrastructureError(f"{path} cannot be written: {full.strerror}") from None
    return result


def verdict_of(folder: Path, delta_m: float = DELTA_M) -> dict[str, Any]:
    """Return `outcome` of an episode folder; of damaged logs it is an error."""
    try:
        return outcome(read(folder), delta_m)
    except UsageError as damage:
        return _damaged(damage, delta_m)
