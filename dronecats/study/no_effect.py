"""Factors that have no effect on any flight of a study: refused before it is flown, since its report would find none.

Several refine another factor, and where that is 0 there is nothing to be refined. Pictures, wire and vehicle are
disturbed whoever flies: a pilot that knows the truth, or looks at nothing, is asked late and acts on old pictures, too.
"""

import json
from collections.abc import Mapping, Sequence

from dronecats.agent.latency import CAP, FIXED, RATE
from dronecats.flight.spec.flight_spec import FlightSpec
from dronecats.flight.spec.spec_file import as_json
from dronecats.study.design import DesignPoint
from dronecats.study.factors import FACTORS, at_levels, said
from foundation.errors import UsageError
from foundation.run_folder.benchmark import Level

COMPARED = ("rate_cap",)  # has no effect at some levels of its own, with which the others are compared


def check_effects(flight: FlightSpec, points: Sequence[DesignPoint], held: Mapping[str, Level]) -> None:
    """Raise UsageError for a factor, varied or held, that has no effect, and for levels that fly the same.

    `flight`: one of those that are flown, but for its levels, which are `held` and those of a point together.
    """
    if not points:
        return
    flights = [at_levels(flight, {**held, **point}) for point in points]
    for name in (*points[0], *held):
        reasons = [_reason(name, each) for each in flights]
        effective = [point for point, reason in zip(points, reasons, strict=True) if reason is None]
        varies = name in points[0]
        several = varies and name not in COMPARED and len({point[name] for point in points}) > 1
        if len({point.get(name) for point in effective}) < (2 if several else 1):
            reason = next(each for each in reasons if each is not None)
            where = "at all of its levels but one" if effective else "in any flight"
            level = "" if varies else f" at {said(held[name])}"
            raise UsageError(f"{name}{level} has no effect {where}: {reason}")
        if varies:
            _check_other_flights(flight, {**held, **effective[0]}, name, [point[name] for point in points])


def _check_other_flights(flight: FlightSpec, at: Mapping[str, Level], name: str, levels: Sequence[Level]) -> None:
    """Raise UsageError where two levels of a factor are one flight, beside levels at which it has an effect."""
    levels_of: dict[str, Level] = {}
    for level in dict.fromkeys(levels):
        try:
            same = json.dumps(as_json(at_levels(flight, {**at, name: level})))
        except UsageError:  # it goes with other levels of other factors
            continue
        if same in levels_of:
            raise UsageError(
                f"{name} at {said(levels_of[same])} and at {said(level)} is the same flight; leave one of them out"
            )
        levels_of[same] = level


def _reason(name: str, flight: FlightSpec) -> str | None:
    """Return why a factor has no effect on a flight, None where it has one."""
    if name == "rate_cap":
        return _slower_than_its_cap(flight)
    refined = FACTORS[name].refines
    if not refined or FACTORS[refined].get(flight) != 0.0:
        return None
    return f"{refined} is 0 there; vary that, or hold it at a level above it"


def _slower_than_its_cap(flight: FlightSpec) -> str | None:
    """Return why no reply is ever held back: from one to the next it is a question's time at least."""
    policy = flight.latency
    takes_s = sum(policy.numbers(FIXED)) + sum(1.0 / hz for hz in policy.numbers(RATE))
    if not any(takes_s * hz >= 1.0 for hz in policy.numbers(CAP)):
        return None
    held = f"{policy.numbers(CAP)[0]:g} Hz holds none of those back"
    return f"every reply takes {takes_s:g} s there, and {held}; give either another level"
