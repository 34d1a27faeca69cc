"""Plans (missions, geofences and rally points): their items, the checks of uploads, and the plan file.

The geofence has polygons, circles, and a cylinder around home (GF_MAX_HOR_DIST, GF_MAX_VER_DIST). As on PX4, a position
must be outside all exclusion areas and, if there are inclusion areas, inside one of them.

A plan is always replaced as a whole: an incomplete upload changes nothing. The file keeps the plans and the number of
the next mission item across restarts, as PX4's dataman does. The checks of uploads return MAV_MISSION_RESULT
numbers.
"""

import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

from msgspec import Meta

from autopilot.estimator.estimated_state import EstimatedState
from autopilot.parameters import ParameterTable
from foundation.errors import UsageError
from foundation.files import write_text
from foundation.frames import Vec3, geodetic_to_ned
from foundation.mavlink import dialect
from foundation.polygon import Point, contains
from foundation.typed_file import file_bytes, json_of, typed

MOVED_HORIZONTAL_M = 1.0
MOVED_VERTICAL_M = 0.5


@dataclass(frozen=True, slots=True)
class Home:
    """The position to which the vehicle returns."""

    position_ned: Vec3  # m, local frame
    yaw: float  # rad
    lat_deg: float
    lon_deg: float
    alt_m: float  # m above mean sea level
    manual: bool = False  # a client or a mission has given the position, so that home does not follow the vehicle


def home_at(state: EstimatedState, position_ned: Vec3 | None = None) -> Home | None:
    """Return a home at a local position (m), by default the vehicle's; None while the global position is unknown."""
    if not state.global_valid:
        return None
    place = position_ned or state.position_ned
    return Home(place, state.yaw, *state.geodetic(place), manual=position_ned is not None)


def moved(home: Home, state: EstimatedState) -> bool:
    """Return whether the vehicle is clearly away from home. If it is disarmed, the commander then renews home."""
    n, e, z = state.position_ned
    away = math.hypot(n - home.position_ned[0], e - home.position_ned[1])
    return away > MOVED_HORIZONTAL_M or abs(z - home.position_ned[2]) > MOVED_VERTICAL_M


MISSION, FENCE, RALLY = 0, 1, 2  # MAV_MISSION_TYPE
KINDS = (MISSION, FENCE, RALLY)
NO_COORDINATE = (1 << 31) - 1  # INT32_MAX in x or y: no position
DEGREES = 1e-7

FRAME_MISSION = int(dialect.MAV_FRAME_MISSION)
ABOVE_SEA = frozenset({int(dialect.MAV_FRAME_GLOBAL), int(dialect.MAV_FRAME_GLOBAL_INT)})
ABOVE_HOME = frozenset({int(dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT), int(dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT)})
GLOBAL_FRAMES = ABOVE_SEA | ABOVE_HOME


@dataclass(frozen=True, slots=True)
class PlanItem:
    """One item. x and y are the integers of the upload, so that a download returns exactly the same values."""

    command: int  # MAV_CMD
    frame: int  # MAV_FRAME
    p: tuple[float, float, float, float]  # param1 … param4
    x: int  # 1e-7 deg of latitude in the global frames
    y: int  # 1e-7 deg of longitude
    z: float  # m, above sea level or above home, according to `frame`
    autocontinue: int = 1

    @property
    def lat_deg(self) -> float:
        """Latitude; nan if the item has no position."""
        return math.nan if self._nowhere else self.x * DEGREES

    @property
    def lon_deg(self) -> float:
        """Longitude; nan if the item has no position."""
        return math.nan if self._nowhere else self.y * DEGREES

    @property
    def _nowhere(self) -> bool:
        # in landings and take-offs, clients send (0, 0) for the present position
        return NO_COORDINATE in (self.x, self.y) or (self.x == 0 and self.y == 0)


def horizontal(lat_deg: float, lon_deg: float, state: EstimatedState) -> tuple[float, float]:
    """Return a latitude and longitude as (north, east) in m, local frame; both nan if one of them is not finite."""
    if not (math.isfinite(lat_deg) and math.isfinite(lon_deg)):
        return (math.nan, math.nan)
    north, east, _ = geodetic_to_ned(state.origin_lat_deg, state.origin_lon_deg, 0.0, lat_deg, lon_deg, 0.0)
    return (north, east)


def local_position(
    state: EstimatedState, home: Home | None, lat_deg: float, lon_deg: float, alt_m: float, *, above_home: bool
) -> Vec3:
    """Return a place as a local position (m, NED). `above_home`: the altitude is above home, not above sea level.

    A coordinate is nan if it is not given. Down is also nan if `above_home` is true and home is unknown.
    """
    north, east = horizontal(lat_deg, lon_deg, state)
    if not abs(alt_m) < 1e5:
        return (north, east, math.nan)
    if above_home:
        return (north, east, home.position_ned[2] - alt_m if home is not None else math.nan)
    return (north, east, state.origin_alt_m - alt_m)


def local_place(item: PlanItem, state: EstimatedState, home: Home | None) -> Vec3:
    """Return the item's `local_position`. If the item's frame is not global, all coordinates are nan."""
    if item.frame not in GLOBAL_FRAMES:
        return (math.nan, math.nan, math.nan)
    return local_position(state, home, item.lat_deg, item.lon_deg, item.z, above_home=item.frame in ABOVE_HOME)


RETURN_POINT = int(dialect.MAV_CMD_NAV_FENCE_RETURN_POINT)
POLYGON_IN = int(dialect.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION)
POLYGON_OUT = int(dialect.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION)
CIRCLE_IN = int(dialect.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION)
CIRCLE_OUT = int(dialect.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION)
POLYGONS = frozenset({POLYGON_IN, POLYGON_OUT})
FENCE_COMMANDS = POLYGONS | {RETURN_POINT, CIRCLE_IN, CIRCLE_OUT}
MOST_VERTICES = 250


@dataclass(frozen=True, slots=True)
class FenceArea:
    """A polygon (vertices) or a circle (a centre and a radius)."""

    inclusion: bool
    vertices: tuple[Point, ...]
    radius: float = 0.0  # m, circles only

    def contains(self, north: float, east: float) -> bool:
        """Return whether a point is inside."""
        if len(self.vertices) == 1:
            centre = self.vertices[0]
            return math.hypot(north - centre[0], east - centre[1]) < self.radius
        return contains(self.vertices, (north, east))


def well_formed(items: tuple[PlanItem, ...]) -> bool:
    """Return whether each polygon's vertices are consecutive and have their number (3 … MOST_VERTICES) as param1."""
    i = 0
    while i < len(items):
        item = items[i]
        if item.command not in POLYGONS:
            i += 1
            continue
        count = item.p[0]
        if not 3 <= count <= MOST_VERTICES or i + int(count) > len(items):
            return False
        if any((v.command, v.p[0]) != (item.command, count) for v in items[i : i + int(count)]):
            return False
        i += int(count)
    return True


def areas(items: tuple[PlanItem, ...], state: EstimatedState) -> tuple[FenceArea, ...]:
    """Return the areas of a `well_formed` fence, in the local frame."""
    result: list[FenceArea] = []
    i = 0
    while i < len(items):
        item = items[i]
        count = int(item.p[0]) if item.command in POLYGONS else 1
        if item.command != RETURN_POINT:
            # in a fence (0, 0) is a real position, but `lat_deg` and `lon_deg` would be nan
            points = tuple(horizontal(v.x * 1e-7, v.y * 1e-7, state) for v in items[i : i + count])
            radius = item.p[0] if item.command not in POLYGONS else 0.0
            result.append(FenceArea(item.command in (POLYGON_IN, CIRCLE_IN), points, radius))
        i += count
    return tuple(result)


def breach(place_ned: Vec3, home: Home | None, p: ParameterTable, areas: Iterable[FenceArea]) -> str:
    """Return the limit that a local position breaks: 'height', 'distance' or 'area'; empty if none."""
    if home is not None:
        n, e, z = home.position_ned
        if 0.0 < p["GF_MAX_VER_DIST"] < z - place_ned[2]:
            return "height"
        if 0.0 < p["GF_MAX_HOR_DIST"] < math.hypot(place_ned[0] - n, place_ned[1] - e):
            return "distance"
    inclusions = [area for area in areas if area.inclusion]
    exclusions = [area for area in areas if not area.inclusion]
    if inclusions and not any(area.contains(place_ned[0], place_ned[1]) for area in inclusions):
        return "area"
    return "area" if any(area.contains(place_ned[0], place_ned[1]) for area in exclusions) else ""


ACCEPTED = int(dialect.MAV_MISSION_ACCEPTED)
UNSUPPORTED, UNSUPPORTED_FRAME = int(dialect.MAV_MISSION_UNSUPPORTED), int(dialect.MAV_MISSION_UNSUPPORTED_FRAME)
INVALID_PARAM1 = int(dialect.MAV_MISSION_INVALID_PARAM1)
INVALID_X, INVALID_Y = int(dialect.MAV_MISSION_INVALID_PARAM5_X), int(dialect.MAV_MISSION_INVALID_PARAM6_Y)
INVALID_Z = int(dialect.MAV_MISSION_INVALID_PARAM7)

WAYPOINT, TAKEOFF, LAND = (
    int(dialect.MAV_CMD_NAV_WAYPOINT), int(dialect.MAV_CMD_NAV_TAKEOFF), int(dialect.MAV_CMD_NAV_LAND)
)  # fmt: skip
RETURN, DELAY = int(dialect.MAV_CMD_NAV_RETURN_TO_LAUNCH), int(dialect.MAV_CMD_NAV_DELAY)
LOITER, LOITER_TIME = int(dialect.MAV_CMD_NAV_LOITER_UNLIM), int(dialect.MAV_CMD_NAV_LOITER_TIME)
CHANGE_SPEED, JUMP, SET_HOME = (
    int(dialect.MAV_CMD_DO_CHANGE_SPEED), int(dialect.MAV_CMD_DO_JUMP), int(dialect.MAV_CMD_DO_SET_HOME)
)  # fmt: skip
PLACES = frozenset({WAYPOINT, TAKEOFF, LAND, LOITER, LOITER_TIME})
NAVIGATION = PLACES | {RETURN, DELAY}
# payload items in the plans of ground stations; this vehicle has no payload, so it skips them
PAYLOAD = frozenset(
    int(getattr(dialect, f"MAV_CMD_{name}"))
    for name in (
        "DO_SET_ROI_LOCATION", "DO_SET_ROI_NONE", "DO_SET_ROI", "DO_DIGICAM_CONTROL", "DO_MOUNT_CONTROL",
        "DO_MOUNT_CONFIGURE", "DO_SET_CAM_TRIGG_DIST", "DO_SET_SERVO", "DO_SET_ACTUATOR", "DO_SET_RELAY",
        "DO_GIMBAL_MANAGER_PITCHYAW", "DO_GIMBAL_MANAGER_CONFIGURE", "IMAGE_START_CAPTURE", "IMAGE_STOP_CAPTURE",
        "VIDEO_START_CAPTURE", "VIDEO_STOP_CAPTURE", "SET_CAMERA_MODE", "SET_CAMERA_ZOOM", "SET_CAMERA_FOCUS",
        "DO_LAND_START", "DO_GRIPPER",
    )
)  # fmt: skip
IMMEDIATE = PAYLOAD | {CHANGE_SPEED, JUMP, SET_HOME}
_COMMANDS = {MISSION: NAVIGATION | IMMEDIATE, FENCE: FENCE_COMMANDS, RALLY: {int(dialect.MAV_CMD_NAV_RALLY_POINT)}}


def refusal(kind: int, item: PlanItem, total: int) -> int:
    """Return the reason to refuse one item of an upload of `total` items; ACCEPTED if there is none."""
    if item.command not in _COMMANDS[kind]:
        return UNSUPPORTED
    placed = kind != MISSION or item.command in PLACES
    if placed:
        if item.frame not in GLOBAL_FRAMES:
            return UNSUPPORTED_FRAME
        if item.x != NO_COORDINATE and abs(item.x * DEGREES) > 90.0:
            return INVALID_X
        if item.y != NO_COORDINATE and abs(item.y * DEGREES) > 180.0:
            return INVALID_Y
        if not abs(item.z) < 1e5 and item.command != TAKEOFF:
            return INVALID_Z
    elif item.frame != FRAME_MISSION and item.frame not in GLOBAL_FRAMES:
        return UNSUPPORTED_FRAME
    if item.command == JUMP and not 0 <= item.p[0] < total:
        return INVALID_PARAM1
    return ACCEPTED


def plan_refusal(kind: int, items: tuple[PlanItem, ...]) -> int:
    """Return the reason to refuse a complete plan; ACCEPTED if there is none."""
    return ACCEPTED if kind != FENCE or well_formed(items) else INVALID_PARAM1


def mission_failures(
    items: Sequence[PlanItem],
    state: EstimatedState,
    home: Home | None,
    parameters: ParameterTable,
    areas: Sequence[FenceArea],
) -> list[str]:
    """Return why a mission cannot be flown from here; empty if it can. Checks MIS_DIST_1WP and the geofence `areas`."""
    if not items:
        return ["no valid mission"]
    places = [(i, local_place(item, state, home)) for i, item in enumerate(items) if item.command in PLACES]
    places = [(i, place) for i, place in places if math.isfinite(place[0])]
    if not places:
        return []
    farthest = float(parameters["MIS_DIST_1WP"])
    start = home.position_ned if home is not None else state.position_ned
    first = places[0][1]
    if 0.0 < farthest < math.hypot(first[0] - start[0], first[1] - start[1]):
        return ["first waypoint too far away"]
    for i, place in places:
        if parameters["GF_ACTION"] and breach(place, home, parameters, areas):
            return [f"waypoint {i} outside the geofence"]
    return []


CAPACITY = {MISSION: 1000, FENCE: 250, RALLY: 50}  # largest number of items in a plan
NAMES = {MISSION: "mission", FENCE: "fence", RALLY: "rally"}


Int32 = Annotated[int, Meta(ge=-(1 << 31), le=(1 << 31) - 1)]
StoredNumber = float | str  # a text if JSON has no such number, for example "nan" for a value that is not given


@dataclass(frozen=True, slots=True, kw_only=True)
class StoredItem:
    """A PlanItem in the file."""

    command: Int32
    frame: Int32
    p: tuple[StoredNumber, StoredNumber, StoredNumber, StoredNumber]
    x: Int32
    y: Int32
    z: StoredNumber
    autocontinue: Int32

    @property
    def item(self) -> PlanItem:
        """The stored item as a PlanItem. Raises ValueError for a text that is not a number."""
        a, b, c, d = (float(value) for value in self.p)
        return PlanItem(self.command, self.frame, (a, b, c, d), self.x, self.y, float(self.z), self.autocontinue)


@dataclass(frozen=True, slots=True, kw_only=True)
class StoredPlans:
    """The content of the plan file."""

    mission: tuple[StoredItem, ...] = ()
    fence: tuple[StoredItem, ...] = ()
    rally: tuple[StoredItem, ...] = ()
    current: int = 0  # number of the next mission item


class Plans:
    """The plans by MAV_MISSION_TYPE; `version` counts the replacements.

    Every change is saved in `file` (JSON), if given. `unsaved` is the reason why the last save failed, or None.
    Raises UsageError if the file cannot be read or contains a plan that an upload would not accept.
    """

    def __init__(self, file: Path | None = None) -> None:
        self.items: dict[int, tuple[PlanItem, ...]] = dict.fromkeys(KINDS, ())
        self.version = 0
        self.current = 0  # number of the next mission item, as of the last `remember`
        self.unsaved: str | None = None
        self._file = file
        if file is not None and file.exists():
            self._load(file)

    @property
    def mission(self) -> tuple[PlanItem, ...]:
        return self.items[MISSION]

    @property
    def fence(self) -> tuple[PlanItem, ...]:
        return self.items[FENCE]

    @property
    def rally(self) -> tuple[PlanItem, ...]:
        return self.items[RALLY]

    def replace(self, kind: int, items: tuple[PlanItem, ...]) -> bool:
        """Replace a plan. Returns whether the new plan differs from the old one."""
        if _bits(items) == _bits(self.items[kind]):
            return False
        self.items[kind] = items
        self.version += 1
        if kind == MISSION:
            self.current = 0
        self._save()
        return True

    def remember(self, current: int) -> None:
        """Store the number of the next mission item."""
        current = current if 0 <= current < len(self.mission) else 0
        if current != self.current:
            self.current = current
            self._save()

    def _load(self, file: Path) -> None:
        where = f"The plan file {file}"
        try:
            stored = typed(json_of(file_bytes(file, where), where), StoredPlans, where)
            for kind, name in NAMES.items():
                items = tuple(entry.item for entry in getattr(stored, name))
                results = [refusal(kind, item, len(items)) for item in items] + [plan_refusal(kind, items)]
                if len(items) > CAPACITY[kind] or any(result != ACCEPTED for result in results):
                    raise UsageError(f"{where}: the {name} could not be flown")
                self.items[kind] = items
        except (UsageError, ValueError) as error:  # ValueError: a text is not a number
            raise UsageError(f"{error}. Correct the file or delete it.") from error
        self.current = stored.current if 0 <= stored.current < len(self.mission) else 0

    def _save(self) -> None:
        if self._file is None:
            return
        content = {name: [_entry(item) for item in self.items[kind]] for kind, name in NAMES.items()}
        try:
            write_text(self._file, json.dumps({**content, "current": self.current}, indent=1) + "\n")
            self.unsaved = None
        except OSError as error:  # a full disk must not stop the flight
            self.unsaved = error.strerror or "the disk reported an error"


def _entry(item: PlanItem) -> dict[str, Any]:
    """Return an item for the file. Numbers that JSON lacks (nan) become texts."""
    numbers = [value if abs(value) < float("inf") else str(value) for value in (*item.p, item.z)]
    return {**asdict(item), "p": numbers[:4], "z": numbers[4]}


def _bits(items: tuple[PlanItem, ...]) -> str:
    return repr(items)  # nan parameters are equal as text, but not as numbers
