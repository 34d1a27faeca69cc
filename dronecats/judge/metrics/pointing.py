"""Metrics of the points and depths of `go` actions. Source: paper, appendix "Execution".

A point is judged only if the target was visible in the picture. The picture's row in truth.jsonl has the depth of the
visible target surface, the target's centre in camera axes, and the target's box in the picture. Older logs lack the
box. The camera model is the pinhole camera of the benchmark (`foundation.camera`).
"""

import math
from collections.abc import Iterator

from dronecats.judge.diagnostics import is_wide_rotation
from dronecats.judge.judged_flight import FlightStep, JudgedFlight
from dronecats.judge.metrics.metric import Metric, MetricValue, known_values, mean, median, per_step
from foundation.camera import CameraModel
from foundation.protocol import HISTORY_LENGTH, POINT_SPAN
from foundation.run_folder.rows import PointedGo

SAME = 0.5  # coordinates count as equal within this, because the prompt's history shows integer pixels
_CAMERA = CameraModel()


def rescaled(flight: JudgedFlight) -> list[MetricValue]:
    """Return per decision whether a go's point equals the pixels that the prompt's history shows for the previous go.

    The previous go is the drone's newest go among its last five actions, which the history shows. None without a
    previous go, and if the pixels of that go equal its point, because a copy is then not detectable.
    """
    before: dict[int, list[PointedGo | None]] = {}  # actions so far, by drone
    values: list[MetricValue] = []
    for step in flight.steps:
        shown = before.setdefault(step.decision.drone, [])
        last = next((go for go in reversed(shown[-HISTORY_LENGTH:]) if go), None)
        values.append(_rescaled(step.go, last) if step.counts and step.go and last else None)
        if step.decision.action is not None:
            shown.append(step.go)
    return values


def _on_target(step: FlightStep) -> bool | None:
    """Return whether a go's point is within the target's box; None without a go or a target in view."""
    frame = step.in_view
    if step.go is None or frame is None or frame.target_box is None:
        return None
    x0, y0, x1, y1 = frame.target_box
    return x0 <= step.go.x <= x1 and y0 <= step.go.y <= y1


def _pointing_error_deg(step: FlightStep) -> float | None:
    """Return the angle (°) at the camera between a go's point and the target's centre; None if unknown."""
    frame = step.in_view
    if step.go is None or frame is None or frame.target_frd is None:
        return None
    pointed, true = _ray(step.go), frame.target_frd
    across = math.hypot(*_cross(pointed, true))
    return math.degrees(math.atan2(across, sum(a * b for a, b in zip(pointed, true, strict=True))))


def _depth_error_m(step: FlightStep) -> float | None:
    """Return the depth (m) of a go on the target minus the depth of the target's surface; positive: too far."""
    frame = step.in_view
    if step.go is None or frame is None or frame.oracle_depth_m is None or not _on_target(step):
        return None
    return step.go.depth_m - frame.oracle_depth_m


def _absolute_depth_error_m(step: FlightStep) -> float | None:
    error = _depth_error_m(step)
    return None if error is None else abs(error)


def _rescaled(go: PointedGo, last: PointedGo) -> bool | None:
    pixels = (last.x * _CAMERA.width / POINT_SPAN, last.y * _CAMERA.height / POINT_SPAN)
    if abs(pixels[0] - last.x) <= SAME and abs(pixels[1] - last.y) <= SAME:
        return None
    return abs(go.x - pixels[0]) <= SAME and abs(go.y - pixels[1]) <= SAME


def _ray(go: PointedGo) -> tuple[float, float, float]:
    """Return the direction of a point in camera axes: forward, right, down."""
    right = (go.x / POINT_SPAN - 0.5) * _CAMERA.width / _CAMERA.focal_px
    return (1.0, right, (go.y / POINT_SPAN - 0.5) * _CAMERA.height / _CAMERA.focal_px)


def _cross(a: tuple[float, float, float], b: tuple[float, float, float]) -> Iterator[float]:
    yield a[1] * b[2] - a[2] * b[1]
    yield a[2] * b[0] - a[0] * b[2]
    yield a[0] * b[1] - a[1] * b[0]


on_target, pointing_error = per_step(_on_target), per_step(_pointing_error_deg)
depth_error, absolute_depth_error = per_step(_depth_error_m), per_step(_absolute_depth_error_m)
wide_rotation = per_step(lambda step: is_wide_rotation(step.decision))
EXECUTION = "Execution"
METRICS = (
    Metric(
        name="on_target", title="Point on target", unit="share", level="step", better="more",
        definition="for a go while the target is in view: the point is within the target's box in the image",
        paper=EXECUTION, of=on_target,
    ),
    Metric(
        name="pointing_error_deg", title="Pointing error", unit="°", level="step", better="less",
        definition="for a go with the target in view: angle at the camera between the point and the target's centre",
        paper=EXECUTION, of=pointing_error,
    ),
    Metric(
        name="depth_error_m", title="Depth error", unit="m", level="step", better=None,
        definition="for a go whose point is on the target: the pilot's depth minus the median depth of the target's"
        " visible surface, along the optical axis",
        paper=EXECUTION, of=depth_error,
    ),
    Metric(
        name="depth_error_abs_m", title="Depth error (absolute)", unit="m", level="step", better="less",
        definition="depth_error_m without its sign",
        paper=EXECUTION, of=absolute_depth_error,
    ),
    Metric(
        name="rescaled", title="Rescaled copy", unit="share", level="step", better="less",
        definition="the pilot copied an old point. For a go, if the last five actions have a go: the point equals, to"
        " half a unit, the pixel coordinates of the newest go among them. The prompt shows a point (x, y) in pixels, as"
        " (1.28 x, 0.72 y)",
        paper=EXECUTION, of=rescaled,
    ),
    Metric(
        name="wide_rotation", title="Rotation > 90°", unit="share", level="step", better="less",
        definition="for a rotation: it is larger than 90°",
        paper=EXECUTION, of=wide_rotation,
    ),
    Metric(
        name="on_target_share", title="Points on target", unit="ratio", level="episode", better="more",
        definition="share of on_target over the steps",
        paper=EXECUTION, of=lambda flight: mean(on_target(flight)),
    ),
    Metric(
        name="median_pointing_error_deg", title="Pointing error (median)", unit="°", level="episode", better="less",
        definition="median of pointing_error_deg over the steps",
        paper=EXECUTION, of=lambda flight: median(pointing_error(flight)),
    ),
    Metric(
        name="median_depth_error_m", title="Depth error (median)", unit="m", level="episode", better=None,
        definition="median of depth_error_m over the steps",
        paper=EXECUTION, of=lambda flight: median(depth_error(flight)),
    ),
    Metric(
        name="median_depth_error_abs_m", title="Depth error (median, absolute)", unit="m", level="episode",
        better="less",
        definition="median of depth_error_abs_m over the steps",
        paper=EXECUTION, of=lambda flight: median(absolute_depth_error(flight)),
    ),
    Metric(
        name="rescaled_share", title="Rescaled copies", unit="ratio", level="episode", better="less",
        definition="share of rescaled over the steps",
        paper=EXECUTION, of=lambda flight: mean(rescaled(flight)),
    ),
    Metric(
        name="wide_rotations", title="Rotations > 90°", unit="count", level="episode", better="less",
        definition="number of steps with wide_rotation",
        paper=EXECUTION, of=lambda flight: int(sum(known_values(wide_rotation(flight)))),
    ),
)  # fmt: skip
