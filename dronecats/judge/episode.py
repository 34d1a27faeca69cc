"""The outcome of an episode folder: success, failure, or what is nobody's score: error, censored, unknown."""

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from msgspec import UNSET

from dronecats.judge import contradictions
from dronecats.judge.commanding import commanding
from dronecats.judge.diagnostics import of_drones, of_fleet, wide_rotations
from dronecats.judge.distances import distances
from dronecats.judge.incidents import contacts, estimator_resets, host_stalls
from dronecats.judge.verdict import (
    NOTHING_KNOWN,
    Judgement,
    Measured,
    declarations,
    finished,
    judge,
    last_action,
    measures,
    reasons,
)
from foundation.errors import InfrastructureError, UsageError
from foundation.files import write_json
from foundation.protocol import CAP_S, RADIUS_M
from foundation.run_folder import layout
from foundation.run_folder.reading import Logs, check_version, episodes, exchanges, json_object, read
from foundation.run_folder.results import Deciding, Diagnostics, DroneDiagnostics, Outcome, Verdict
from foundation.run_folder.writing import as_json

SAME = 1.001e-3  # seconds, metres: numbers are rounded to a thousandth, whose last digit a rounding may turn
EXPLANATIONS = ("error", "note")  # sentences, whose words may be others in another version
CORE = ("outcome", "success", "ne_m", "delta_m", "steps", "declarations", "deciding")  # what every version stored


@dataclass(frozen=True, slots=True)
class Comparison:
    """What verdict.json says beside what the logs say."""

    differing: tuple[str, ...]  # the names of what differs, as in "diagnostics.dwell_s"
    older: bool  # an older version stored it, which knew less: only CORE is compared
    damaged: bool = False  # it is half a file, or none of ours

    @property
    def agrees(self) -> bool:
        """Whether nothing differs."""
        return not self.differing and not self.damaged


def compare(stored: Mapping[str, Any], derived: Mapping[str, Any]) -> Comparison:
    """Return how two verdicts at one radius compare. What an older version did not store cannot differ."""
    told = json.dumps(derived)
    if json.dumps(stored) == told:
        return Comparison((), older=False)
    now = json.loads(told)
    older = any(name not in stored for name in now)
    names = CORE if older else tuple(dict.fromkeys([*now, *stored]))
    return Comparison(tuple(d for name in names for d in _differing(name, stored.get(name), now.get(name))), older)


def _differing(name: str, a: Any, b: Any) -> Iterator[str]:
    if isinstance(a, dict) and isinstance(b, dict):
        for key in dict.fromkeys([*a, *b]):
            yield from _differing(f"{name}.{key}", a.get(key), b.get(key))
    elif isinstance(a, list) and isinstance(b, list) and len(a) == len(b):
        for k, (one, other) in enumerate(zip(a, b, strict=True)):
            yield from _differing(f"{name}[{k}]", one, other)
    elif name in EXPLANATIONS:
        if (a is None) != (b is None):
            yield name
    elif _is_number(a) and _is_number(b):
        if not math.isclose(a, b, rel_tol=0.0, abs_tol=SAME):
            yield name
    elif type(a) is not type(b) or a != b:
        yield name


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


NOTHING = Logs((), {}, (), None, None)


@dataclass(frozen=True, slots=True)
class Judged:
    """The verdict of an episode folder beside what else stands there."""

    verdict: Verdict
    stored: Comparison | None  # with verdict.json; None: there is none, or it is of another radius
    contradictions: tuple[str, ...]  # where the logs do not hold together, sentences

    @property
    def doubtful(self) -> bool:
        """Whether something stored does not agree with the logs, or they with one another."""
        return bool(self.contradictions or (self.stored and not self.stored.agrees))

    def as_json(self) -> dict[str, Any]:
        """Return it as `dronecats judge --json` prints it."""
        stored = self.stored
        return {
            **self.verdict.as_json(),
            "stored_agrees": stored.agrees if stored else None,
            "stored_differs": [*stored.differing] if stored else [],
            "stored_older": bool(stored and stored.older),
            "contradictions": [*self.contradictions],
        }


def outcome(logs: Logs, delta_m: float = RADIUS_M, cap_s: float = CAP_S) -> Verdict:
    """Return the whole verdict of an episode's logs. Table of its keys: docs/run-folder.md.

    A qualifying declaration is a success however the flight ended. Without one, a flight that the logger did not see
    end at its cap or by decision, one whose logs contradict their own end, or one with an unmeasured declaration is an
    error of the infrastructure, never a failure; and a flight that was cut off as decided at another radius, before
    `cap_s`, is censored. Where nobody knew the truth `success` is None: the outcome is unknown, or "distance only" with
    `distances`, when the autopilot's own estimate and a surveyed target tell how near it came, though not whether the
    target was in view.
    """
    told = declarations(logs, cap_s) if logs.true else []
    last = last_action(logs, cap_s) if logs.true else None
    verdict = judge(told, last, delta_m, cap_s) if logs.true else Judgement(False, None, None)
    estimated = distances(logs, delta_m, cap_s)
    error = None if verdict.success else _fault(logs, verdict)
    seen = logs.end is not None and (logs.end.reason == "cap" or logs.end.t >= cap_s)
    named = "error" if error else _named(logs, verdict, seen, estimated is not None)
    scored = verdict if named in ("success", "failure") else Judgement(False, None, None)
    claims = finished(logs)
    drones = of_drones(logs, delta_m, cap_s)
    whole = error is None and seen
    resets = estimator_resets(logs, cap_s)
    return Verdict(
        outcome=named,
        success=scored.success if logs.true and named != "censored" else None,
        ne_m=scored.ne_m,
        delta_m=delta_m,
        censored=named in ("success", "censored") and not whole,
        steps=max((d.step + 1 for d in logs.decisions), default=0),
        declarations=sum(d.t_decided <= cap_s for d in claims),
        declarations_after_cap=sum(d.t_decided > cap_s for d in claims),
        **asdict(measures(told, delta_m, cap_s, whole=whole) if logs.true else NOTHING_KNOWN),
        deciding=_deciding(scored.deciding),
        error=error,
        note=_note(scored, last),
        diagnostics=of_fleet(drones),
        drones=tuple(_of_drone(drone, each, told, delta_m) for drone, each in drones.items()),
        distances=UNSET if logs.true else estimated,
        wide_rotations=wide_rotations(logs.decisions, cap_s) or UNSET,
        commanding=commanding(logs, cap_s) or UNSET,
        host_stalls=host_stalls(logs.decisions) or UNSET,
        cap_s=UNSET if cap_s == CAP_S else cap_s,
        contacts=contacts(logs, cap_s) or UNSET,
        estimator_resets=UNSET if resets is None else resets,
    )


def succeeded(logs: Logs) -> bool | None:
    """Return whether a declaration already qualifies, whatever is still to come; None while one is not measured."""
    return judge(declarations(logs), None).success if logs.true else False


def _fault(logs: Logs, verdict: Judgement) -> str | None:
    """Return why what is no success is no failure either, None when it is one."""
    return reasons(verdict.unknown) or contradictions.ending(logs) or contradictions.gaps(logs)


def _named(logs: Logs, verdict: Judgement, seen: bool, estimated: bool) -> Outcome:
    if not logs.true:
        return "distance only" if estimated else "unknown"
    if verdict.success:
        return "success"
    return "failure" if seen else "censored"


def _note(verdict: Judgement, last: Measured | None) -> str | None:
    """Return what the verdict leaves open though it stands, a sentence."""
    if verdict.success and verdict.unknown:
        return f"deciding and ne_m are of the first declaration known to qualify: {reasons(verdict.unknown)}"
    if not verdict.success and last is not None and last.unknown and verdict.ne_m is None:
        return f"no declaration qualifies, and ne_m is not known: {last.unknown}"
    return None


def _deciding(declaration: Measured | None) -> Deciding | None:
    if declaration is None:
        return None
    step, drone, t, distance_m = declaration.step, declaration.drone, declaration.t, declaration.distance_m
    return Deciding(step=step, drone=drone, t=t, distance_m=distance_m)


def _of_drone(drone: int, of_it: Diagnostics, told: list[Measured], delta_m: float) -> DroneDiagnostics:
    own = [d for d in told if d.drone == drone]
    qualifying = sum(d.qualifies(delta_m) is True for d in own)
    return DroneDiagnostics(drone=drone, declarations=len(own), qualifying=qualifying, **as_json(of_it))


def judge_folder(folder: Path, delta_m: float = RADIUS_M, reread: contradictions.Rereading | None = None) -> Judged:
    """Return `outcome` of an episode folder, and how it compares with what else stands there. Raises UsageError."""
    logs = read(folder)
    return beside_stored(folder, logs, json_object(folder / layout.EPISODE), outcome(logs, delta_m), reread)


def beside_stored(
    folder: Path,
    logs: Logs,
    record: Mapping[str, Any] | None,
    verdict: Verdict,
    reread: contradictions.Rereading | None = None,
) -> Judged:
    """Return the verdict of a folder's logs with how it compares with what else stands there.

    Replies are read again by `reread`.
    """
    found = contradictions.of_logs(logs)
    found += contradictions.of_folder(folder.resolve().name, record)
    found += contradictions.of_replies(logs, reread) if reread else []
    found += _of_commander(folder, logs)
    return Judged(verdict, _stored(folder / layout.VERDICT, verdict), tuple(found))


def _of_commander(folder: Path, logs: Logs) -> list[str]:
    """Return what is wrong with commander.jsonl, which no verdict goes by."""
    try:
        return contradictions.of_commander(logs, exchanges(folder))
    except UsageError as damage:
        return [str(damage)]


def _stored(path: Path, verdict: Verdict) -> Comparison | None:
    stored = json_object(path)
    if stored is None:
        return Comparison((), False, damaged=True) if path.exists() else None
    same = stored.get("delta_m") == verdict.delta_m and stored.get("cap_s", UNSET) == verdict.cap_s
    return compare(stored, verdict.as_json()) if same else None


def judge_run(
    run: Path, delta_m: float = RADIUS_M, reread: contradictions.Rereading | None = None
) -> dict[str, Judged]:
    """Return `judge_folder` of every episode of a run folder (or of the one episode folder given), by episode id.

    One damaged episode is an error of its own and keeps no other from being judged. Raises UsageError.
    """
    check_radius(delta_m)
    if not run.is_dir():
        raise UsageError(f"there is no folder {run}")
    folders = episodes(run)
    if not folders:
        raise UsageError(f"{run} holds no episode: a folder with {layout.DECISIONS} and {layout.TRUTH} is wanted")
    check_version(folders[0].resolve().parent)
    return {folder.resolve().name: _judged(folder, delta_m, reread) for folder in folders}


def _judged(folder: Path, delta_m: float, reread: contradictions.Rereading | None) -> Judged:
    try:
        return judge_folder(folder, delta_m, reread)
    except UsageError as damage:
        return judged_damage(folder, damage, delta_m)


def judged_damage(folder: Path, damage: UsageError, delta_m: float, cap_s: float = CAP_S) -> Judged:
    """Return what damaged logs come to: an error that says what is damaged."""
    verdict = _damaged(damage, delta_m, cap_s)
    return Judged(verdict, _stored(folder / layout.VERDICT, verdict), ())


def _damaged(damage: UsageError, delta_m: float, cap_s: float = CAP_S) -> Verdict:
    return replace(outcome(NOTHING, delta_m, cap_s), **asdict(NOTHING_KNOWN), error=str(damage))


def check_radius(delta_m: float) -> None:
    """Raise UsageError for what is no success radius."""
    if not math.isfinite(delta_m) or delta_m <= 0:
        raise UsageError(f"--delta wants a radius in metres above 0, got {delta_m:g}")


def write_verdict(folder: Path, delta_m: float = RADIUS_M) -> Verdict:
    """Judge an episode folder, store verdict.json in it, and return the verdict; of damaged logs it is an error.

    Raises InfrastructureError when it cannot be stored.
    """
    verdict = verdict_of(folder, delta_m)
    path = folder / layout.VERDICT
    try:
        write_json(path, verdict.as_json())
    except OSError as full:
        raise InfrastructureError(f"{path} cannot be written: {full.strerror}") from None
    return verdict


def verdict_of(folder: Path, delta_m: float = RADIUS_M) -> Verdict:
    """Return `outcome` of an episode folder; of damaged logs it is an error."""
    try:
        return outcome(read(folder), delta_m)
    except UsageError as damage:
        return _damaged(damage, delta_m)
