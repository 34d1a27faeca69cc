"""The result of a rule for a record, and the benchmark's limits for records.

Source of the numbers: paper, appendix "Maps and Episodes".
"""

from dataclasses import dataclass

Bounds = tuple[float, float]  # minimum and maximum, both allowed

# share of the picture that the target's box fills when the drone at its start faces the target
OCCUPANCY_PERCENT: Bounds = (0.40, 12.0)
# The paper gives 0.40 % for the residential map. On the campus, every fixture fills less than that at the largest
# distance of 48 m: a kiosk fills 0.27 %, which is 25 × 25 pixels of the model's picture.
CAMPUS_OCCUPANCY_PERCENT: Bounds = (0.25, 12.0)
ALTITUDE_M: Bounds = (1.2, 2.2)  # above the ground under the start, on the shipped maps
DISTANCE_OFF_M, BEARING_OFF_DEG = 0.01, 0.1  # the record may differ from the measurement by at most this
LEVEL_M = 0.10  # the ground under a start may be uneven by at most this: on a kerb, a drone tips over before take-off
BODY_M = 0.45  # half the diagonal of a drone with its propellers
OFF_GROUND_M = 0.02  # a standing target, a look-alike or a path may be at most this far from the ground
WHEEL_OFF_M = 0.03  # a wheel of a target or look-alike may be at most this far from the ground
START_TO_PATH_M = 6.0  # the target's path stays this far from the start: a drone that waits at its start must fail

# Commanding episodes: a fleet starts in a square (the grid), and the target is one of four candidates
CANDIDATES = 4
NEAREST_PAIR_M: Bounds = (5.5, 11.2)
WIDEST_PAIR_M: Bounds = (18.0, 32.0)
GRID_SIDE_M, GRID_OFF_M = 2.0, 0.02  # side of the grid, and largest error of a distance between its drones
GRID_TO_TARGET_M: Bounds = (12.0, 32.0)
GRID_TO_CANDIDATES_M: Bounds = (7.0, 37.0)
SPOTTED_PX = 90  # least number of visible pixels of a candidate at 1280×720; they become 22 in the model's picture

# Height of letters in the 640 px picture (focal length 320 px). In the paper's reading probe, no model reads a plate
# (0.10 m) at 10 m, where its digits are 3.2 px high. Two models read a sign (0.136 m) at 13 m, where its letters are
# 3.35 px high, and none beyond. No model reads letters below 3.3 px.
READABLE_PX = 3.3
READING_FOCAL_PX = 320.0
FACING = 0.17  # least cosine of the angle between normal and view of an inscription: beyond 80° it looks like a line


@dataclass(frozen=True, slots=True)
class MapRules:
    """The limits that differ between maps."""

    start_distance_m: Bounds  # distance from start to target in three dimensions; only for episodes with one drone
    speed_mps: float | None = None  # speed of moving targets; None: any speed
    off_axes_deg: float = 0.0  # the least angle between the target's bearing and the map's axes
    altitude_m: Bounds = ALTITUDE_M
    occupancy_percent: Bounds = OCCUPANCY_PERCENT


RULES = {
    "residential": MapRules((15.5, 16.5), 0.3),
    "blocks": MapRules((6.0, 100.0)),
    "campus": MapRules((12.0, 48.0), 0.15, off_axes_deg=15.0, occupancy_percent=CAMPUS_OCCUPANCY_PERCENT),
}
DEFAULT_RULES = MapRules((6.0, 100.0), altitude_m=(1.0, 30.0))


@dataclass(frozen=True, slots=True)
class RuleFinding:
    """The result of one rule for one record."""

    rule: str  # the checked quantity, in a few words
    passed: bool
    measured: str  # measured value with unit
    wanted: str  # allowed values with unit
    field: str = ""  # field of the record to change

    @property
    def sentence(self) -> str:
        """Return the finding in one line, as a reason for a rejection."""
        about = f"field '{self.field}': " if self.field else ""
        return f"{about}{self.rule} is {self.measured}, but must be {self.wanted}"


def between(rule: str, value: float, limits: tuple[float, float], unit: str, digits: int = 2) -> RuleFinding:
    """Return the finding on whether a value is within limits, both included."""
    low, high = limits
    return RuleFinding(rule, low <= value <= high, f"{value:.{digits}f} {unit}", f"{low:g} … {high:g} {unit}")


def at_least(rule: str, value: float, least: float, unit: str, digits: int = 2) -> RuleFinding:
    """Return the finding on whether a value is at least `least`."""
    return RuleFinding(rule, value >= least, f"{value:.{digits}f} {unit}", f"≥ {least:g} {unit}")


def at_most(rule: str, value: float, most: float, unit: str, digits: int = 2) -> RuleFinding:
    """Return the finding on whether a value is at most `most`."""
    return RuleFinding(rule, value <= most, f"{value:.{digits}f} {unit}", f"≤ {most:g} {unit}")
