"""Audits a run: alternative success rules, strict parsing of replies, and the effect of the action `think`.

Source: paper, appendices "Verifier Audit" and "Test-Time Deliberation". A mended reply is one that the lenient parser
repaired. Strict parsing accepts only the format of the prompt. If strict parsing removes or changes a declaration, the
verdict is derived again from the changed log. A real flight would have continued differently. The comparisons of
`think` do not prove an effect, because a pilot thinks when it is in trouble. The paper does not define the compared
steps. This module uses the three steps before a step and the three steps after it.
"""

import math
import statistics
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from msgspec import UNSET

from dronecats.judge.diagnostics import hold_s
from dronecats.judge.episode import reply_groups, reread
from dronecats.judge.judged_flight import FlightStep, JudgedFlight, outcome
from dronecats.judge.metrics.outcomes import oracle_success, success_at_first
from dronecats.judge.verdict import declarations, judge
from foundation.errors import UsageError
from foundation.protocol import CAP_S, RADIUS_M, THINK
from foundation.run_folder.results import SCORED
from foundation.run_folder.rows import Decision

AFTER = 3  # number of compared steps before a step, and after it
MATCHED_M = 0.25  # m per step, width of an interval of closing rates; a think matches ordinary steps in its interval
# m closed in three steps. Less than STALL_M before a step is a stall. BROKEN_M or more after the step ends the stall.
STALL_M, BROKEN_M = 0.5, 1.0


@dataclass(frozen=True, slots=True)
class StepOutlook:
    """One step of one drone with the motion around it. A field is None if steps are missing or the truth is unknown.

    Closed metres are the metres by which the distance to the target became smaller.
    """

    think: bool
    closing_m: float | None  # m closed from the previous step's frame to this step's frame
    gained_m: float | None  # m closed per step, mean over the three steps after this one
    stalled: bool | None  # less than 0.5 m was closed in the three steps before this one
    broken: bool | None  # 1 m or more was closed in the three steps after this one
    lost: bool | None  # the target was not in view
    regained: bool | None  # the target was in view at a frame of the three steps after this one


@dataclass(frozen=True, slots=True)
class Followed:
    """How often an event followed: after `think` of `of_thinks` think steps, and `other` of `of_others` other steps."""

    think: int
    of_thinks: int
    other: int
    of_others: int


@dataclass(frozen=True, slots=True)
class Deliberation:
    """Three comparisons of `think` steps with ordinary steps."""

    thinks: int  # steps that think
    matched: int  # think steps for which there are ordinary steps in the same interval of closing rates
    gain_m_per_step: float | None  # mean closing rate after thinks minus the mean after their matches; None: no matches
    stalls: Followed  # counts over stalled steps; the event: the stall was broken within three steps
    losses: Followed  # counts over steps without the target in view; the event: in view again within three steps


def step_outlooks(flight: JudgedFlight) -> list[StepOutlook]:
    """Return the outlook of every step within the cap, drone by drone."""
    drones: dict[int, list[FlightStep]] = {}
    for step in flight.steps:
        if step.counts:
            drones.setdefault(step.decision.drone, []).append(step)
    return [outlook for _, steps in sorted(drones.items()) for outlook in _of_drone(steps)]


def deliberation(steps: Iterable[StepOutlook]) -> Deliberation:
    all_steps = list(steps)
    gains_by_rate: dict[int, list[float]] = {}  # gains of ordinary steps, by interval of closing rate
    for step in all_steps:
        if not step.think and step.closing_m is not None and step.gained_m is not None:
            gains_by_rate.setdefault(_interval(step.closing_m), []).append(step.gained_m)
    means = {rate: statistics.fmean(gained) for rate, gained in gains_by_rate.items()}
    gains = [
        step.gained_m - means[_interval(step.closing_m)]
        for step in all_steps
        if step.think and step.closing_m is not None and step.gained_m is not None
        if _interval(step.closing_m) in means
    ]
    return Deliberation(
        thinks=sum(step.think for step in all_steps),
        matched=len(gains),
        gain_m_per_step=statistics.fmean(gains) if gains else None,
        stalls=_followed([(step.think, step.broken) for step in all_steps if step.stalled]),
        losses=_followed([(step.think, step.regained) for step in all_steps if step.lost]),
    )


def _of_drone(steps: Sequence[FlightStep]) -> list[StepOutlook]:
    away = [step.truth.distance_m if step.truth else None for step in steps]
    seen = [step.truth.visible if step.truth else None for step in steps]
    return [
        StepOutlook(
            think=step.decision.kind == THINK,
            closing_m=_closed(away, k - 1, k),
            gained_m=None if (gained := _closed(away, k + 1, k + 1 + AFTER)) is None else gained / AFTER,
            stalled=None if (before := _closed(away, k - AFTER, k)) is None else before < STALL_M,
            broken=None if gained is None else gained >= BROKEN_M,
            lost=None if seen[k] is None else not seen[k],
            regained=_regained(seen[k + 1 : k + 1 + AFTER]),
        )
        for k, step in enumerate(steps)
    ]


def _closed(away: Sequence[float | None], first: int, last: int) -> float | None:
    """Return the metres by which the distance became smaller between two frames (indices of `away`)."""
    if first < 0 or last >= len(away):
        return None
    begin, end = away[first], away[last]
    return None if begin is None or end is None else begin - end


def _regained(seen: Sequence[bool | None]) -> bool | None:
    """Return whether the target is seen at one of the next frames; None if too few frames follow."""
    if any(seen):
        return True
    return False if len(seen) == AFTER and None not in seen else None


def _interval(closing_m: float) -> int:
    return math.floor(closing_m / MATCHED_M)


def _followed(pairs: Sequence[tuple[bool, bool | None]]) -> Followed:
    known_pairs = [(think, followed) for think, followed in pairs if followed is not None]
    return Followed(
        think=sum(followed for think, followed in known_pairs if think),
        of_thinks=sum(think for think, _ in known_pairs),
        other=sum(followed for think, followed in known_pairs if not think),
        of_others=sum(not think for think, _ in known_pairs),
    )


HELD_S = 10.0  # s, for the rule `ten_seconds`
MOVING = ("tracking", "search-and-track")  # cells (kinds of episode) with moving targets
Rule = Callable[[JudgedFlight], bool | None]  # success under the rule; None: unknown, or not applicable


def last_declaration(flight: JudgedFlight) -> bool | None:
    """Return whether the last declaration qualifies; None if this is unknown, as for a censored flight."""
    if flight.verdict.censored:
        return None
    return flight.declarations[-1].qualifies(flight.delta_m) if flight.declarations else False


def ten_seconds(flight: JudgedFlight) -> bool | None:
    """Return whether a drone was within the radius with the target in view for ten unbroken seconds.

    Declarations have no effect. None: the target is static, nothing was measured, or the flight is censored and has no
    such ten seconds.
    """
    held_s = hold_s(flight.logs, flight.delta_m, flight.cap_s) if flight.cell in MOVING else None
    if held_s is None:
        return None
    return True if held_s >= HELD_S else None if flight.verdict.censored else False


def without_cap(flight: JudgedFlight) -> bool | None:
    """Return whether any declaration qualifies, even after the cap; None if this is unknown."""
    return judge(declarations(flight.logs, float("inf")), None, flight.delta_m, float("inf")).success


RULES: Mapping[str, tuple[str, Rule]] = {
    "first": ("the first declaration qualifies", success_at_first),
    "last": ("the last declaration qualifies", last_declaration),
    "dwell": (
        "the target is in view within the radius for ten seconds without a break (moving targets only)",
        ten_seconds,
    ),
    "proximity": ("the drone enters the radius at some time", oracle_success),
    "no_cap": ("a declaration qualifies, before or after the cap", without_cap),
}


@dataclass(frozen=True, slots=True)
class Strictness:
    """The effect of strict parsing on one episode, for its decisions within the cap."""

    steps: int  # number of decisions
    mended: int  # decisions whose reply was mended
    changed: int  # mended decisions whose action strict parsing removes or changes
    success: bool | None  # under strict parsing; None: not scored, or unknown


@dataclass(frozen=True, slots=True)
class EpisodeAudit:
    """The audit of one episode: its outcome under every rule."""

    success: bool | None  # by the benchmark's criterion; None: not scored
    rules: Mapping[str, bool | None]  # name in RULES → success by that rule
    declarations: int  # declarations within the cap
    false_declarations: int  # declarations that are known not to qualify
    late: int  # declarations after the cap
    strict: Strictness
    steps: tuple[StepOutlook, ...]


@dataclass(frozen=True, slots=True)
class Flips:
    """The outcomes that a rule would change."""

    decided: int  # scored episodes whose outcome by the rule is known
    successes: int  # decided episodes that succeeded by the criterion
    lost: int  # successes that the rule makes failures
    gained: int  # failures that the rule makes successes


@dataclass(frozen=True, slots=True)
class Audit:
    episodes: int
    scored: int
    successes: int
    declarations: int
    false_declarations: int
    late_declarations: int
    late_episodes: int  # episodes with late declarations
    silent_failures: int  # failures without a declaration
    silent_entered: int  # silent failures that entered the radius
    flips: Mapping[str, Flips]  # name in RULES → outcomes that the rule would change
    think: Deliberation
    steps: int  # number of decisions
    mended: int  # decisions whose reply was mended
    changed: int  # mended decisions that strict parsing changes
    strict: Flips  # outcomes that strict parsing changes


def audited_episode(folder: Path, delta_m: float = RADIUS_M, cap_s: float = CAP_S) -> EpisodeAudit | None:
    """Return the audit of one episode folder; None for damaged logs."""
    try:
        return audit_of(JudgedFlight.read(folder, delta_m, cap_s))
    except UsageError:
        return None


def audit_of(flight: JudgedFlight) -> EpisodeAudit:
    return EpisodeAudit(
        success=flight.success,
        rules={name: rule(flight) if flight.scored else None for name, (_, rule) in RULES.items()},
        declarations=len(flight.declarations),
        false_declarations=sum(d.qualifies(flight.delta_m) is False for d in flight.declarations),
        late=flight.verdict.declarations_after_cap,
        strict=strictness(flight),
        steps=tuple(step_outlooks(flight)) if flight.scored else (),
    )


def audit(episodes: Iterable[EpisodeAudit | None]) -> Audit:
    """Return the audit of several episodes; None stands for damaged logs."""
    all_episodes = list(episodes)
    readable = [episode for episode in all_episodes if episode is not None]
    scored = [episode for episode in readable if episode.success is not None]
    silent = [episode for episode in scored if not episode.success and episode.declarations == 0]
    return Audit(
        episodes=len(all_episodes),
        scored=len(scored),
        successes=sum(episode.success is True for episode in scored),
        declarations=sum(episode.declarations for episode in scored),
        false_declarations=sum(episode.false_declarations for episode in scored),
        late_declarations=sum(episode.late for episode in scored),
        late_episodes=sum(episode.late > 0 for episode in scored),
        silent_failures=len(silent),
        silent_entered=sum(episode.rules["proximity"] is True for episode in silent),
        flips={name: flips((episode.success, episode.rules[name]) for episode in scored) for name in RULES},
        think=deliberation(step for episode in scored for step in episode.steps),
        steps=sum(episode.strict.steps for episode in scored),
        mended=sum(episode.strict.mended for episode in scored),
        changed=sum(episode.strict.changed for episode in scored),
        strict=flips((episode.success, episode.strict.success) for episode in scored),
    )


def flips(pairs: Iterable[tuple[bool | None, bool | None]]) -> Flips:
    """Count the outcomes that a rule changes. `pairs`: (success by the criterion, success by the rule)."""
    decided = [(was, would) for was, would in pairs if was is not None and would is not None]
    return Flips(
        decided=len(decided),
        successes=sum(was for was, _ in decided),
        lost=sum(was and not would for was, would in decided),
        gained=sum(would and not was for was, would in decided),
    )


def strictness(flight: JudgedFlight) -> Strictness:
    group = reply_groups(flight.logs)
    counted = [d for d in flight.logs.decisions if d.t_decided <= flight.cap_s]
    mended = [d for d in counted if d.mended is not UNSET]
    read = {(d.step, d.drone): strictly(d, group[d.drone]) for d in mended}
    changed = [d for d in mended if read[d.step, d.drone] != d.action]
    success = flight.success
    if any(d.declares for d in changed):
        left = tuple(
            replace(d, action=read[d.step, d.drone]) if (d.step, d.drone) in read else d for d in flight.logs.decisions
        )
        strict = outcome(replace(flight.logs, decisions=left), flight.delta_m, flight.cap_s)
        # None if the flight ended at a declaration that strict parsing removes: the rest is unknown
        success = strict.success if strict.outcome in SCORED else None
    return Strictness(steps=len(counted), mended=len(mended), changed=len(changed), success=success)


def strictly(decision: Decision, drones: list[int]) -> dict[str, Any] | None:
    """Return the action of a decision under strict parsing of its reply.

    The log does not name the axis order. If one order (xy or yx) gives the logged action, the result is that action;
    else it is the action in the order xy. If the reply was not logged, the result is the logged action. `drones`: the
    drones of the reply.
    """
    if decision.reply is UNSET:
        return decision.action
    ways = [read[drones.index(decision.drone)] for read in reread(decision.reply, len(drones))]
    return decision.action if decision.action in ways else ways[0]
