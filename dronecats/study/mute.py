"""Factors that say nothing of any flight of a study: found before it is flown, since its report would find no effect.

Several refine another factor, and where that is nought there is nothing to be refined. Pictures, wire and vehicle are
disturbed whoever flies: who is told the truth, or looks at nothing, is asked late and acts on old pictures, too.
"""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence

from dronecats.agent.latency import CAP, parts_of
from dronecats.flight.spec.flight_spec import FlightSpec
from dronecats.flight.spec.spec_file import as_json
from dronecats.study.design import DesignPoint
from dronecats.study.factor import said
from dronecats.study.factors import HANGING, JITTERED, RATE, at_levels
from foundation.errors import UsageError
from foundation.run_folder.benchmark import Level

BY_ITSELF = ("rate_cap",)  # silent at some levels of its own, with which the others are compared
SERVED = ("fixed", RATE)  # policies of one reply time


def check(flight: FlightSpec, points: Sequence[DesignPoint], held: Mapping[str, Level]) -> None:
    """Raise UsageError for a factor, varied or held, that says nothing, and for levels that fly the same.

    `flight`: one of those that are flown, but for its levels, which are `held` and those of a point together.
    """
    if not points:
        return
    flights = [at_levels(flight, {**held, **point}) for point in points]
    for name in (*points[0], *held):
        why = SILENT.get(name)
        silent = [why(each) if why else None for each in flights]
        heard = [point for point, reason in zip(points, silent, strict=True) if reason is None]
        varies = name in points[0]
        several = varies and name not in BY_ITSELF and len({point[name] for point in points}) > 1
        wanted = 2 if several else 1
        if len({point.get(name) for point in heard}) < wanted:
            reason = next(each for each in silent if each is not None)
            everywhere = "in every flight" if not heard else "at all of its levels but one"
            level = "" if varies else f" at {said(held[name])}"
            raise UsageError(f"{name}{level} says nothing {everywhere}: {reason}")
        if varies:
            _check_other_flights(flight, {**held, **heard[0]}, name, [point[name] for point in points])


def _check_other_flights(flight: FlightSpec, at: Mapping[str, Level], name: str, levels: Sequence[Level]) -> None:
    """Raise UsageError where two levels of a factor are one flight, beside levels at which it says something."""
    flown: dict[str, Level] = {}
    for level in dict.fromkeys(levels):
        try:
            same = json.dumps(as_json(at_levels(flight, {**at, name: level})))
        except UsageError:  # it goes with other levels of the others
            continue
        if same in flown:
            raise UsageError(
                f"{name} at {said(flown[same])} and at {said(level)} is one and the same flight; leave one of them out"
            )
        flown[same] = level


def _numbers(flight: FlightSpec, kind: str) -> list[float]:
    """Return the numbers of the part of a flight's latency that is of a kind, none where it has no such part."""
    parts = (part.partition(":") for part in parts_of(flight.latency))
    return next(([float(each) for each in numbers.split(",")] for of, _, numbers in parts if of == kind), [])


def _steady_replies(flight: FlightSpec) -> str | None:
    around = _numbers(flight, JITTERED)
    return None if around[1:2] != [0.0] else "jitter_cv is 0 there; give that a level above it"


def _no_reply_hangs(flight: FlightSpec) -> str | None:
    share = _numbers(flight, HANGING)
    return None if share[:1] != [0.0] else "reply_stall_share is 0 there; give that a level above it"


def _hangs_for_nothing(flight: FlightSpec) -> str | None:
    hanging = _numbers(flight, HANGING)
    return None if hanging[1:] != [0.0] else "reply_stall_length is 0 there; give that a level above it"


def _slower_than_its_cap(flight: FlightSpec) -> str | None:
    """Return why no reply is ever held back: from one to the next it is a question's time at least."""
    parts = dict(_kinds(flight))
    takes_s = sum(1.0 / one if kind == RATE else one for kind in SERVED for one in parts.get(kind, [])[:1])
    rate_hz = parts.get(CAP, [0.0])[0]
    if not rate_hz or takes_s * rate_hz < 1.0:
        return None
    return (
        f"every reply takes {takes_s:g} s there, and {rate_hz:g} Hz holds none of those back; give either another level"
    )


def _kinds(flight: FlightSpec) -> Iterator[tuple[str, list[float]]]:
    for kind in (*SERVED, CAP):
        yield kind, _numbers(flight, kind)


def _calm(flight: FlightSpec) -> str | None:
    north, east, _ = flight.disturbances.vehicle.wind_ned
    return None if north or east else "wind is 0 there; give that a level above it"


def _no_host_stalls(flight: FlightSpec) -> str | None:
    share = flight.disturbances.vehicle.stalled
    return None if share else "stall_share is 0 there; vary that, or hold it at a level above it"


def _stalls_for_nothing(flight: FlightSpec) -> str | None:
    length = flight.disturbances.vehicle.stall_s
    return None if length else "stall_length is 0 there; give that a level above it"


SILENT: Mapping[str, Callable[[FlightSpec], str | None]] = {  # why a factor says nothing of a flight; None: it does
    "jitter_rho": _steady_replies,
    "rate_cap": _slower_than_its_cap,
    "reply_stall_share": _hangs_for_nothing,
    "reply_stall_length": _no_reply_hangs,
    "wind_towards": _calm,
    "stall_share": _stalls_for_nothing,
    "stall_length": _no_host_stalls,
}
