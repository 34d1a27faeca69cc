"""What happened in a flight, and when: the places that one jumps to. Nothing in it is the judge's."""

from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from dronecats.report.kit.words import action_or_reason
from dronecats.report.recorded.telemetry import DroneTelemetry
from foundation.run_folder.reading import Logs, rows
from foundation.run_folder.rows import DroneNumber

SAME_S = 1e-6  # s within which one is there already
CALM = ("cap", "decided")  # ends of flights in which nothing went wrong
OFFBOARD = "OFFBOARD"
ENDING_S = 1.0  # s before a flight's end in which its own run takes it out of that mode


class OccurrenceKind(Enum):
    """Of what sort it is."""

    DECISION = "decision"
    DECLARATION = "declaration"
    FAULT = "what went wrong"


@dataclass(frozen=True, slots=True)
class Occurrence:
    """Something that happened at one time."""

    t_s: float  # s since the episode began
    kind: OccurrenceKind
    drone: int | None  # None: of all
    words: str


@dataclass(frozen=True, slots=True, kw_only=True)
class EnvelopeRow:
    """A line of safety.jsonl: which limits of the envelope act from then on; none: none does any more."""

    time_us: int  # µs, vehicle clock
    drone: DroneNumber
    limits: tuple[str, ...]


def envelope_rows(path: Path, t0_us: int) -> tuple[Occurrence, ...]:
    """Return what a safety.jsonl tells, nothing where there is none. Raises UsageError where it is damaged."""
    told = rows(path, EnvelopeRow) if path.is_file() else ()
    return tuple(
        Occurrence((row.time_us - t0_us) / 1e6, OccurrenceKind.FAULT, row.drone,
                   f"envelope: limited by {', '.join(row.limits)}")
        for row in told if row.limits
    )  # fmt: skip


def occurrences(
    logs: Logs, vehicles: Mapping[int, DroneTelemetry], limited: Iterable[Occurrence], end_s: float
) -> tuple[Occurrence, ...]:
    """Return everything that happened from the beginning to `end_s`, in the order of time."""
    every = [*_decided(logs), *limited, *_end(logs, end_s)]
    for vehicle in vehicles.values():
        every += [*_warned(vehicle), *_left_alone(vehicle, end_s)]
    return tuple(sorted((one for one in every if 0.0 <= one.t_s <= end_s + SAME_S), key=lambda one: one.t_s))


def following(found: Sequence[Occurrence], t_s: float) -> Occurrence | None:
    """Return the first that is later than a time, None after the last."""
    index = bisect_right(found, t_s + SAME_S, key=lambda one: one.t_s)
    return found[index] if index < len(found) else None


def preceding(found: Sequence[Occurrence], t_s: float) -> Occurrence | None:
    """Return the last that is earlier than a time, None before the first."""
    index = bisect_left(found, t_s - SAME_S, key=lambda one: one.t_s)
    return found[index - 1] if index else None


def _decided(logs: Logs) -> Iterator[Occurrence]:
    for one in logs.decisions:
        words = f"step {one.step}: {action_or_reason(one)}"
        yield Occurrence(one.t_decided, OccurrenceKind.DECISION, one.drone, words)
        if one.declares:
            yield Occurrence(one.t_decided, OccurrenceKind.DECLARATION, one.drone, f"step {one.step}: declared")
        if one.action is None:
            yield Occurrence(one.t_decided, OccurrenceKind.FAULT, one.drone, words)


def _warned(vehicle: DroneTelemetry) -> Iterator[Occurrence]:
    for t_s, text in zip(vehicle.warnings.t_s, vehicle.warnings.values, strict=True):
        yield Occurrence(t_s, OccurrenceKind.FAULT, vehicle.drone, text)


def _left_alone(vehicle: DroneTelemetry, end_s: float) -> Iterator[Occurrence]:
    """Yield when the mode was no longer ours although the episode went on: a failsafe, or somebody's hand."""
    before = ""
    for t_s, state in zip(vehicle.states.t_s, vehicle.states.values, strict=True):
        if before == OFFBOARD and state.mode != OFFBOARD and t_s < end_s - ENDING_S:
            yield Occurrence(t_s, OccurrenceKind.FAULT, vehicle.drone, f"mode {state.mode}")
        before = state.mode


def _end(logs: Logs, end_s: float) -> Iterator[Occurrence]:
    if logs.end is not None and logs.end.reason not in CALM:
        said = f": {logs.end.error}" if logs.end.error else ""
        yield Occurrence(end_s, OccurrenceKind.FAULT, None, f"the flight ended: {logs.end.reason}{said}")
