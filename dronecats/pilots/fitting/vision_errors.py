"""Fits the errors of the noisy pilot to flights of the vision pilot.

Each decision is compared with the truth of its frame, and labelled with the thing that vision took for the target:

- Nothing: a turn, `think`, or a `go` with the depth of a search stride.
- The target: a `go` within 5° of the visible target or within the sides of its box, or a declaration with
  the target in view and nearer than twice the success radius.
- Something else: any other `go`.
- A claim: any other declaration.

In a fleet, only the drone with the most target labels counts.
"""

import math
import statistics
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

import numpy as np

from dronecats.judge.judged_flight import FlightStep, JudgedFlight
from dronecats.pilots.oracle import noisy
from dronecats.pilots.oracle.noisy import BANDS_M, Attention, DetectionErrors, NamedBy, VisionErrors, distance_band
from dronecats.pilots.vision import search
from foundation.camera import CameraModel
from foundation.errors import UsageError
from foundation.protocol import FINISHED, NEAR_M, POINT_SPAN, RADIUS_M
from foundation.run_folder import reading

Taken = Literal["target", "else", "claim", "nothing"]  # claim: wrong declaration; nothing: turn, think or search
ASIDE_DEG = 5.0  # a point within this angle of the target's centre is on the target, even outside its box
SIDES_PX = 8.0  # a point at most this far outside the sides of the target's box is on the target
WANDER_BAND_M = 0.3  # a `go` is a search stride if its depth differs from search.WANDER_M by less
PRIOR = 2.0  # a prior share counts like this many steps
_CAMERA = CameraModel()


@dataclass(frozen=True, slots=True)
class LabelledDecision:
    """A decision, labelled with the thing that vision took for the target."""

    taken: Taken
    seen: bool  # whether the target was visible
    distance_m: float  # true distance of the target
    error_px: tuple[float, float] | None  # pointing error, + right, + below; for a `go` at the target beyond NEAR_M
    depth: float | None  # log(depth / true depth of the centre); for the same decisions as `error_px`
    astray_m: float | None  # depth of a `go`; only for a `go` at something else


@dataclass(frozen=True, slots=True)
class OneDroneFlight:
    success: bool
    decisions: tuple[LabelledDecision, ...]


def label(step: FlightStep) -> LabelledDecision | None:
    """Return a step's decision with its label; None if its frame has no truth, or its reply has no action."""
    frame = step.truth
    if frame is None or frame.distance_m is None or frame.target_frd is None or step.decision.kind is None:
        return None
    seen, away = bool(frame.visible), frame.distance_m
    if step.decision.kind == FINISHED:
        return LabelledDecision("target" if seen and away < 2.0 * RADIUS_M else "claim", seen, away, None, None, None)
    go = step.go
    if go is None or abs(go.depth_m - search.WANDER_M) < WANDER_BAND_M:
        return LabelledDecision("nothing", seen, away, None, None, None)
    ahead, right, below = frame.target_frd
    if not seen or ahead <= 0.0:
        return LabelledDecision("else", seen, away, None, None, go.depth_m)
    x, y = go.x * _CAMERA.width / POINT_SPAN, go.y * _CAMERA.height / POINT_SPAN
    off_x = x - (_CAMERA.width / 2.0 + _CAMERA.focal_px * right / ahead)
    off_y = y - (_CAMERA.height / 2.0 + _CAMERA.focal_px * below / ahead)
    angle = math.degrees(abs(math.atan2(x - _CAMERA.width / 2.0, _CAMERA.focal_px) - math.atan2(right, ahead)))
    box = frame.target_box
    scale = _CAMERA.width / POINT_SPAN
    within = box is not None and scale * box[0] - SIDES_PX <= x <= scale * box[2] + SIDES_PX
    if angle > ASIDE_DEG and not within:
        return LabelledDecision("else", seen, away, None, None, go.depth_m)
    if go.depth_m <= NEAR_M:  # near the target, a rule of the pilot sets point and depth, so they show no error
        return LabelledDecision("target", seen, away, None, None, None)
    return LabelledDecision("target", seen, away, (off_x, off_y), math.log(go.depth_m / ahead), None)


def one_drone(flight: JudgedFlight) -> OneDroneFlight:
    """Return the decisions of the drone that took the target most often."""
    of_drone: dict[int, list[LabelledDecision]] = defaultdict(list)
    for step in flight.steps:
        if step.counts and (decision := label(step)) is not None:
            of_drone[step.decision.drone].append(decision)
    most = max(of_drone.values(), key=lambda ds: sum(d.taken == "target" for d in ds), default=[])
    return OneDroneFlight(flight.verdict.success is True, tuple(most))


def attention(flights: Iterable[OneDroneFlight]) -> Attention:
    """Return how often vision takes each thing for the target.

    The share over all distances is the prior of the share of each distance band.
    """
    steps = [(a, b) for f in flights for a, b in zip((None, *f.decisions), f.decisions, strict=False)]
    seen = [(a is not None and a.taken == "target", b) for a, b in steps if b.seen]
    after_else = [b.taken for a, b in steps if a is not None and a.taken == "else" and b.taken != "target"]
    after_none = [b.taken for a, b in steps if (a is None or a.taken != "else") and b.taken != "target"]

    def taking(was: bool) -> tuple[float, float, float]:
        near, middle, far = ([b.taken == "target" for w, b in seen if w is was and distance_band(b.distance_m) == k]
                             for k in range(len(BANDS_M) + 1))  # fmt: skip
        overall = _share(near + middle + far, 0.5)
        return _share(near, overall), _share(middle, overall), _share(far, overall)

    return Attention(
        found=taking(False),
        kept=taking(True),
        strays=_share([t in ("else", "claim") for t in after_none], 0.1),
        stays=_share([t == "else" for t in after_else], 0.5),
        claims=_share([t == "claim" for t in after_else], 0.05),
    )


def _share(cases: Sequence[bool], prior: float) -> float:
    return round((sum(cases) + PRIOR * prior) / (len(cases) + PRIOR), 4)


def errors_of(flights: Sequence[OneDroneFlight]) -> DetectionErrors:
    """Return the errors of flights whose commands all name the target in the same way."""
    won, lost = ([f for f in flights if f.success is kind] for kind in (True, False))
    decisions = [decision for f in flights for decision in f.decisions]
    errors = [decision.error_px for decision in decisions if decision.error_px]
    depths = [[d for decision in f.decisions if (d := decision.depth) is not None] for f in flights]
    mean = statistics.median([d for flight_depths in depths for d in flight_depths])
    inner = [d - statistics.fmean(steps) for steps in depths if len(steps) > 1 for d in steps]
    step = _spread(inner)
    between = [statistics.fmean(steps) for steps in depths if steps]
    apart = max(0.0, _spread(between) ** 2 - step**2 / statistics.fmean(len(steps) for steps in depths if steps))
    astray = [math.log(m) for decision in decisions if (m := decision.astray_m) is not None]
    return DetectionErrors(
        flights=len(flights),
        mistaken=round(len(lost) / len(flights), 4),
        sure=attention(won),
        lost=attention(lost) if lost else attention(won),
        aside_px=round(_spread([e[0] for e in errors]), 1),
        above_px=round(_spread([e[1] for e in errors]), 1),
        depth=round(mean, 4),
        depth_flight=round(math.sqrt(apart), 4),
        depth_step=round(step, 4),
        astray_m=round(math.exp(statistics.median(astray)), 2) if astray else 10.0,
        astray=round(_spread(astray), 4) if astray else 0.0,
    )


def _spread(values: Sequence[float]) -> float:
    """Return half the width of the middle 68 %: a robust standard deviation."""
    low, high = np.percentile(values, (15.87, 84.13))
    return float(high - low) / 2.0


def fit_run(run: Path) -> VisionErrors:
    """Return the errors of a run's flights.

    Raises UsageError for a damaged run, a run without scored flights, and a run in which a way of naming the target has
    no flight with two measured depths: the noisy pilot needs the errors of all ways.
    """
    flights: dict[NamedBy, list[OneDroneFlight]] = defaultdict(list)
    for folder in reading.episodes(run):
        flight = JudgedFlight.read(folder)
        if flight.scored:
            flights[noisy.named_by(str(flight.record.get("instruction", "")))].append(one_drone(flight))
    if not flights:
        raise UsageError(f"{run} has no scored flight. Name the run folder, which is inside the benchmark's")
    missing = [
        kind
        for kind in get_args(NamedBy)
        if all(sum(decision.depth is not None for decision in flight.decisions) < 2 for flight in flights[kind])
    ]
    if missing:
        raise UsageError(
            f"{run} has no scored flight with two moves to a target that is named by {' or '.join(missing)}."
            " Name a run of `bench --suite all --pilot vision`"
        )
    code = str((reading.run_configuration(run) or {}).get("code_sha256", ""))
    return VisionErrors(
        fitted_to=run.resolve().name, code_sha256=code, eyes={name: errors_of(group) for name, group in flights.items()}
    )
