"""Where the drones went: the diagnostics of the trace, none of which enters the verdict. Paper, "Metrics".

Of a fleet each is the best drone's, and the paths are added up (`dronecats/judge/diagnostics.py`).
"""

from collections.abc import Callable

from dronecats.judge.incidents import contacts, estimator_resets
from dronecats.judge.judged_flight import JudgedFlight
from dronecats.judge.metrics.metric import Metric, MetricValue
from foundation.run_folder.results import Diagnostics


def min_distance_box(flight: JudgedFlight) -> float | None:
    """Return the least distance (m) from a drone to the target's box, of the frames within the cap; 0 is inside."""
    told = (row.distance_box_m for row in flight.logs.frames.values() if row.t <= flight.cap_s)
    return min((m for m in told if m is not None), default=None)


def hits(flight: JudgedFlight) -> int | None:
    """Return how often a drone flew into something within the cap; None where hits were not written."""
    found = contacts(flight.logs, flight.cap_s)
    return found.hits if found else None


def crashes(flight: JudgedFlight) -> int | None:
    """Return how many drones hit something hard enough to break; None where hits were not written."""
    found = contacts(flight.logs, flight.cap_s)
    return found.crashes if found else None


def hardest_hit(flight: JudgedFlight) -> float | None:
    """Return the fastest closing speed (m/s) of a hit; None without one."""
    found = contacts(flight.logs, flight.cap_s)
    return found.hardest_hit_mps if found else None


def contact_time(flight: JudgedFlight) -> float | None:
    """Return the seconds in contact with anything, of all drones; None where hits were not written."""
    found = contacts(flight.logs, flight.cap_s)
    return found.contact_s if found else None


def resets(flight: JudgedFlight) -> int | None:
    """Return how often the drones' estimators were reset; None where the autopilot did not send the counter."""
    return estimator_resets(flight.logs, flight.cap_s)


def _told(value: Callable[[Diagnostics], MetricValue]) -> Callable[[JudgedFlight], MetricValue]:
    """Return what reads a diagnostic, None where nothing was measured."""

    def of(flight: JudgedFlight) -> MetricValue:
        told = flight.verdict.diagnostics
        return None if told is None else value(told)

    return of


min_distance = _told(lambda told: told.min_distance_m)
start_distance = _told(lambda told: told.start_distance_m)
approach_ratio = _told(lambda told: told.approach_ratio)
first_acquisition = _told(lambda told: told.first_seen_s)
dwell = _told(lambda told: told.dwell_s)
longest_loss = _told(lambda told: told.longest_loss_s)
path = _told(lambda told: told.path_m)
flown_time = _told(lambda told: told.flown_s)

METRICS = (
    Metric(
        name="min_distance_m", title="Min. distance", unit="m", level="episode", better="less",
        definition="least distance to the target's centre",
        paper="Metrics", of=min_distance,
    ),
    Metric(
        name="min_distance_box_m", title="Min. distance to the box", unit="m", level="episode", better="less",
        definition="least distance to the nearest point of the target's box, at the frames",
        paper="Metrics", of=min_distance_box,
    ),
    Metric(
        name="start_distance_m", title="Start distance", unit="m", level="episode", better=None,
        definition="distance to the target's centre at the first sample",
        paper="Maps, Episodes and Metrics", of=start_distance,
    ),
    Metric(
        name="approach_ratio", title="Approach ratio", unit="ratio", level="episode", better="more",
        definition="1 − least distance / start distance: the fraction of it that was closed",
        paper="Metrics", of=approach_ratio,
    ),
    Metric(
        name="first_acquisition_s", title="First acquisition", unit="s", level="episode", better="less",
        definition="time of the first sample with the target in view",
        paper="Metrics", of=first_acquisition,
    ),
    Metric(
        name="dwell_s", title="Dwell", unit="s", level="episode", better="more",
        definition="time within the radius with the target in view, all of it together",
        paper="Metrics", of=dwell,
    ),
    Metric(
        name="longest_loss_s", title="Longest loss", unit="s", level="episode", better="less",
        definition="longest time without the target in view, that before its first acquisition included",
        paper="Metrics", of=longest_loss,
    ),
    Metric(
        name="path_m", title="Path", unit="m", level="episode", better=None,
        definition="length of the way along the 2 Hz trace, of a fleet all together",
        paper="Additional Results", of=path,
    ),
    Metric(
        name="flown_s", title="Flown", unit="s", level="episode", better=None,
        definition="time of the last sample within the cap",
        paper="", of=flown_time,
    ),
    Metric(
        name="hits", title="Hits", unit="count", level="episode", better="less",
        definition="times a drone flew into something; of one contact each thing counts once",
        paper="", of=hits,
    ),
    Metric(
        name="crashes", title="Crashes", unit="count", level="episode", better="less",
        definition="drones that hit something faster than 1 m/s, their feet the ground faster than 5 m/s",
        paper="", of=crashes,
    ),
    Metric(
        name="hardest_hit_mps", title="Hardest hit", unit="m/s", level="episode", better="less",
        definition="fastest speed with which a contact began",
        paper="", of=hardest_hit,
    ),
    Metric(
        name="contact_s", title="In contact", unit="s", level="episode", better="less",
        definition="time in contact with obstacles or other drones, of a fleet all together",
        paper="", of=contact_time,
    ),
    Metric(
        name="estimator_resets", title="Estimator resets", unit="count", level="episode", better="less",
        definition="times an autopilot set its estimate of yaw, position, velocity or height anew, of all drones",
        paper="", of=resets,
    ),
)  # fmt: skip
