"""Whether every flight of a study can be flown, seen before the first is, and told by its levels."""

from dataclasses import replace

from dronecats.flight.run.agents import agent_maker
from dronecats.flight.spec.flight import look_up
from dronecats.flight.spec.flight_spec import FlightSpec
from dronecats.study.factor import said
from dronecats.study.plan import StudyPlan
from foundation.errors import UsageError


def check(plan: StudyPlan) -> None:
    """Raise UsageError for the first flight that cannot be; where others can, by the levels at which it is.

    No model is asked whether it answers.
    """
    first: tuple[str, str] | None = None  # what is wrong, and with which levels
    others = False  # something else is wrong elsewhere, or nothing
    for entry, run in zip(plan.entries, plan.study.runs, strict=True):
        if run.flight_number > 1:  # it has another seed and nothing else
            continue
        wrong = _wrong(entry.flight)
        if wrong is not None and first is None:
            first = wrong, ", ".join(f"{name} {said(level)}" for name, level in run.levels.items())
        others |= wrong is None or (first is not None and wrong != first[0])
        if first and others:
            raise UsageError(f"at {first[1]}: {first[0]}")
    if first:
        raise UsageError(first[0])


def _wrong(flight: FlightSpec) -> str | None:
    """Return why a flight cannot be, None where it can. Its ledger is made with the folder, and not here."""
    try:
        look_up(replace(flight, accounts=replace(flight.accounts, ledger=None)))
        agent_maker(flight.agent)
    except UsageError as wrong:
        return str(wrong)
    return None
