"""The autopilot's own geofence: the last wall, behind the envelope that our own link keeps."""

from collections.abc import Mapping

from foundation.mavlink import dialect
from hil.link.link import Link
from hil.link.parameters import Value
from hil.preflight.row import Change, Finding, Row

PARAMETERS = ("GF_ACTION", "GF_MAX_HOR_DIST", "GF_MAX_VER_DIST", "RTL_RETURN_ALT")
ACTIONS = {0: "nothing", 1: "a warning", 2: "Hold", 3: "Return", 4: "Terminate", 5: "Land"}
RADIUS = 150.0  # m from home: outside the 100 m of the envelope, so that it speaks only when that has failed
HEIGHT = 120.0  # m: the ceiling of open airspace in the EU and the USA, and above RTL_RETURN_ALT's 60 m
ASK_US, TRIES = 700_000, 3  # µs of vehicle time


def plan_size(link: Link) -> int | None:
    """Return how many points the uploaded fence has, None when the autopilot does not tell."""
    counts: list[int] = []

    def hear(message: dialect.MAVLink_message) -> None:
        if message.get_msgId() != dialect.MAVLINK_MSG_ID_MISSION_COUNT or message.get_srcSystem() != link.system:
            return
        if message.mission_type == dialect.MAV_MISSION_TYPE_FENCE:
            counts.append(int(message.count))

    link.listeners.append(hear)
    try:
        for _ in range(TRIES):
            link.send(
                dialect.MAVLink_mission_request_list_message(
                    link.system, link.component, dialect.MAV_MISSION_TYPE_FENCE
                )
            )
            end_us = link.time_us + ASK_US
            while not counts and link.time_us < end_us:
                link.tick()
            if counts:
                _over(link)
                return counts[0]
        return None
    finally:
        link.listeners.remove(hear)


def _over(link: Link) -> None:
    """End the transfer that asking for the count has opened: the points themselves are not wanted."""
    link.send(
        dialect.MAVLink_mission_ack_message(
            link.system, link.component, dialect.MAV_MISSION_OPERATION_CANCELLED, dialect.MAV_MISSION_TYPE_FENCE
        )
    )


def findings(values: Mapping[str, Value | None], points: int | None) -> list[Finding]:
    """Return whether a breach is acted on, where the walls are, and whether a return stays within them."""
    action, radius, height = values.get("GF_ACTION"), values.get("GF_MAX_HOR_DIST"), values.get("GF_MAX_VER_DIST")
    climb = values.get("RTL_RETURN_ALT")
    return [_action(action), _walls(radius, points), _height(height, climb), _return(climb, height)]


def _action(value: Value | None) -> Finding:
    if value is None:
        return Finding(Row("GF_ACTION", None, "the autopilot does not tell it"))
    does = ACTIONS.get(int(value), "an unknown action")
    if value in (2, 3, 5):
        return Finding(Row(f"GF_ACTION = {value:g}", True, f"fence broken: {does}"))
    ends = ", it falls" if value == 4 else " and no more"
    change = Change("GF_ACTION", value, 2, "a vehicle that breaks the fence stops there, and a person decides")
    return Finding(Row(f"GF_ACTION = {value:g}", False, f"fence broken: {does}{ends}", "2: --fix proposes it"), change)


def _walls(radius: Value | None, points: int | None) -> Finding:
    drawn = {None: "", 0: ""}.get(points, f"a drawn fence of {points} points")
    if radius is None:
        return Finding(Row("GF_MAX_HOR_DIST", None, drawn or "the autopilot does not tell it"))
    name = f"GF_MAX_HOR_DIST = {radius:g}"
    if radius > 0:
        return Finding(Row(name, True, f"at most {radius:g} m from home" + (f", and {drawn}" if drawn else "")))
    if drawn:
        return Finding(Row(name, True, drawn))
    row = Row(name, False, "nothing but our own program keeps it near home", f"{RADIUS:g}: --fix proposes it")
    change = Change("GF_MAX_HOR_DIST", radius, RADIUS, "a wall behind our envelope's 100 m, should that fail")
    return Finding(row, change)


def _height(height: Value | None, climb: Value | None) -> Finding:
    if height is None:
        return Finding(Row("GF_MAX_VER_DIST", None, "the autopilot does not tell it"))
    name = f"GF_MAX_VER_DIST = {height:g}"
    if height > 0:
        return Finding(Row(name, True, f"at most {height:g} m above home"))
    why = "nothing but our own program keeps it low"
    if climb is not None and climb >= HEIGHT:  # a fence below it would hold a returning vehicle in the air
        return Finding(Row(name, False, why, f"lower RTL_RETURN_ALT below {HEIGHT:g}, then run this again"))
    row = Row(name, False, why, f"{HEIGHT:g}: --fix proposes it")
    change = Change("GF_MAX_VER_DIST", height, HEIGHT, "a ceiling behind our envelope's; the law's in most places")
    return Finding(row, change)


def _return(altitude: Value | None, height: Value | None) -> Finding:
    if altitude is None:
        return Finding(Row("RTL_RETURN_ALT", None, "the autopilot does not tell it"))
    name, climbs = f"RTL_RETURN_ALT = {altitude:g}", f"Return first climbs to {altitude:g} m"
    if height and altitude >= height:
        return Finding(
            Row(name, False, f"{climbs}, which breaks the fence at {height:g} m", "lower it below the fence")
        )
    return Finding(Row(name, True, f"{climbs}: nothing may be above it there"))
