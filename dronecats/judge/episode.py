"""The outcome of an episode folder: success, failure, or unscored (error, censored, unknown)."""

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from msgspec import UNSET

from dronecats.judge import contradictions
from dronecats.judge.commanding import commanding
from dronecats.judge.diagnostics import (
    contacts,
    distances,
    drone_diagnostics,
    estimator_resets,
    fleet_diagnostics,
    host_stalls,
    wide_rotations,
)
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

SAME = 1.001e-3  # s, m: numbers are rounded to a thousandth, and rounding may change the last digit
EXPLANATIONS = ("error", "note")  # sentences, whose words may differ between versions
CORE = (
    "outcome",
    "success",
    "ne_m",
    "delta_m",
    "steps",
    "declarations",
    "deciding",
)  # fields that every version stored


@dataclass(frozen=True, slots=True)
class Comparison:
    """A comparison of verdict.json with the verdict derived from the logs."""

    differing: tuple[str, ...]  # the names of what differs, as in "diagnostics.dwell_s"
    older: bool  # stored by an older version with fewer fields: only CORE is compared
    damaged: bool = False  # it is incomplete, or not a verdict

    @property
    def agrees(self) -> bool:
        """Whether nothing differs."""
        return not self.differing and not self.damaged


def compare(stored: Mapping[str, Any], derived: Mapping[str, Any]) -> Comparison:
    """Return the comparison of two verdicts at one radius, without fields that an older version did not store."""
    text = json.dumps(derived)
    if json.dumps(stored) == text:
        return Comparison((), older=False)
    now = json.loads(text)
    older = any(name not in stored for name in now)
    names = CORE if older else tuple(dict.fromkeys([*now, *stored]))
    return Comparison(tuple(d for name in names for d in _differing(name, stored.get(name), now.get(name))), older)


def _differing(name: str, a: Any, b: Any) -> Iterator[str]:
    if isinstance(a, dict) and isinstance(b, dict):
        for key in dict.fromkeys([*a, *b]):
            yield from _differing(f"{name}.{key}", a.get(key), b.get(key))
    elif isinstance(a, list) and isinstance(b, list) and len(a) == len(b):
        for k, (first, second) in enumerate(zip(a, b, strict=True)):
            yield from _differing(f"{name}[{k}]", first, second)
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
    """The verdict of an episode folder, compared with its other files."""

    verdict: Verdict
    stored: Comparison | None  # with verdict.json; None: there is none, or it has another radius
    contradictions: tuple[str, ...]  # in the logs, sentences

    @property
    def doubtful(self) -> bool:
        """Whether the stored verdict or the logs contradict each other."""
        return bool(self.contradictions or (self.stored and not self.stored.agrees))

    def as_json(self) -> dict[str, Any]:
        """Return the JSON object of `dronecats judge --json`."""
        stored = self.stored
        return {
            **self.verdict.as_json(),
            "stored_agrees": stored.agrees if stored else None,
            "stored_differs": [*stored.differing] if stored else [],
            "stored_older": bool(stored and stored.older),
            "contradictions": [*self.contradictions],
        }


def outcome(logs: Logs, delta_m: float = RADIUS_M, cap_s: float = CAP_S) -> Verdict:
    """Return the verdict of an episode's logs. Table of its keys: docs/run-folder.md.

    A qualifying declaration is a success, whatever the end of the flight. Without one, three cases are errors of the
    infrastructure and never a failure: the logger did not see an end at the cap or by decision, the logs contradict
    their end, or a declaration was not measured. A flight that was ended as decided at another radius, before `cap_s`,
    is censored. Without truth `success` is None: the outcome is unknown, or "distance only" with `distances`, if the
    autopilot's estimate and a surveyed target give the distance, but not whether the target was in view.
    """
    declared = declarations(logs, cap_s) if logs.true else []
    last = last_action(logs, cap_s) if logs.true else None
    verdict = judge(declared, last, delta_m, cap_s) if logs.true else Judgement(False, None, None)
    estimated = distances(logs, delta_m, cap_s)
    error = None if verdict.success else _fault(logs, verdict)
    seen = logs.end is not None and (logs.end.reason == "cap" or logs.end.t >= cap_s)
    named = "error" if error else _outcome_name(logs, verdict, seen, estimated is not None)
    scored = verdict if named in ("success", "failure") else Judgement(False, None, None)
    claims = finished(logs)
    drones = drone_diagnostics(logs, delta_m, cap_s)
    is_whole = error is None and seen
    resets = estimator_resets(logs, cap_s)
    return Verdict(
        outcome=named,
        success=scored.success if logs.true and named != "censored" else None,
        ne_m=scored.ne_m,
        delta_m=delta_m,
        censored=named in ("success", "censored") and not is_whole,
        steps=max((d.step + 1 for d in logs.decisions), default=0),
        declarations=sum(d.t_decided <= cap_s for d in claims),
        declarations_after_cap=sum(d.t_decided > cap_s for d in claims),
        **asdict(measures(declared, delta_m, cap_s, is_whole=is_whole) if logs.true else NOTHING_KNOWN),
        deciding=_deciding(scored.deciding),
        error=error,
        note=_note(scored, last),
        diagnostics=fleet_diagnostics(drones),
        drones=tuple(_of_drone(drone, diagnostics, declared, delta_m) for drone, diagnostics in drones.items()),
        distances=UNSET if logs.true else estimated,
        wide_rotations=wide_rotations(logs.decisions, cap_s) or UNSET,
        commanding=commanding(logs, cap_s) or UNSET,
        host_stalls=host_stalls(logs.decisions) or UNSET,
        cap_s=UNSET if cap_s == CAP_S else cap_s,
        contacts=contacts(logs, cap_s) or UNSET,
        estimator_resets=UNSET if resets is None else resets,
    )


def succeeded(logs: Logs) -> bool | None:
    """Return whether a declaration already qualifies; None while one is not measured."""
    return judge(declarations(logs), None).success if logs.true else False


def _fault(logs: Logs, verdict: Judgement) -> str | None:
    """Return the reason why the outcome is neither success nor failure; None: it is a failure."""
    return reasons(verdict.unknown) or contradictions.ending(logs) or contradictions.gaps(logs)


def _outcome_name(logs: Logs, verdict: Judgement, seen: bool, estimated: bool) -> Outcome:
    if not logs.true:
        return "distance only" if estimated else "unknown"
    if verdict.success:
        return "success"
    return "failure" if seen else "censored"


def _note(verdict: Judgement, last: Measured | None) -> str | None:
    """Return a sentence about an open part of the verdict; None: nothing is open."""
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


def _of_drone(drone: int, diagnostics: Diagnostics, declared: list[Measured], delta_m: float) -> DroneDiagnostics:
    own = [d for d in declared if d.drone == drone]
    qualifying = sum(d.qualifies(delta_m) is True for d in own)
    return DroneDiagnostics(drone=drone, declarations=len(own), qualifying=qualifying, **as_json(diagnostics))


def judge_folder(folder: Path, delta_m: float = RADIUS_M, reread: contradictions.Rereading | None = None) -> Judged:
    """Return the `outcome` of an episode folder, compared with its other files. Raises UsageError."""
    logs = read(folder)
    return beside_stored(folder, logs, json_object(folder / layout.EPISODE), outcome(logs, delta_m), reread)


def beside_stored(
    folder: Path,
    logs: Logs,
    record: Mapping[str, Any] | None,
    verdict: Verdict,
    reread: contradictions.Rereading | None = None,
) -> Judged:
    """Return the verdict of a folder's logs, compared with the other files; replies are parsed again by `reread`."""
    sentences = contradictions.log_contradictions(logs)
    sentences += contradictions.folder_contradictions(folder.resolve().name, record)
    sentences += contradictions.reply_contradictions(logs, reread) if reread else []
    sentences += _commander_contradictions(folder, logs)
    return Judged(verdict, _stored(folder / layout.VERDICT, verdict), tuple(sentences))


def _commander_contradictions(folder: Path, logs: Logs) -> list[str]:
    """Return the contradictions with commander.jsonl, which no verdict depends on."""
    try:
        return contradictions.commander_contradictions(logs, exchanges(folder))
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
    """Return `judge_folder` of every episode of a run folder, or of a single episode folder, by episode id.

    A damaged episode is an error, and the others are still judged. Raises UsageError.
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
    """Return the result of damaged logs: an error that describes the damage."""
    verdict = _damaged(damage, delta_m, cap_s)
    return Judged(verdict, _stored(folder / layout.VERDICT, verdict), ())


def _damaged(damage: UsageError, delta_m: float, cap_s: float = CAP_S) -> Verdict:
    return replace(outcome(NOTHING, delta_m, cap_s), **asdict(NOTHING_KNOWN), error=str(damage))


def check_radius(delta_m: float) -> None:
    """Raise UsageError for an invalid success radius."""
    if not math.isfinite(delta_m) or delta_m <= 0:
        raise UsageError(f"--delta wants a radius in metres above 0, got {delta_m:g}")


def write_verdict(folder: Path, delta_m: float = RADIUS_M) -> Verdict:
    """Judge an episode folder, store verdict.json in it, and return the verdict; damaged logs are an error.

    Raises InfrastructureError if it cannot be stored.
    """
    verdict = verdict_of(folder, delta_m)
    path = folder / layout.VERDICT
    try:
        write_json(path, verdict.as_json())
    except OSError as error:
        raise InfrastructureError(f"{path} cannot be written: {error.strerror}") from None
    return verdict


def verdict_of(folder: Path, delta_m: float = RADIUS_M) -> Verdict:
    """Return the `outcome` of an episode folder; damaged logs are an error."""
    try:
        return outcome(read(folder), delta_m)
    except UsageError as damage:
        return _damaged(damage, delta_m)
