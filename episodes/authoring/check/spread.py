"""Rules about a suite: drawn so evenly that nobody who does not look can know where the targets are.

They hold for the episodes that ship as `all`, and for each cell of a map that has records enough. What a pilot that
flies straight on without looking would pass is measured of each record (`layout.straight`) and counted here, so that
the rule names no pilot.
"""

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Sequence

from episodes.authoring.check.finding import RuleFinding, at_least, at_most, between
from episodes.authoring.check.framing import HALF_VIEW_DEG
from episodes.authoring.check.layout import Layout
from episodes.authoring.check.limits import SPOTTED_PX

ENOUGH = 5  # records of a cell on a map, for a rule about their spread
OFF_CENTRE_DEG = 15.0  # at least half of the targets in sight stand farther from the nose than this
UNEVEN = 0.25  # largest difference (Kolmogorov's) of a cell's ten draws from an even spread
CAMPUS_M = ((12.0, 14.0), (44.0, 48.0))  # where the nearest and the farthest start on campus lie
HEIGHTS_M = ((1.2, 1.35), (2.05, 2.2))  # where the lowest and the highest start lie
ROWS = 0.05  # of the picture's height, from the uppermost to the lowest target in a suite
# Of ten in sight 16 m off, a flight straight on passes within 5 m of whatever stands up to 14° beside its way: of the
# picture's usable 74° that is more than a third, so no spread leaves fewer than three to every heading.
AHEAD = {True: 2, False: 1}  # of ten in sight or hidden, passed by flying straight on as the record faces …
ANY_HEADING = {True: 4, False: 2}  # … and on the one heading from the nose that passes most


def rules(layouts: Sequence[Layout]) -> Iterator[RuleFinding]:
    """Yield the findings about a suite."""
    seeds = Counter(one.seed for one in layouts)
    twice = [one.id for one in layouts if seeds[one.seed] > 1]
    yield RuleFinding("the seeds", not twice, ", ".join(twice[:4]) or "all distinct", "one for each record", "seed")
    cells: dict[tuple[str, str], list[Layout]] = defaultdict(list)
    for one in layouts:
        cells[one.map, one.cell].append(one)
    for (place, cell), found in sorted(cells.items()):
        if len(found) >= ENOUGH:
            yield from of_cell(f"{place} {cell}", found)
    flown = [one for one in layouts if one.cell != "commanding"]
    if len(flown) >= 4 * ENOUGH:
        yield from of_suite(flown)


def of_suite(flown: Sequence[Layout]) -> Iterator[RuleFinding]:
    """Yield the findings about the one-drone records together."""
    campus = [one.distance_m for one in flown if one.map == "campus"]
    if campus:
        yield between("the nearest start on campus", min(campus), CAMPUS_M[0], "m")
        yield between("the farthest start on campus", max(campus), CAMPUS_M[1], "m")
    heights = [one.height_m for one in flown]
    yield between("the lowest start", min(heights), HEIGHTS_M[0], "m")
    yield between("the highest start", max(heights), HEIGHTS_M[1], "m")
    rows = [one.row for one in flown if one.row is not None]
    if rows:
        yield at_least(
            "the rows of the picture from the uppermost to the lowest target", max(rows) - min(rows), ROWS, ""
        )


def of_cell(name: str, found: Sequence[Layout]) -> Iterator[RuleFinding]:
    """Yield the findings about the records of one cell on one map."""
    if found[0].fewest_px is not None:
        least = min(one.fewest_px or 0 for one in found)
        yield at_least(
            f"{name}: the least that a drone sees of a candidate past the others", least, SPOTTED_PX, "px", 0
        )
        return
    in_sight = found[0].column is not None
    if in_sight:
        off = sum(abs(one.off_deg) > OFF_CENTRE_DEG for one in found)
        yield at_least(f"{name}: targets more than {OFF_CENTRE_DEG:g}° off the nose", off, len(found) / 2, "", 0)
        shares = [one.column for one in found if one.column is not None]
        rule = f"{name}: how uneven the columns of the targets are"
    else:
        shares = [(one.off_deg % 360.0 - HALF_VIEW_DEG) / (360.0 - 2.0 * HALF_VIEW_DEG) for one in found]
        rule = f"{name}: how uneven the yaws are over those that hide the target"
    yield at_most(rule, unevenness(shares), UNEVEN, "")
    ahead, most = passed(found)
    limits = passable(in_sight, len(found))
    yield at_most(f"{name}: records that a flight straight on passes", ahead, limits[0], "", 0)
    yield at_most(f"{name}: records that a straight flight passes on any one heading", most, limits[1], "", 0)


def passed(found: Sequence[Layout]) -> tuple[int, int]:
    """Return how many records a flight straight on passes, and how many one on the heading that passes most."""
    counted = Counter(heading for one in found for heading in one.straight_deg)
    return counted[0], max(counted.values(), default=0)


def passable(in_sight: bool, count: int) -> tuple[float, float]:
    """Return how many of so many records of a cell a straight flight may pass: straight on, and on any one heading."""
    return AHEAD[in_sight] * count / 10.0, ANY_HEADING[in_sight] * count / 10.0


def unevenness(shares: Iterable[float]) -> float:
    """Return the largest difference between the shares' distribution and an even one on 0 … 1 (Kolmogorov's D)."""
    ordered = sorted(shares)
    n = len(ordered)
    return max(max((k + 1) / n - u, u - k / n) for k, u in enumerate(ordered))
