"""Metrics of outcome and trajectory: success and declarations, distances, times, path and contacts.

Source: paper, "Maps, Episodes and Metrics" and "Metrics". For a fleet, most trajectory metrics are the best value of
all drones (`fleet_diagnostics`); path, contacts and resets are sums. No metric affects the verdict.
"""

from dronecats.judge.diagnostics import estimator_resets
from dronecats.judge.judged_flight import JudgedFlight
from dronecats.judge.metrics.metric import Metric, verdict_value


def oracle_success(flight: JudgedFlight) -> bool | None:
    """Return whether a drone was ever within the radius, with or without a declaration or a view of the target."""
    diagnostics = flight.verdict.diagnostics
    return diagnostics.oracle_success if diagnostics else None


def success_at_first(flight: JudgedFlight) -> bool | None:
    """Return whether the first declaration qualifies; None if that is unknown."""
    return flight.verdict.success_at_first if flight.scored else None


def declared_to_start(flight: JudgedFlight) -> float | None:
    """Return the distance at the first declaration that qualifies, divided by the start distance of the same drone.

    If no declaration qualifies, the first one counts, so the metric also shows declarations too far from the target.
    The paper defines the metric only for a declaration that qualifies.
    """
    made = flight.declarations
    declaration = flight.verdict.deciding or (made[0] if made else None)
    if declaration is None or declaration.distance_m is None:
        return None
    start_m = next((d.start_distance_m for d in flight.verdict.drones if d.drone == declaration.drone), None)
    return declaration.distance_m / start_m if start_m else None


def min_distance_box(flight: JudgedFlight) -> float | None:
    """Return the least distance (m) of a drone from the target's box at the frames within the cap; 0 in the box."""
    distances = (row.distance_box_m for row in flight.logs.frames.values() if row.t <= flight.cap_s)
    return min((distance_m for distance_m in distances if distance_m is not None), default=None)


# sections of the paper
CRITERION, GAP = "One Success Criterion for the Whole Grid", "The Failure Is Declaration, Not Navigation"
METRICS = (
    Metric(
        name="success", title="SR", unit="share", level="episode", better="more",
        definition="a declaration within the cap was within the radius of the target's centre, with the target in view",
        paper=CRITERION, of=lambda flight: flight.success,
    ),
    Metric(
        name="oracle_success", title="OSR", unit="share", level="episode", better="more",
        definition="a drone came within the radius at some time, with or without a declaration",
        paper="Main Results", of=oracle_success,
    ),
    Metric(
        name="declared", title="Declared", unit="share", level="episode", better=None,
        definition="at least one declaration was made within the cap",
        paper=GAP, of=lambda flight: flight.verdict.declarations > 0 if flight.scored else None,
    ),
    Metric(
        name="ne_m", title="NE", unit="m", level="episode", better="less",
        definition="distance at the first declaration that qualifies; without one, at the last action",
        paper="Metrics", of=lambda flight: flight.verdict.ne_m,
    ),
    Metric(
        name="declared_to_start", title="Declared dist. / start dist.", unit="ratio", level="episode", better="less",
        definition="distance at the first declaration that qualifies (without one, at the first declaration), divided"
        " by the start distance of the same drone",
        paper=GAP, of=declared_to_start,
    ),
    Metric(
        name="declarations", title="Declarations", unit="count", level="episode", better=None,
        definition="number of declarations within the cap",
        paper="Verifier Audit", of=lambda flight: flight.verdict.declarations,
    ),
    Metric(
        name="declarations_after_cap", title="After the cap", unit="count", level="episode", better="less",
        definition="number of declarations after the cap; they do not count",
        paper="Verifier Audit", of=lambda flight: flight.verdict.declarations_after_cap,
    ),
    Metric(
        name="false_declarations", title="False declarations", unit="count", level="episode", better="less",
        definition="number of declarations within the cap that do not qualify",
        paper="Verifier Audit", of=lambda flight: flight.verdict.false_declarations,
    ),
    Metric(
        name="declaration_precision", title="Precision", unit="ratio", level="episode", better="more",
        definition="share of the declarations within the cap that qualify",
        paper="", of=lambda flight: flight.verdict.declaration_precision,
    ),
    Metric(
        name="success_at_first", title="SR₁", unit="share", level="episode", better="more",
        definition="the first declaration qualifies",
        paper="Verifier Audit", of=success_at_first,
    ),
    Metric(
        name="success_within_three", title="SR₃", unit="share", level="episode", better="more",
        definition="one of the first three declarations qualifies",
        paper="", of=lambda flight: flight.verdict.success_within_three if flight.scored else None,
    ),
    Metric(
        name="min_distance_m", title="Min. distance", unit="m", level="episode", better="less",
        definition="smallest distance to the target's centre",
        paper="Metrics", of=verdict_value("diagnostics", "min_distance_m"),
    ),
    Metric(
        name="min_distance_box_m", title="Min. distance to the box", unit="m", level="episode", better="less",
        definition="smallest distance to the target's box at the times of the images",
        paper="Metrics", of=min_distance_box,
    ),
    Metric(
        name="start_distance_m", title="Start distance", unit="m", level="episode", better=None,
        definition="distance to the target's centre at the first sample",
        paper="Maps, Episodes and Metrics", of=verdict_value("diagnostics", "start_distance_m"),
    ),
    Metric(
        name="approach_ratio", title="Approach ratio", unit="ratio", level="episode", better="more",
        definition="1 − smallest distance / start distance",
        paper="Metrics", of=verdict_value("diagnostics", "approach_ratio"),
    ),
    Metric(
        name="first_acquisition_s", title="First acquisition", unit="s", level="episode", better="less",
        definition="time of the first sample with the target in view",
        paper="Metrics", of=verdict_value("diagnostics", "first_seen_s"),
    ),
    Metric(
        name="dwell_s", title="Dwell", unit="s", level="episode", better="more",
        definition="total time within the radius with the target in view",
        paper="Metrics", of=verdict_value("diagnostics", "dwell_s"),
    ),
    Metric(
        name="longest_loss_s", title="Longest loss", unit="s", level="episode", better="less",
        definition="longest time without the target in view, including the time before it is first in view",
        paper="Metrics", of=verdict_value("diagnostics", "longest_loss_s"),
    ),
    Metric(
        name="path_m", title="Path", unit="m", level="episode", better=None,
        definition="length of the path along the 2 Hz poses; for a fleet, the sum",
        paper="Additional Results", of=verdict_value("diagnostics", "path_m"),
    ),
    Metric(
        name="flown_s", title="Flown", unit="s", level="episode", better=None,
        definition="time of the last sample within the cap",
        paper="", of=verdict_value("diagnostics", "flown_s"),
    ),
    Metric(
        name="hits", title="Hits", unit="count", level="episode", better="less",
        definition="number of times that a drone began to touch something; if it touches several things in one contact,"
        " each thing counts once. A contact that begins below 0.15 m/s counts if it lasts for 0.5 s. Standing does not"
        " count",
        paper="", of=verdict_value("contacts", "hits"),
    ),
    Metric(
        name="crashes", title="Crashes", unit="count", level="episode", better="less",
        definition="number of drones that hit something at more than 1 m/s, or landed on their feet at more than 5 m/s",
        paper="", of=verdict_value("contacts", "crashes"),
    ),
    Metric(
        name="hardest_hit_mps", title="Hardest hit", unit="m/s", level="episode", better="less",
        definition="highest speed at the start of a contact",
        paper="", of=verdict_value("contacts", "hardest_hit_mps"),
    ),
    Metric(
        name="contact_s", title="In contact", unit="s", level="episode", better="less",
        definition="time in contact with obstacles or other drones; for a fleet, the sum",
        paper="", of=verdict_value("contacts", "contact_s"),
    ),
    Metric(
        name="estimator_resets", title="Estimator resets", unit="count", level="episode", better="less",
        definition="number of resets of the estimate of yaw, position, velocity or height; for a fleet, the sum",
        paper="", of=lambda flight: estimator_resets(flight.logs, flight.cap_s),
    ),
)  # fmt: skip
