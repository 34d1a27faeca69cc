"""How much the verdict hangs on its rule: the alternatives that the paper's replaced, and what each would turn.

Paper, appendix "Verifier Audit". Beside it, what the strict reading would leave of a lenient run, though the flight
itself would have been another. A reply that had to be mended is read again to the letter of the prompt. Where that
gives no action, or another one, the step changes; the verdict is derived again with the actions that are left.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from msgspec import UNSET

from dronecats.judge.contradictions import asked_together
from dronecats.judge.diagnostics import hold
from dronecats.judge.episode import outcome
from dronecats.judge.judged_flight import JudgedFlight
from dronecats.judge.metrics.deliberation import Deliberation, StepOutlook, deliberation, outlooks
from dronecats.judge.metrics.judging import reread
from dronecats.judge.metrics.outcomes import oracle_success, success_at_first
from dronecats.judge.verdict import declarations, judge
from foundation.errors import UsageError
from foundation.protocol import CAP_S, RADIUS_M
from foundation.run_folder.rows import Decision

HELD_S = 10.0  # s
MOVING = ("tracking", "search-and-track")  # the cells that were once graded by a dwell
Rule = Callable[[JudgedFlight], bool | None]  # whether it would be a success; None: not known, or not meant for it


def last_alone(flight: JudgedFlight) -> bool | None:
    """Return whether the last declaration qualifies; None where the flight was cut off before it could be made."""
    if flight.verdict.censored:
        return None
    return flight.declarations[-1].qualifies(flight.delta_m) if flight.declarations else False


def ten_seconds(flight: JudgedFlight) -> bool | None:
    """Return whether a drone was within the radius with the target in view for ten unbroken seconds, declared or not.

    None of the cells whose target stands, and where the flight was cut off before it could be.
    """
    held_s = hold(flight.logs, flight.delta_m, flight.cap_s) if flight.cell in MOVING else None
    if held_s is None:
        return None
    return True if held_s >= HELD_S else None if flight.verdict.censored else False


def without_cap(flight: JudgedFlight) -> bool | None:
    """Return whether any declaration qualifies, however late."""
    return judge(declarations(flight.logs, float("inf")), None, flight.delta_m, float("inf")).success


RULES: Mapping[str, tuple[str, Rule]] = {
    "first": ("the first declaration alone", success_at_first),
    "last": ("the last declaration alone", last_alone),
    "dwell": ("ten unbroken seconds within the radius in view (moving targets)", ten_seconds),
    "proximity": ("any entry into the radius", oracle_success),
    "no_cap": ("declarations after the cap, too", without_cap),
}


@dataclass(frozen=True, slots=True)
class Strictness:
    """One episode, its decisions within the cap."""

    steps: int  # decisions
    mended: int  # of these, those whose reply was mended
    changed: int  # of these, those that the strict reading takes as none or as another action
    declarations: int  # of these, declarations
    success: bool | None  # under strict reading; None: nobody's score


@dataclass(frozen=True, slots=True)
class EpisodeAudit:
    """One episode under every rule."""

    success: bool | None  # as the criterion has it; None: nobody's score
    rules: Mapping[str, bool | None]  # by the names of RULES
    declarations: int  # within the cap
    false_declarations: int  # of these, those that are known not to qualify
    late: int  # declarations after the cap
    strict: Strictness
    steps: tuple[StepOutlook, ...]


@dataclass(frozen=True, slots=True)
class Flips:
    """What a rule would turn."""

    told: int  # scored episodes of which it can tell
    successes: int  # of these, by the criterion
    lost: int  # of the successes, those that it would make failures
    gained: int  # of the failures, those that it would make successes


@dataclass(frozen=True, slots=True)
class Audit:
    """Many episodes."""

    episodes: int
    scored: int
    successes: int
    declarations: int
    false_declarations: int
    late_declarations: int
    late_episodes: int  # that have some
    silent_failures: int  # failures without a declaration
    silent_entered: int  # of these, those that entered the radius
    flips: Mapping[str, Flips]  # by the names of RULES
    think: Deliberation
    steps: int  # decisions
    mended: int  # of these, those whose reply was mended
    changed: int  # of these, those that strict parsing takes otherwise
    strict: Flips  # strict parsing of what was mended


def audited_episode(folder: Path, delta_m: float = RADIUS_M, cap_s: float = CAP_S) -> EpisodeAudit | None:
    """Return one episode folder under every rule; None of damaged logs."""
    try:
        return audit_of(JudgedFlight.read(folder, delta_m, cap_s))
    except UsageError:
        return None


def audit_of(flight: JudgedFlight) -> EpisodeAudit:
    """Return one episode under every rule."""
    return EpisodeAudit(
        success=flight.verdict.success if flight.scored else None,
        rules={name: rule(flight) if flight.scored else None for name, (_, rule) in RULES.items()},
        declarations=len(flight.declarations),
        false_declarations=sum(d.qualifies(flight.delta_m) is False for d in flight.declarations),
        late=flight.verdict.declarations_after_cap,
        strict=strictness(flight),
        steps=tuple(outlooks(flight)) if flight.scored else (),
    )


def audit(episodes: Iterable[EpisodeAudit | None]) -> Audit:
    """Return these episodes together; None stands for one that is damaged."""
    all_told = list(episodes)
    told = [each for each in all_told if each is not None]
    scored = [each for each in told if each.success is not None]
    silent = [each for each in scored if not each.success and each.declarations == 0]
    return Audit(
        episodes=len(all_told),
        scored=len(scored),
        successes=sum(each.success is True for each in scored),
        declarations=sum(each.declarations for each in scored),
        false_declarations=sum(each.false_declarations for each in scored),
        late_declarations=sum(each.late for each in scored),
        late_episodes=sum(each.late > 0 for each in scored),
        silent_failures=len(silent),
        silent_entered=sum(each.rules["proximity"] is True for each in silent),
        flips={name: flips((each.success, each.rules[name]) for each in scored) for name in RULES},
        think=deliberation(step for each in scored for step in each.steps),
        steps=sum(each.strict.steps for each in scored),
        mended=sum(each.strict.mended for each in scored),
        changed=sum(each.strict.changed for each in scored),
        strict=flips((each.success, each.strict.success) for each in scored),
    )


def flips(pairs: Iterable[tuple[bool | None, bool | None]]) -> Flips:
    """Return what a rule turns, of (success by the criterion, success by the rule)."""
    told = [(was, would) for was, would in pairs if was is not None and would is not None]
    return Flips(
        told=len(told),
        successes=sum(was for was, _ in told),
        lost=sum(was and not would for was, would in told),
        gained=sum(would and not was for was, would in told),
    )


def strictness(flight: JudgedFlight) -> Strictness:
    """Return what the strict reading leaves of an episode."""
    group = asked_together(flight.logs)
    counted = [d for d in flight.logs.decisions if d.t_decided <= flight.cap_s]
    mended = [d for d in counted if d.mended is not UNSET]
    read = {(d.step, d.drone): strictly(d, group[d.drone]) for d in mended}
    changed = [d for d in mended if read[d.step, d.drone] != d.action]
    success = flight.verdict.success
    if any(d.declares for d in changed):
        left = tuple(
            replace(d, action=read[d.step, d.drone]) if (d.step, d.drone) in read else d for d in flight.logs.decisions
        )
        success = outcome(replace(flight.logs, decisions=left), flight.delta_m, flight.cap_s).success
    return Strictness(
        steps=len(counted),
        mended=len(mended),
        changed=len(changed),
        declarations=sum(d.declares for d in changed),
        success=success if flight.scored else None,
    )


def strictly(decision: Decision, drones: list[int]) -> dict[str, Any] | None:
    """Return the action of a decision's reply under the strict reading; its own where that is one of the two ways.

    `drones`: those that the reply is for.
    """
    if decision.reply is UNSET:
        return decision.action
    ways = [read[drones.index(decision.drone)] for read in reread(decision.reply, len(drones))]
    return decision.action if decision.action in ways else ways[0]
