"""Compares the paths of two flights from their pose traces, each relative to its own start, and plots them.

The two flights usually have the same decisions, and differ in the autopilot or the place. Positions are relative to the
first pose, in axes along the first heading (ahead, right, down), or NED with `keep_north`. The paths are compared at
the same second of the episode. With `by_step`, they are compared at the same second of the same step. This removes
differences that come from the times of replies and frames, and not from the autopilot.
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dronecats.report.figures import canvas
from foundation.errors import UsageError
from foundation.run_folder.reading import Logs
from foundation.run_folder.rows import drone_label

Array = NDArray[np.float64]
GRID_S = 0.1  # s between two compared times
MINUTE_S = 60.0


@dataclass(frozen=True, slots=True)
class Trace:
    """The path of a drone relative to its first pose."""

    t: Array  # (n,) s since the episode began
    position: Array  # (n, 3) m from the first pose; ahead, right, down, or NED with `keep_north`

    def at(self, t: Array) -> Array:
        """Return the positions (k, 3), m, at k times within the trace, interpolated linearly."""
        return np.column_stack([np.interp(t, self.t, self.position[:, axis]) for axis in range(3)])


@dataclass(frozen=True, slots=True)
class IntervalDistances:
    """The distances between two paths in an interval of the compared time."""

    from_s: float
    to_s: float
    max_m: float
    mean_m: float
    rms_m: float


@dataclass(frozen=True, slots=True)
class PathComparison:
    drone: int
    a: Trace
    b: Trace
    t: Array  # (n,) s, compared time, which begins at 0
    here: Array  # (n, 3) m, positions on path a
    there: Array  # (n, 3) m, positions on path b
    distance_m: Array  # (n,) m, between `here` and `there`
    spans: tuple[IntervalDistances, ...]  # one for each minute
    first: IntervalDistances  # the requested first seconds, or the common time if it is shorter
    beside_m: float  # m, largest distance of a path's points in `first` to the nearest point of the other path


def compare(a: Logs, b: Logs, seconds: float, *, by_step: bool, keep_north: bool = False) -> tuple[PathComparison, ...]:
    """Return the comparison of every drone that both flights have. `seconds`: duration of `PathComparison.first`.

    Raises UsageError if the flights have no common drone or no common time, or if a path has less than two poses.
    """
    drones = sorted({p.drone for p in a.poses} & {p.drone for p in b.poses})
    if not drones:
        raise UsageError("the two flights have no drone with logged poses in common")
    comparisons = []
    for drone in drones:
        paths = trace(a, drone, keep_north), trace(b, drone, keep_north)
        steps = (_steps(a, drone), _steps(b, drone)) if by_step else ([], [])
        comparisons.append(_compare(drone, paths, steps, seconds))
    return tuple(comparisons)


def _steps(logs: Logs, drone: int) -> list[float]:
    """Return the decision time (s) of each step of a drone."""
    return [d.t_decided for d in sorted(logs.decisions, key=lambda d: d.step) if d.drone == drone]


def trace(logs: Logs, drone: int, keep_north: bool) -> Trace:
    """Return the path of a drone. Raises UsageError for less than two poses, or a first pose without heading."""
    poses = sorted((p for p in logs.poses if p.drone == drone), key=lambda p: p.t)
    if len(poses) < 2:
        raise UsageError(f"{drone_label(drone)} has only {len(poses)} poses in one of the flights, too few for a path")
    position = np.array([p.position_ned for p in poses], float)
    position = position - position[0]
    if not keep_north:
        if poses[0].yaw_deg is None:
            raise UsageError("the first pose of one of the flights has no heading. Compare with --keep-north")
        yaw = math.radians(poses[0].yaw_deg)
        c, s = math.cos(yaw), math.sin(yaw)
        into_nose = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])  # north, east, down → ahead, right, down
        position = position @ into_nose.T
    return Trace(np.array([p.t for p in poses], float), position)


def _compare(
    drone: int, paths: tuple[Trace, Trace], steps: tuple[list[float], list[float]], seconds: float
) -> PathComparison:
    a, b = paths
    at_a, at_b = _instants(a, b, *steps)
    if len(at_a) < 2:
        raise UsageError(f"the two flights of {drone_label(drone)} have no time in common")
    t = np.arange(len(at_a), dtype=np.float64) * GRID_S
    here, there = a.at(at_a), b.at(at_b)
    distance_m = np.linalg.norm(here - there, axis=1)
    spans = tuple(
        _span(t, distance_m, from_s, min(from_s + MINUTE_S, float(t[-1])))
        for from_s in np.arange(0.0, float(t[-1]), MINUTE_S)
    )
    first = t <= seconds + 1e-9
    beside_m = max(_farthest(here[first], there), _farthest(there[first], here))
    first_span = _span(t, distance_m, 0.0, min(seconds, float(t[-1])))
    return PathComparison(drone, a, b, t, here, there, distance_m, spans, first_span, beside_m)


def _instants(a: Trace, b: Trace, steps_a: list[float], steps_b: list[float]) -> tuple[Array, Array]:
    """Return the corresponding times (s) of the two flights, with the spacing GRID_S.

    A step may last longer in one flight; only the shorter duration is compared. One grid runs through all steps, so no
    step is extended to a multiple of GRID_S. Without steps, both results are the common times of the flights.
    """
    start, end = max(a.t[0], b.t[0]), min(a.t[-1], b.t[-1])
    if not steps_a or not steps_b:
        t = np.arange(start, end + 1e-9, GRID_S)
        return t, t
    common = min(len(steps_a), len(steps_b))
    marks_a, marks_b = ([trace.t[0], *steps[:common]] for trace, steps in ((a, steps_a), (b, steps_b)))
    ends = [
        [*marks[1:], last]
        for marks, last in ((marks_a, _after(steps_a, common, a)), (marks_b, _after(steps_b, common, b)))
    ]
    lengths = np.min([np.subtract(to, marks) for to, marks in zip(ends, (marks_a, marks_b), strict=True)], axis=0)
    begins = np.concatenate([[0.0], np.cumsum(np.maximum(lengths, 0.0))])  # compared times: begin of each step, end
    t = np.arange(0.0, begins[-1] + 1e-9, GRID_S)
    step = np.searchsorted(begins[:-1], t + 1e-9, side="right") - 1
    into = np.maximum(t - begins[step], 0.0)
    return np.array(marks_a)[step] + into, np.array(marks_b)[step] + into


def _after(steps: list[float], count: int, path: Trace) -> float:
    """Return the time (s) of the decision after the first `count` decisions; without one, the end of the path."""
    return steps[count] if len(steps) > count else float(path.t[-1])


def _span(t: Array, distance_m: Array, from_s: float, to_s: float) -> IntervalDistances:
    part = distance_m[(t >= from_s - 1e-9) & (t <= to_s + 1e-9)]
    return IntervalDistances(
        round(float(from_s), 3), round(to_s, 3), float(part.max()), float(part.mean()), float(np.sqrt((part**2).mean()))
    )


def _farthest(points: Array, path: Array) -> float:
    """Return the largest distance from a point of `points` to the nearest point of `path`."""
    from scipy.spatial import cKDTree

    return float(cKDTree(path).query(points)[0].max())


def same_replies(a: Logs, b: Logs, seconds: float) -> tuple[int, int]:
    """Return (steps with equal replies, steps) for the steps that both flights decided within `seconds`."""
    replies = [{(d.step, d.drone): d.reply for d in logs.decisions if d.t_decided <= seconds} for logs in (a, b)]
    common = replies[0].keys() & replies[1].keys()
    return sum(replies[0][key] == replies[1][key] for key in common), len(common)


def figures(comparisons: tuple[PathComparison, ...], within_m: float, seconds: float) -> dict[str, Any]:
    """Return the comparison as JSON; `agree`: every drone stays within `within_m` for all of the first `seconds`."""

    def span(s: IntervalDistances) -> dict[str, float]:
        return {name: round(getattr(s, name), 4) for name in ("from_s", "to_s", "max_m", "mean_m", "rms_m")}

    compared_s = min(c.first.to_s for c in comparisons)
    return {
        "agree": all(c.first.max_m <= within_m for c in comparisons) and compared_s >= seconds - GRID_S,
        "within_m": within_m,
        "seconds": seconds,
        "compared_s": compared_s,
        "drones": [
            {
                "drone": c.drone,
                "first": span(c.first),
                "minutes": [span(s) for s in c.spans],
                "final_m": round(float(c.distance_m[-1]), 4),
                "beside_m": round(c.beside_m, 4),
                "path_a_m": round(_length(c.a), 3),
                "path_b_m": round(_length(c.b), 3),
            }
            for c in comparisons
        ],
    }


def _length(path: Trace) -> float:
    return float(np.linalg.norm(np.diff(path.position, axis=0), axis=1).sum())


def draw(
    comparisons: tuple[PathComparison, ...], names: tuple[str, str], within_m: float, file: Path, axes: str
) -> None:
    """Draw the comparison to `file`. `axes`: names of the plan's axes, such as "ahead,right".

    Raises UsageError if the file cannot be written.
    """
    figure = canvas(6.5, 12.0)
    grid = figure.add_gridspec(2, 2)
    plan, height, apart = figure.add_subplot(grid[:, 0]), figure.add_subplot(grid[0, 1]), figure.add_subplot(grid[1, 1])
    for comparison in comparisons:
        for path, name, style, colour in zip(
            (comparison.a, comparison.b), names, ("-", "--"), ("tab:blue", "tab:orange"), strict=True
        ):
            label = name if comparison.drone == comparisons[0].drone else None
            plan.plot(path.position[:, 1], path.position[:, 0], style, color=colour, label=label)
        for here, there in zip(comparison.here[::100], comparison.there[::100], strict=True):  # every ten seconds
            plan.plot([here[1], there[1]], [here[0], there[0]], "-", color="0.4", linewidth=1)
        height.plot(comparison.t, -comparison.here[:, 2], "-", color="tab:blue")
        height.plot(comparison.t, -comparison.there[:, 2], "--", color="tab:orange")
        apart.plot(comparison.t, comparison.distance_m, color="tab:red")
    apart.axhline(within_m, color="0.5", linewidth=1)
    plan.plot(0, 0, "k^")
    plan.set_aspect("equal", adjustable="datalim")
    ahead, right = axes.split(",")
    plan.set(xlabel=f"{right} [m]", ylabel=f"{ahead} [m]", title="from above, each from its own start")
    height.set(ylabel="height over the start [m]")
    apart.set(xlabel="time compared [s]", ylabel="apart [m]")
    plan.legend()
    for axis in (plan, height, apart):
        axis.grid(alpha=0.3)
    try:
        figure.savefig(file, dpi=110)
    except (OSError, ValueError) as error:
        raise UsageError(f"the picture {file} cannot be written: {error}") from None
