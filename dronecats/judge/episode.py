"""Judges episode folders: derives the verdict, compares it with verdict.json, and finds contradictory files."""

import json
import math
from collections.abc import Iterator, Mapping, Sequence, Sized
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from msgspec import UNSET

from dronecats.agent.action import AxisOrder
from dronecats.agent.reply.reading import reading
from dronecats.judge.judged_flight import JudgedFlight, gaps, outcome
from dronecats.judge.verdict import NOTHING_KNOWN, SAME_S, consistent
from foundation.errors import InfrastructureError, UsageError
from foundation.files import file_errors_as, write_json
from foundation.protocol import CAP_S, RADIUS_M
from foundation.run_folder import layout
from foundation.run_folder.layout import COMMANDER, EPISODE
from foundation.run_folder.reading import Logs, exchanges, json_object, read
from foundation.run_folder.results import Verdict
from foundation.run_folder.rows import Exchange, drone_label

SAME = 1.001e-3  # s or m, tolerance: numbers are rounded to a thousandth, so the last digit may differ
EXPLANATIONS = ("error", "note")  # fields with a sentence; its words may differ between versions
# fields that every version stored
CORE = ("outcome", "success", "ne_m", "delta_m", "steps", "declarations", "deciding")


@dataclass(frozen=True, slots=True)
class Comparison:
    """A comparison of verdict.json with the verdict derived from the logs."""

    differing: tuple[str, ...]  # the names of the fields that differ, for example "diagnostics.dwell_s"
    older: bool  # stored by an older version with fewer fields: only CORE is compared
    damaged: bool = False  # verdict.json is incomplete, or not a verdict

    @property
    def agrees(self) -> bool:
        return not self.differing and not self.damaged


def compare(stored: Mapping[str, Any], derived: Mapping[str, Any]) -> Comparison:
    """Return the comparison of two verdicts at the same radius. If `stored` lacks a field, only CORE is compared."""
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


def contradictions(flight: JudgedFlight) -> tuple[str, ...]:
    """Return a sentence about each contradiction between the files of a flight."""
    sentences = log_contradictions(flight.logs)
    sentences += folder_contradictions(flight.folder.resolve().name, flight.record)
    sentences += reply_contradictions(flight.logs)
    try:
        sentences += commander_contradictions(flight.logs, exchanges(flight.folder))
    except UsageError as damage:
        sentences.append(str(damage))
    return tuple(sentences)


def compare_stored(folder: Path, verdict: Verdict) -> Comparison | None:
    """Return the comparison with verdict.json; None: no such file, or another radius or time limit."""
    path = folder / layout.VERDICT
    stored = json_object(path)
    if stored is None:
        return Comparison((), False, damaged=True) if path.exists() else None
    same = stored.get("delta_m") == verdict.delta_m and stored.get("cap_s", UNSET) == verdict.cap_s
    return compare(stored, verdict.as_json()) if same else None


def damaged_verdict(damage: UsageError, delta_m: float, cap_s: float = CAP_S) -> Verdict:
    """Return the verdict for damaged logs: an error that describes the damage."""
    return replace(outcome(NOTHING, delta_m, cap_s), **asdict(NOTHING_KNOWN), error=str(damage))


def check_radius(delta_m: float) -> None:
    """Raise UsageError for an invalid success radius."""
    if not math.isfinite(delta_m) or delta_m <= 0:
        raise UsageError(f"--delta must be a radius in metres above 0, got {delta_m:g}")


def write_verdict(folder: Path, delta_m: float = RADIUS_M) -> Verdict:
    """Judge an episode folder, store verdict.json in it, and return the verdict.

    Damaged logs have the outcome "error". Raises InfrastructureError if verdict.json cannot be stored.
    """
    verdict = verdict_of(folder, delta_m)
    path = folder / layout.VERDICT
    with file_errors_as(InfrastructureError, f"{path} cannot be written"):
        write_json(path, verdict.as_json())
    return verdict


def verdict_of(folder: Path, delta_m: float = RADIUS_M) -> Verdict:
    """Return the verdict of an episode folder; damaged logs have the outcome "error"."""
    try:
        return outcome(read(folder), delta_m)
    except UsageError as damage:
        return damaged_verdict(damage, delta_m)


def log_contradictions(logs: Logs) -> list[str]:
    """Return the contradictions within the logs, a sentence each."""
    sentences = [fault] if (fault := gaps(logs)) else []
    frames = logs.frames
    late = [d for d in logs.decisions if (f := frames.get((d.drone, d.frame_id))) and abs(f.t - d.t_frame) > SAME_S]
    if late:
        named_s, logged_s = late[0].t_frame, frames[late[0].drone, late[0].frame_id].t
        sentences.append(
            f"step {late[0].step} dates its frame at {named_s:g} s, but the logger at {logged_s:g} s{_more(late)}"
        )
    for kind, rows in (("pose", logs.poses), ("frame", frames.values())):
        off = [row for row in rows if not consistent(row)]
        if off:
            sentences.append(
                f"the {kind} of {drone_label(off[0].drone)} at {off[0].t:g} s has a distance to the target"
                f" that does not fit its positions{_more(off)}"
            )
    return sentences


def reply_contradictions(logs: Logs) -> list[str]:
    """Return one sentence about the decisions whose action differs from the logged reply; empty if there are none.

    A reply has one action for each drone of its group (`reply_groups`), in the order of the drones' numbers.
    """
    group = reply_groups(logs)
    replies = [(d, d.reply, group[d.drone]) for d in logs.decisions if d.reply is not UNSET]
    differing = [
        d
        for d, reply, drones in replies
        if not any(
            read[drones.index(d.drone)] == d.action for read in reread(reply, len(drones), d.mended is not UNSET)
        )
    ]
    if not differing:
        return []
    return [f"the reply of step {differing[0].step} gives another action than the logged one{_more(differing)}"]


def reread(reply: str, drones: int, mended: bool = False) -> Iterator[tuple[dict[str, Any] | None, ...]]:
    """Yield a reply's actions, one per drone, with the axis order xy, then yx: decisions.jsonl does not name the order.

    `mended`: parse leniently. For a reply without faults, this gives the same as strict parsing.
    """
    yield _read(reply, drones, "xy", mended)
    yield _read(reply, drones, "yx", mended)


@lru_cache(64)  # the drones of a fleet share a reply, so it is parsed once
def _read(reply: str, drones: int, order: AxisOrder, mended: bool) -> tuple[dict[str, Any] | None, ...]:
    read = reading(reply, drones, order, "lenient" if mended else "strict")
    return tuple(part.action.as_json() if part.action else None for part in read)


def reply_groups(logs: Logs) -> dict[int, list[int]]:
    """Return for each drone the sorted numbers of the drones that share its replies, itself included."""
    together: dict[int, set[int]] = {}  # by step
    for decision in logs.decisions:
        together.setdefault(decision.step, set()).add(decision.drone)
    group: dict[int, set[int]] = {}  # by drone, over all steps, because a killed flight may lack rows of a step
    for drones in together.values():
        for drone in drones:
            group.setdefault(drone, set()).update(drones)
    return {drone: sorted(drones) for drone, drones in group.items()}


def commander_contradictions(logs: Logs, exchanges: Sequence[Exchange]) -> list[str]:
    """Return one sentence about the declarations that commander.jsonl does not confirm; empty if there are none."""
    confirmed = {
        (exchange.number, drone, exchange.frames[drone])
        for exchange in exchanges
        for drone in exchange.confirms
        if drone < len(exchange.frames)
    }
    made = [d for d in logs.decisions if d.confirmed_by is not UNSET]
    unconfirmed = [d for d in made if (d.confirmed_by, d.drone, d.frame_id) not in confirmed]
    return [f"step {unconfirmed[0].step} was not confirmed in {COMMANDER}{_more(unconfirmed)}"] if unconfirmed else []


def folder_contradictions(name: str, record: Mapping[str, Any] | None) -> list[str]:
    """Return a sentence if the folder's name is not the id in the record."""
    identity = (record or {}).get("id", name)
    return [] if identity == name else [f"{EPISODE} has the id {identity}, but its folder is named {name}"]


def _more(rows: Sized) -> str:
    count = len(rows) - 1
    return f", and {count} more" if count else ""
