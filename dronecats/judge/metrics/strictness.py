"""What the strict reading would leave of a lenient run. The flight itself would have been another.

A reply that had to be mended is read again to the letter of the prompt. Where that gives no action, or another one, the
step changes; the verdict is derived again with the actions that are left.
"""

from dataclasses import dataclass, replace
from typing import Any

from msgspec import UNSET

from dronecats.judge.contradictions import asked_together
from dronecats.judge.episode import outcome
from dronecats.judge.judged_flight import JudgedFlight
from dronecats.judge.metrics.judging import reread
from foundation.run_folder.rows import Decision


@dataclass(frozen=True, slots=True)
class Strictness:
    """One episode, its decisions within the cap."""

    steps: int  # decisions
    mended: int  # of these, those whose reply was mended
    changed: int  # of these, those that the strict reading takes as none or as another action
    declarations: int  # of these, declarations
    success: bool | None  # under strict reading; None: nobody's score


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
