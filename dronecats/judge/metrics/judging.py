"""Many episodes judged again, with every metric, on as many cores as there are; the results in the episodes' order."""

import gc
import math
import multiprocessing
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import cache, lru_cache, partial
from pathlib import Path
from typing import Any, TypeVar

from dronecats.agent.action import AxisOrder
from dronecats.agent.reply.reading import reading
from dronecats.judge.episode import Judged, beside_stored, check_radius, judged_damage
from dronecats.judge.judged_flight import JudgedFlight
from dronecats.judge.metrics.failure_mode import FailureMode, failure_mode
from dronecats.judge.metrics.metric import Metric, MetricValue
from dronecats.judge.metrics.registry import METRICS, own_metrics, value_of
from foundation.errors import UsageError
from foundation.protocol import CAP_S, RADIUS_M

EACH = 50  # episodes for which a process of its own pays
AT_ONCE = 8  # episodes that a process is given at a time
FORKS = "fork" in multiprocessing.get_all_start_methods()  # a user's own metric has no name to be sent by
Item = TypeVar("Item")
Made = TypeVar("Made")


@dataclass(frozen=True, slots=True, kw_only=True)
class Judging:
    """How episodes are judged."""

    delta_m: float = RADIUS_M  # m, success radius
    cap_s: float = CAP_S  # s, declarations after it do not count
    measured: bool = False  # whether every metric of the registry is wanted
    own: tuple[Path, ...] = ()  # files of the user's metrics, which are measured in any case

    def check(self) -> None:
        """Raise UsageError for what cannot be, and for a file that holds no metrics."""
        check_radius(self.delta_m)
        if not math.isfinite(self.cap_s) or self.cap_s <= 0:
            raise UsageError(f"--cap wants seconds above 0, got {self.cap_s:g}")
        _metrics(self)


@dataclass(frozen=True, slots=True)
class JudgedEpisode:
    """One episode folder, judged."""

    folder: Path
    judged: Judged
    mode: FailureMode | None  # None: nobody's score
    values: Mapping[str, MetricValue | Sequence[MetricValue]]  # by the metric's name; nothing of damaged logs


def judged_episodes(folders: Sequence[Path], how: Judging, processes: int | None = None) -> Iterator[JudgedEpisode]:
    """Yield each of these episode folders, judged. One that is damaged is an error of its own.

    `processes`: as many as pay where None. Raises UsageError for `how`, and where a user's metric breaks.
    """
    how.check()
    yield from of_each(partial(judged_episode, how=how), folders, processes)


def of_each(function: Callable[[Item], Made], items: Sequence[Item], processes: int | None = None) -> Iterator[Made]:
    """Yield what a function makes of each item, such as an episode folder, in their order.

    `processes`: as many as pay where None. The function itself is not sent to them, and may hold what cannot be.
    """
    count = min(_cores(), len(items) // EACH) if processes is None else processes
    if count > 1 and FORKS:
        fork = multiprocessing.get_context("fork")
        with ProcessPoolExecutor(count, mp_context=fork, initializer=_begin, initargs=(function,)) as pool:
            yield from pool.map(_of_one, items, chunksize=AT_ONCE)
    else:
        yield from map(function, items)


_function: Callable[[Any], Any]  # of a process that works for another


def _begin(function: Callable[[Any], Any]) -> None:
    global _function
    _function = function
    gc.disable()  # rows are in no circles, and looking for some among so many takes a quarter of the time


def _of_one(item: Any) -> Any:
    return _function(item)


def judged_episode(folder: Path, how: Judging) -> JudgedEpisode:
    """Return one episode folder, judged."""
    try:
        flight = JudgedFlight.read(folder, how.delta_m, how.cap_s)
    except UsageError as damage:
        return JudgedEpisode(folder, judged_damage(folder, damage, how.delta_m, how.cap_s), None, {})
    judged = beside_stored(folder, flight.logs, flight.record or None, flight.verdict, reread)
    return JudgedEpisode(folder, judged, failure_mode(flight), values_of(flight, _metrics(how)))


def values_of(flight: JudgedFlight, metrics: Sequence[Metric]) -> dict[str, MetricValue | Sequence[MetricValue]]:
    """Return what these metrics measure of an episode, by name. Raises UsageError where one of them breaks."""
    return {metric.name: value_of(metric, flight) for metric in metrics}


def reread(reply: str, drones: int, mended: bool = False) -> Iterator[tuple[dict[str, Any] | None, ...]]:
    """Yield the actions that a reply may be read as, one for each drone: first in the one order of a point's axes.

    `mended`: as the lenient reading has it. Where that mended nothing, it is the strict one.
    """
    yield _read(reply, drones, "xy", mended)
    yield _read(reply, drones, "yx", mended)


@cache
def _metrics(how: Judging) -> tuple[Metric, ...]:
    own = [metric for file in how.own for metric in own_metrics(file)]
    twice = {metric.name for metric in own if [each.name for each in own].count(metric.name) > 1}
    if twice:
        raise UsageError(f"--metric: there are two metrics named {min(twice)}")
    return (*(METRICS.values() if how.measured else ()), *own)


@lru_cache(64)  # the drones of a fleet have one reply
def _read(reply: str, drones: int, order: AxisOrder, mended: bool) -> tuple[dict[str, Any] | None, ...]:
    read = reading(reply, drones, order, "lenient" if mended else "strict")
    return tuple(one.action.as_json() if one.action else None for one in read)


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
