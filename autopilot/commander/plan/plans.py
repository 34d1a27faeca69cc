"""The three plans in force, and whether an uploaded item, a whole plan, or a mission at this place can be flown.

A plan is replaced as a whole, never in part: an upload that breaks off changes nothing. With a file the plans outlive
the process, as in the memory that PX4 calls dataman: missions, geofence and rally points, and the number of the
mission's item that comes next. Results of checks are MAV_MISSION_RESULT numbers.
"""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from msgspec import Meta

from autopilot.commander.plan import fence
from autopilot.commander.plan.items import (
    FENCE,
    FRAME_MISSION,
    GLOBAL_FRAMES,
    KINDS,
    MISSION,
    RALLY,
    Home,
    PlanItem,
    local_place,
)
from autopilot.estimator.estimated_state import EstimatedState
from autopilot.parameters import ParameterTable
from foundation.errors import UsageError
from foundation.mavlink import dialect
from foundation.typed_file import file_bytes, json_of, typed
from foundation.whole_file import write_text

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
# payload items that plans of ground stations carry; there is no payload here, so they are passed over
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
_KNOWN = {MISSION: NAVIGATION | IMMEDIATE, FENCE: fence.COMMANDS, RALLY: {int(dialect.MAV_CMD_NAV_RALLY_POINT)}}


def refusal(kind: int, item: PlanItem, total: int) -> int:
    """Return why one item of an upload of `total` items cannot be taken, ACCEPTED when it can."""
    if item.command not in _KNOWN[kind]:
        return UNSUPPORTED
    placed = kind != MISSION or item.command in PLACES
    if placed:
        if item.frame not in GLOBAL_FRAMES:
            return UNSUPPORTED_FRAME
        if math.isfinite(item.lat_deg) and abs(item.lat_deg) > 90.0:
            return INVALID_X
        if math.isfinite(item.lon_deg) and abs(item.lon_deg) > 180.0:
            return INVALID_Y
        if not abs(item.z) < 1e5 and item.command != TAKEOFF:
            return INVALID_Z
    elif item.frame != FRAME_MISSION and item.frame not in GLOBAL_FRAMES:
        return UNSUPPORTED_FRAME
    if item.command == JUMP and not 0 <= item.p[0] < total:
        return INVALID_PARAM1
    return ACCEPTED


def plan_refusal(kind: int, items: tuple[PlanItem, ...]) -> int:
    """Return why a complete plan cannot be taken, ACCEPTED when it can."""
    return ACCEPTED if kind != FENCE or fence.well_formed(items) else INVALID_PARAM1


def mission_failures(
    items: Sequence[PlanItem],
    state: EstimatedState,
    home: Home | None,
    parameters: ParameterTable,
    areas: Sequence[fence.FenceArea],
) -> list[str]:
    """Return why a mission cannot be flown from here: MIS_DIST_1WP, the geofence's `areas`; empty when it can."""
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
        if parameters["GF_ACTION"] and fence.breach(place, home, parameters, areas):
            return [f"waypoint {i} outside the geofence"]
    return []


CAPACITY = {MISSION: 1000, FENCE: 250, RALLY: 50}  # items
NAMES = {MISSION: "mission", FENCE: "fence", RALLY: "rally"}


Int32 = Annotated[int, Meta(gt=-(1 << 31), lt=1 << 31)]
StoredNumber = float | str  # a text for what JSON has no number for, as nan: not given


@dataclass(frozen=True, slots=True, kw_only=True)
class StoredItem:
    """An item in the file."""

    command: Int32
    frame: Int32
    p: tuple[StoredNumber, StoredNumber, StoredNumber, StoredNumber]
    x: Int32
    y: Int32
    z: StoredNumber
    autocontinue: Int32

    @property
    def item(self) -> PlanItem:
        """The item that is flown. Raises ValueError for a text that is no number."""
        a, b, c, d = (float(value) for value in self.p)
        return PlanItem(self.command, self.frame, (a, b, c, d), self.x, self.y, float(self.z), self.autocontinue)


@dataclass(frozen=True, slots=True, kw_only=True)
class StoredPlans:
    """The file of the plans in force."""

    mission: tuple[StoredItem, ...] = ()
    fence: tuple[StoredItem, ...] = ()
    rally: tuple[StoredItem, ...] = ()
    current: int = 0  # the mission's item that comes next


class Plans:
    """Items by MAV_MISSION_TYPE; `version` counts the replacements.

    What is put in force is kept in `file` (JSON), if given; `unsaved` is the reason why the last change could not be,
    None while all are. Raises UsageError when the file cannot be read or holds a plan that could not be uploaded.
    """

    def __init__(self, file: Path | None = None) -> None:
        self.items: dict[int, tuple[PlanItem, ...]] = dict.fromkeys(KINDS, ())
        self.version = 0
        self.current = 0  # the mission's item that comes next, as last remembered
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
        """Put a plan in force. Returns whether it differs from the one before."""
        if _bits(items) == _bits(self.items[kind]):
            return False
        self.items[kind] = items
        self.version += 1
        if kind == MISSION:
            self.current = 0
        self._save()
        return True

    def remember(self, current: int) -> None:
        """Keep the number of the mission's item that comes next."""
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
        except (UsageError, ValueError) as error:  # a text that is no number
            raise UsageError(f"{error}; correct the file or delete it.") from error
        self.current = stored.current if 0 <= stored.current < len(self.mission) else 0

    def _save(self) -> None:
        if self._file is None:
            return
        content = {name: [_entry(item) for item in self.items[kind]] for kind, name in NAMES.items()}
        try:
            write_text(self._file, json.dumps({**content, "current": self.current}, indent=1) + "\n")
            self.unsaved = None
        except OSError as error:  # a full disk is no reason to stop flying
            self.unsaved = error.strerror or "the disk refused"


def _entry(item: PlanItem) -> dict[str, Any]:
    """Return an item for the file. Numbers that JSON does not know (nan: not given) are texts."""
    numbers = [value if abs(value) < float("inf") else str(value) for value in (*item.p, item.z)]
    return {
        "command": item.command, "frame": item.frame, "p": numbers[:4], "x": item.x, "y": item.y, "z": numbers[4],
        "autocontinue": item.autocontinue,
    }  # fmt: skip


def _bits(items: tuple[PlanItem, ...]) -> str:
    return repr(items)  # nan parameters are equal as text, and unequal as numbers
