"""Contradictions in the logs of an episode: with each other, within a log, and with the folder's name."""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence, Sized
from itertools import pairwise
from typing import Any

from msgspec import UNSET

from dronecats.judge.verdict import SAME_S, consistent, declarations
from foundation.protocol import CAP_S, RADIUS_M
from foundation.run_folder.layout import COMMANDER, DECISIONS, EPISODE
from foundation.run_folder.reading import Logs
from foundation.run_folder.rows import Decision, Exchange, FrameTruth, Pose, drone_label

# s before its cap at which a flight may end by it: the logger's clock is the newest truth it received, which is late by
# no more than the stall of a process on a busy machine
LATE_S = 5.0

# (reply, drones, whether it was mended) -> possible readings, each with an action per drone
Rereading = Callable[[str, int, bool], Iterable[Sequence[Any]]]


def ending(logs: Logs) -> str | None:
    """Return the reason why the log does not end with the end of an episode; None if it does.

    The episode must have begun, something must be measured, and the logger must have seen the end: at the cap, with
    decisions, or as decided, by a declaration that qualifies at the radius at which flights are watched.
    """
    if logs.begin is None:
        return "the episode never began"
    if logs.end is None:
        return "the log breaks off: the logger did not see the episode end"
    rows: list[Pose | FrameTruth] = [*logs.poses, *logs.frames.values()]
    if logs.true and not any(row.distance_m is not None for row in rows):
        return "the logger measured nothing"
    reason, ended_s = logs.end.reason, logs.end.t
    if reason == "decided":
        good = any(d.qualifies(RADIUS_M) for d in declarations(logs))
        return None if good else f"the flight was ended as decided, and no declaration in {DECISIONS} decides it"
    if reason != "cap":
        return logs.end.error or reason
    cap_s = logs.begin.cap_s or (CAP_S if logs.true else 0.0)  # an older log: an episode lasts CAP_S
    if ended_s < cap_s - LATE_S:
        return f"the log says that the flight ended at its cap of {cap_s:g} s, and ends at {ended_s:g} s"
    if not logs.decisions:
        return f"the flight was flown to its cap, and {DECISIONS} is empty"
    return None


def gaps(logs: Logs) -> str | None:
    """Return the fault in the step numbers: a step is missing, or a drone has one twice; None: no fault."""
    taken = Counter((d.step, d.drone) for d in logs.decisions)
    twice = next((key for key, count in sorted(taken.items()) if count > 1), None)
    if twice:
        return f"{DECISIONS} holds step {twice[0]} of {drone_label(twice[1])} more than once"
    steps = sorted({-1} | {step for step, _ in taken})
    missing = next((a + 1 for a, b in pairwise(steps) if b > a + 1), None)
    return None if missing is None else f"{DECISIONS} lacks step {missing}"


def log_contradictions(logs: Logs) -> list[str]:
    """Return the contradictions within the logs, a sentence each."""
    sentences = [fault] if (fault := gaps(logs)) else []
    late = [d for d in logs.decisions if (f := _frame(d, logs)) and abs(f.t - d.t_frame) > SAME_S]
    if late:
        named_s, logged_s = late[0].t_frame, logs.frames[late[0].drone, late[0].frame_id].t
        sentences.append(
            f"step {late[0].step} names a frame of {named_s:g} s that was taken at {logged_s:g} s{_more(late)}"
        )
    for kind, rows in (("pose", logs.poses), ("frame", logs.frames.values())):
        off = [row for row in rows if not consistent(row)]
        if off:
            sentences.append(
                f"the {kind} of {drone_label(off[0].drone)} at {off[0].t:g} s is not as far from the target as its"
                f" positions are{_more(off)}"
            )
    return sentences


def reply_contradictions(logs: Logs, reread: Rereading) -> list[str]:
    """Return the decisions whose action differs from their reply, in one sentence.

    A reply is for all drones of its steps, in the order of their numbers.
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
    return [f"the reply of step {differing[0].step} does not say the action that was taken{_more(differing)}"]


def reply_groups(logs: Logs) -> dict[int, list[int]]:
    """Return for each drone the drones of its replies, itself included, in the order of their numbers."""
    together: dict[int, set[int]] = {}  # by step
    for decision in logs.decisions:
        together.setdefault(decision.step, set()).add(decision.drone)
    group: dict[int, set[int]] = {}  # by drone: a kill may cost a step some of its rows, but not every step
    for drones in together.values():
        for drone in drones:
            group.setdefault(drone, set()).update(drones)
    return {drone: sorted(drones) for drone, drones in group.items()}


def commander_contradictions(logs: Logs, exchanges: Sequence[Exchange]) -> list[str]:
    """Return the declarations by a commander that its log does not confirm, in one sentence."""
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
    """Return a sentence if the folder's name is not the id of its episode."""
    identity = (record or {}).get("id", name)
    return [] if identity == name else [f"{EPISODE} is of {identity}, and its folder is named {name}"]


def _frame(decision: Decision, logs: Logs) -> FrameTruth | None:
    return logs.frames.get((decision.drone, decision.frame_id))


def _more(rows: Sized) -> str:
    count = len(rows) - 1
    return f", and {count} more" if count else ""
