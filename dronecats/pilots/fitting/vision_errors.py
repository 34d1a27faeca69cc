"""The fit: decisions held against what the logger wrote of their pictures, counted into shares and spreads."""

import math
import statistics
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from dronecats.judge.metrics.flown_episode import FlownEpisode, flown_episode
from dronecats.judge.metrics.flown_step import FlownStep
from dronecats.pilots.oracle import noisy
from dronecats.pilots.oracle.noisy import BANDS_M, Attention, DetectionErrors, NamedBy, VisionErrors, distance_band
from dronecats.pilots.vision import search
from foundation.camera import CameraModel
from foundation.protocol import FINISHED, NEAR_M, POINT_SPAN, RADIUS_M
from foundation.run_folder import reading

Taken = Literal["target", "else", "claim", "nothing"]
ASIDE_DEG = 5.0  # off the target's centre within which a point is on it, whatever its box
SIDES_PX = 8.0  # beyond the sides of its box, likewise
WANDER_BAND_M = 0.3  # off the depth with which vision says that it wanders
PRIOR = 2.0  # steps that the share over all distances counts as, beside those of a band
_CAMERA = CameraModel()


@dataclass(frozen=True, slots=True)
class Look:
    """One decision, as an error model has it."""

    taken: Taken
    seen: bool  # whether the target was
    distance_m: float
    error_px: tuple[float, float] | None  # of a go at a target that is seen, not near: aside, + right, and below
    depth: float | None  # likewise: logarithm of the told depth over the centre's
    astray_m: float | None  # of a go at something else: its depth


@dataclass(frozen=True, slots=True)
class OneDroneFlight:
    """The looks of one drone in one flight."""

    success: bool
    looks: tuple[Look, ...]


def looked(step: FlownStep) -> Look | None:
    """Return what a decision took for the target; None where nothing is known of its picture, or it is no action."""
    frame = step.truth
    if frame is None or frame.distance_m is None or frame.target_frd is None or step.decision.kind is None:
        return None
    seen, away = bool(frame.visible), frame.distance_m
    if step.decision.kind == FINISHED:
        return Look("target" if seen and away < 2.0 * RADIUS_M else "claim", seen, away, None, None, None)
    go = step.go
    if go is None or abs(go.depth_m - search.WANDER_M) < WANDER_BAND_M:
        return Look("nothing", seen, away, None, None, None)
    ahead, right, below = frame.target_frd
    if not seen or ahead <= 0.0:
        return Look("else", seen, away, None, None, go.depth_m)
    x, y = go.x * _CAMERA.width / POINT_SPAN, go.y * _CAMERA.height / POINT_SPAN
    off_x = x - (_CAMERA.width / 2.0 + _CAMERA.focal_px * right / ahead)
    off_y = y - (_CAMERA.height / 2.0 + _CAMERA.focal_px * below / ahead)
    angle = math.degrees(abs(math.atan2(x - _CAMERA.width / 2.0, _CAMERA.focal_px) - math.atan2(right, ahead)))
    box = frame.target_box
    scale = _CAMERA.width / POINT_SPAN
    within = box is not None and scale * box[0] - SIDES_PX <= x <= scale * box[2] + SIDES_PX
    if angle > ASIDE_DEG and not within:
        return Look("else", seen, away, None, None, go.depth_m)
    if go.depth_m <= NEAR_M:  # near things are told with points and depths that make strides, not with estimates
        return Look("target", seen, away, None, None, None)
    return Look("target", seen, away, (off_x, off_y), math.log(go.depth_m / ahead), None)


def flight(flown: FlownEpisode) -> OneDroneFlight:
    """Return the looks of the drone that was on the target most often."""
    of_drone: dict[int, list[Look]] = defaultdict(list)
    for step in flown.steps:
        if step.counts and (look := looked(step)) is not None:
            of_drone[step.decision.drone].append(look)
    most = max(of_drone.values(), key=lambda looks: sum(look.taken == "target" for look in looks), default=[])
    return OneDroneFlight(flown.verdict.success is True, tuple(most))


def attention(flights: Iterable[OneDroneFlight]) -> Attention:
    """Return what is taken at which share of steps; shares of few steps lean on those of all distances."""
    steps = [(a, b) for one in flights for a, b in zip((None, *one.looks), one.looks, strict=False)]
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


def _share(told: Sequence[bool], prior: float) -> float:
    return round((sum(told) + PRIOR * prior) / (len(told) + PRIOR), 4)


def eye(flights: Sequence[OneDroneFlight]) -> DetectionErrors:
    """Return the errors of these flights, which all tell the target in one way."""
    won, lost = ([f for f in flights if f.success is kind] for kind in (True, False))
    looks = [look for f in flights for look in f.looks]
    errors = [look.error_px for look in looks if look.error_px]
    depths = [[d for look in f.looks if (d := look.depth) is not None] for f in flights]
    told = [d for each in depths for d in each]
    mean = statistics.median(told)
    inner = [d - statistics.fmean(each) for each in depths if len(each) > 1 for d in each]
    step = _spread(inner)
    between = [statistics.fmean(each) for each in depths if each]
    apart = max(0.0, _spread(between) ** 2 - step**2 / statistics.fmean(len(each) for each in depths if each))
    astray = [math.log(m) for look in looks if (m := look.astray_m) is not None]
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
    """Return the standard deviation of a normal distribution with the middle two thirds of these."""
    low, high = np.percentile(values, (15.87, 84.13))
    return float(high - low) / 2.0


def fit(run: Path) -> VisionErrors:
    """Return the errors of a run folder's flights. Raises UsageError for what is damaged."""
    told: dict[NamedBy, list[OneDroneFlight]] = defaultdict(list)
    for folder in reading.episodes(run):
        flown = flown_episode(folder)
        if flown.scored:
            told[noisy.named_by(str(flown.record.get("instruction", "")))].append(flight(flown))
    code = str((reading.run_configuration(run) or {}).get("code_sha256", ""))
    return VisionErrors(
        fitted_to=run.resolve().name, code_sha256=code, eyes={name: eye(flights) for name, flights in told.items()}
    )
