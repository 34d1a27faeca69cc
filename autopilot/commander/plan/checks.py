"""Whether an uploaded item, a whole plan, or a mission at this place can be flown.

Results are MAV_MISSION_RESULT numbers.
"""

import math
from collections.abc import Sequence

from autopilot.commander.home import Home
from autopilot.commander.plan import fence
from autopilot.commander.plan.items import FENCE, FRAME_MISSION, GLOBAL_FRAMES, MISSION, RALLY, PlanItem, local_place
from autopilot.estimator.estimated_state import EstimatedState
from autopilot.parameters import ParameterTable
from foundation.mavlink import dialect

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
