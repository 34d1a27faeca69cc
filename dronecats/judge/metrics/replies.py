"""How many replies were no actions, and why: refused, or cut off at their longest."""

from collections.abc import Callable

from dronecats.judge.judged_flight import JudgedFlight
from dronecats.judge.metrics.metric import Metric
from foundation.run_folder.rows import Decision

REFUSED = ("refusal", "filtered")  # words of `Decision.finish`
CUT_OFF = ("length",)


def is_unreadable(decision: Decision) -> bool:
    """Return whether its reply holds no action for its drone."""
    return decision.action is None


def is_refused(decision: Decision) -> bool:
    """Return whether there is no action because the model refused, or its provider withheld the reply."""
    return is_unreadable(decision) and decision.finish in REFUSED


def is_cut_off(decision: Decision) -> bool:
    """Return whether there is no action, and the reply ended at its longest."""
    return is_unreadable(decision) and decision.finish in CUT_OFF


def decisions(flight: JudgedFlight) -> int:
    """Return how many decisions were made within the cap, of each drone."""
    return _count(flight, lambda decision: True)


def unreadable(flight: JudgedFlight) -> int:
    """Return how many of `decisions` are unreadable."""
    return _count(flight, is_unreadable)


def refused(flight: JudgedFlight) -> int:
    """Return how many of `decisions` are refused."""
    return _count(flight, is_refused)


def cut_off(flight: JudgedFlight) -> int:
    """Return how many of `decisions` are cut off."""
    return _count(flight, is_cut_off)


def _count(flight: JudgedFlight, counts: Callable[[Decision], bool]) -> int:
    return sum(step.counts and counts(step.decision) for step in flight.steps)


METRICS = (
    Metric(
        name="decisions", title="Decisions", unit="count", level="episode", better=None,
        definition="decisions within the cap, of each drone",
        paper="", of=decisions,
    ),
    Metric(
        name="unreadable", title="Unreadable", unit="count", level="episode", better="less",
        definition="of these, those whose reply holds no action",
        paper="", of=unreadable,
    ),
    Metric(
        name="refused", title="Refused", unit="count", level="episode", better="less",
        definition="of the unreadable ones, those that the model refused or a filter of its provider withheld",
        paper="", of=refused,
    ),
    Metric(
        name="cut_off", title="Cut off", unit="count", level="episode", better="less",
        definition="of the unreadable ones, those that ended at the longest reply that was allowed",
        paper="", of=cut_off,
    ),
)  # fmt: skip
