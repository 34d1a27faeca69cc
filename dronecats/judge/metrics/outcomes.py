"""How episodes end: success, and what is told beside it. Paper, "Maps, Episodes and Metrics" and "Metrics"."""

from dronecats.judge.judged_flight import JudgedFlight
from dronecats.judge.metrics.metric import Metric


def success(flight: JudgedFlight) -> bool | None:
    """Return whether a declaration qualifies (Algorithm 1); None of what is nobody's score."""
    return flight.verdict.success if flight.scored else None


def oracle_success(flight: JudgedFlight) -> bool | None:
    """Return whether the trajectory came within the radius at any time, declared or not, in view or not."""
    told = flight.verdict.diagnostics
    return None if told is None else told.oracle_success


def declared(flight: JudgedFlight) -> bool | None:
    """Return whether arrival was declared within the cap; None of what is nobody's score."""
    return flight.verdict.declarations > 0 if flight.scored else None


def navigation_error(flight: JudgedFlight) -> float | None:
    """Return the distance (m) at the decisive measurement."""
    return flight.verdict.ne_m


def declared_to_start(flight: JudgedFlight) -> float | None:
    """Return the distance at the decisive declaration over the same drone's at the start.

    Of an episode in which none qualifies the first one counts, since the figure tells who declares early; the paper
    names the decisive one only.
    """
    deciding, made = flight.verdict.deciding, flight.declarations
    one = deciding or (made[0] if made else None)
    if one is None or one.distance_m is None:
        return None
    start_m = next((drone.start_distance_m for drone in flight.verdict.drones if drone.drone == one.drone), None)
    return one.distance_m / start_m if start_m else None


def declarations(flight: JudgedFlight) -> int:
    """Return how often arrival was declared within the cap."""
    return flight.verdict.declarations


def declarations_after_cap(flight: JudgedFlight) -> int:
    """Return how often arrival was declared when it counted no more."""
    return flight.verdict.declarations_after_cap


def false_declarations(flight: JudgedFlight) -> int | None:
    """Return how many declarations do not qualify; None where one was not measured."""
    return flight.verdict.false_declarations


def declaration_precision(flight: JudgedFlight) -> float | None:
    """Return the share of the declarations that qualifies; None without any, or where one was not measured."""
    return flight.verdict.declaration_precision


def success_at_first(flight: JudgedFlight) -> bool | None:
    """Return whether the first declaration qualifies; None where that is not known."""
    return flight.verdict.success_at_first if flight.scored else None


def success_within_three(flight: JudgedFlight) -> bool | None:
    """Return whether one of the first three declarations qualifies; None where that is not known."""
    return flight.verdict.success_within_three if flight.scored else None


CRITERION, GAP = "One Success Criterion for the Whole Grid", "The Failure Is Declaration, Not Navigation"
METRICS = (
    Metric(
        name="success", title="SR", unit="share", level="episode", better="more",
        definition="one declaration within the radius of the target's centre with the target in view, until the cap",
        paper=CRITERION, of=success,
    ),
    Metric(
        name="oracle_success", title="OSR", unit="share", level="episode", better="more",
        definition="the trajectory came within the radius at some time, whatever was declared; of a fleet, a drone's",
        paper="Main Results", of=oracle_success,
    ),
    Metric(
        name="declared", title="Declared", unit="share", level="episode", better=None,
        definition="arrival was declared at least once within the cap",
        paper=GAP, of=declared,
    ),
    Metric(
        name="ne_m", title="NE", unit="m", level="episode", better="less",
        definition="distance at the first qualifying declaration, else at the last action",
        paper="Metrics", of=navigation_error,
    ),
    Metric(
        name="declared_to_start", title="Declared dist. / start dist.", unit="ratio", level="episode", better="less",
        definition="distance at the first qualifying declaration, else at the first of all, over the start distance of"
        " the drone that declared",
        paper=GAP, of=declared_to_start,
    ),
    Metric(
        name="declarations", title="Declarations", unit="count", level="episode", better=None,
        definition="declarations within the cap",
        paper="Verifier Audit", of=declarations,
    ),
    Metric(
        name="declarations_after_cap", title="After the cap", unit="count", level="episode", better="less",
        definition="declarations after the cap, which do not count",
        paper="Verifier Audit", of=declarations_after_cap,
    ),
    Metric(
        name="false_declarations", title="False declarations", unit="count", level="episode", better="less",
        definition="declarations within the cap that do not qualify",
        paper="Verifier Audit", of=false_declarations,
    ),
    Metric(
        name="declaration_precision", title="Precision", unit="ratio", level="episode", better="more",
        definition="declarations that qualify over all within the cap",
        paper="", of=declaration_precision,
    ),
    Metric(
        name="success_at_first", title="SR₁", unit="share", level="episode", better="more",
        definition="the first declaration qualifies",
        paper="Verifier Audit", of=success_at_first,
    ),
    Metric(
        name="success_within_three", title="SR₃", unit="share", level="episode", better="more",
        definition="one of the first three declarations qualifies",
        paper="", of=success_within_three,
    ),
)  # fmt: skip
