"""What the host's load moved, against the same episode and seed in lockstep on a host that does nothing else."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from dronecats.judge.statistics.shares import wilson
from dronecats.study.load.flights import Clock, LoadedFlight


@dataclass(frozen=True, slots=True, kw_only=True)
class LevelRow:
    """The flights of one clock at one level."""

    clock: Clock
    busy: int  # processes
    flights: int
    solved: int
    moved: int  # whose verdict is another than the reference's
    other_bytes: int  # whose logs differ from the reference's; all of them in real time
    ne_moved_m: float | None  # m, the median by which the NE differs from the reference's
    marked: int  # that `bench` marks as held up by the host
    stalled_steps: int
    steps: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Marking:
    """How well the mark tells which flights in real time have another verdict."""

    moved: int
    marked: int
    both: int

    @property
    def precision(self) -> tuple[float, float, float] | None:
        """The share of the marked that were moved, with Wilson's interval; None where none was marked."""
        return _share(self.both, self.marked)

    @property
    def recall(self) -> tuple[float, float, float] | None:
        """The share of the moved that are marked, with Wilson's interval; None where none was moved."""
        return _share(self.both, self.moved)


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadFindings:
    """All of it."""

    rows: Sequence[LevelRow]
    of_verdicts: Marking  # moved: success is another
    of_errors: Marking  # moved: NE is another by more than the farthest of any on the idle host
    idle_error_m: float | None  # m, that farthest

    def as_json(self) -> dict[str, Any]:
        """Return it as JSON values."""
        return {
            "rows": [asdict(row) for row in self.rows],
            "marking_of_verdicts": _told(self.of_verdicts),
            "marking_of_errors": _told(self.of_errors),
            "idle_error_m": self.idle_error_m,
        }


def compared(flown: Sequence[LoadedFlight]) -> LoadFindings:
    """Return what a study found. The reference is the lockstep flight at the first level that was flown."""
    first = flown[0].busy
    reference = {(f.episode, f.flight): f for f in flown if f.clock == "lockstep" and f.busy == first}
    groups: dict[tuple[Clock, int], list[LoadedFlight]] = {}
    for each in flown:
        groups.setdefault((each.clock, each.busy), []).append(each)
    rows = [_row(clock, busy, members, reference) for (clock, busy), members in groups.items()]
    real = [each for each in flown if each.clock == "real time"]
    off = {id(each): error_m(each, reference[each.episode, each.flight]) for each in real}
    idle = [m for each in real if each.busy == first and (m := off[id(each)]) is not None]
    farthest = max(idle, default=None)
    strayed = [f for f in real if farthest is not None and (off[id(f)] or 0.0) > farthest]
    return LoadFindings(
        rows=rows,
        of_verdicts=_marking(real, [f for f in real if f.success != reference[f.episode, f.flight].success]),
        of_errors=_marking([f for f in real if f.busy != first], strayed),
        idle_error_m=farthest,
    )


def error_m(one: LoadedFlight, other: LoadedFlight) -> float | None:
    """Return by how many metres the NE of two flights differs; None where one has none."""
    if one.ne_m is None or other.ne_m is None:
        return None
    return abs(one.ne_m - other.ne_m)


def _row(
    clock: Clock, busy: int, members: Sequence[LoadedFlight], reference: dict[tuple[str, int], LoadedFlight]
) -> LevelRow:
    pairs = [(each, reference[each.episode, each.flight]) for each in members]
    moved_m = sorted(m for one, other in pairs if (m := error_m(one, other)) is not None)
    return LevelRow(
        clock=clock,
        busy=busy,
        flights=len(members),
        solved=sum(each.success for each in members),
        moved=sum(one.success != other.success for one, other in pairs),
        other_bytes=sum(one.digest != other.digest for one, other in pairs),
        ne_moved_m=round(moved_m[len(moved_m) // 2], 3) if moved_m else None,
        marked=sum(each.marked for each in members),
        stalled_steps=sum(each.stalled_steps for each in members),
        steps=sum(each.steps for each in members),
    )


def _marking(flights: Sequence[LoadedFlight], moved: Sequence[LoadedFlight]) -> Marking:
    return Marking(
        moved=len(moved), marked=sum(each.marked for each in flights), both=sum(each.marked for each in moved)
    )


def _share(part: int, whole: int) -> tuple[float, float, float] | None:
    return (part / whole, *wilson(part, whole)) if whole else None


def _told(marking: Marking) -> dict[str, Any]:
    return {**asdict(marking), "precision": marking.precision, "recall": marking.recall}
