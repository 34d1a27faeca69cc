"""Brings all drones from the ground to their start poses, in the same way for every autopilot."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from foundation.errors import LinkError
from foundation.frames import Vec3
from foundation.mavlink import dialect
from hil.link.course import Arrival
from hil.link.envelope import broken_off
from hil.link.link import Link
from hil.link.telemetry import VehicleState
from hil.preflight.failsafes import read_failsafe

READY_S = 90.0  # s of vehicle time, longest time to become ready to arm; a real PX4 needs about 36
AVERAGE_S = 3.0  # s over which position and rangefinder distance are averaged on the ground
ARRIVAL_S = 60.0  # s, longest time to settle at the start pose
RANGED_S = 1.0  # s over which position and rangefinder distance are averaged at the start pose
LEVEL_M, LEVEL_MAX_M = 0.04, 0.5  # m; height errors between these two are corrected
LEVELLINGS = 4  # at most this many height corrections


@dataclass(frozen=True, slots=True)
class StartOffset:
    """The start pose of a drone, relative to the drone's place on the ground before take-off."""

    offset_ned: Vec3  # m, from the body's origin on the ground to the start pose
    yaw: float | None  # rad; None: the heading on the ground


def start_of(record_start: Any, ground_down: float, clearance_m: float = 0.0) -> StartOffset:
    """Return the offset to `record_start`, a drone's start pose in an episode record.

    `ground_down`: ground at the start (m, NED down). `clearance_m`: height of the body's origin when the drone stands.
    """
    height_m = ground_down - clearance_m - record_start.position_ned[2]
    return StartOffset((0.0, 0.0, -height_m), math.radians(record_start.yaw_deg))


def ascend(
    links: Sequence[Link],
    starts: Sequence[StartOffset],
    notify: Callable[[str], None],
    check: Callable[[Sequence[Link]], None] | None = None,
) -> None:
    """Connect, arm, take off, fly to the start poses and stay there in Offboard, all drones at once. Raises LinkError.

    `check` is called when all drones are ready to arm. It raises if a drone may not take off. None: no check.

    A drone whose start has a heading makes a full turn on the way. The turn lets the estimator find the hard iron of
    the compass, which otherwise causes a heading error of up to two degrees.
    """
    for link in links:
        link.connect()
        _on_the_ground(link)
        if not link.simulated:
            link.failsafe = read_failsafe(link)
        if link.state.mode != "HOLD":  # a PX4 that is still in Land or Offboard does not arm
            link.set_mode("HOLD")
    notify("waiting until the autopilot is ready to arm …")
    for link in links:
        link.wait_for(lambda state: state.healthy, READY_S, "becoming ready to arm")
    for link in links[:1]:  # only the first link waits; meanwhile its `on_wait` serves the other links
        link.wait(AVERAGE_S)
    grounds = [_ground(link) for link in links]
    if check:
        check(links)
    notify("arming and taking off …")
    for link in links:
        _on_the_ground(link)
        link.arm()
        link.order("take-off", dialect.MAV_CMD_NAV_TAKEOFF)
    for link in links:
        link.wait_for(lambda state: state.mode == "HOLD" and state.landed is False, 60.0, "reaching take-off height")
    notify("flying to the start pose …")
    sent = [_send(link, ground, start) for link, ground, start in zip(links, grounds, starts, strict=True)]
    _await(links, sent)
    for _ in range(LEVELLINGS):
        for link in links[:1]:
            link.wait(RANGED_S)
        before = sent
        sent = [_levelled(*drone) for drone in zip(links, before, grounds, starts, strict=True)]
        if sent == before:
            break
        _await(links, sent)


@dataclass(frozen=True, slots=True)
class _Ground:
    """The place of a drone on the ground before it takes off."""

    position_ned: Vec3  # m, local frame
    range_m: float | None  # m, range that the drone's rangefinder measures; None: no rangefinder


@dataclass(frozen=True, slots=True)
class _Sent:
    """The goal of a drone on its way to the start pose."""

    position_ned: Vec3  # m, local frame
    yaw: float  # rad
    arrival: Arrival


def _ground(link: Link) -> _Ground:
    place = link.track.mean_place(AVERAGE_S)
    if place is None:
        raise LinkError("the autopilot sends no local position (LOCAL_POSITION_NED)")
    return _Ground(place, link.track.mean_range(AVERAGE_S))


def _send(link: Link, ground: _Ground, start: StartOffset) -> _Sent:
    north, east, down = (g + o for g, o in zip(ground.position_ned, start.offset_ned, strict=True))
    euler = link.state.euler
    yaw = start.yaw if start.yaw is not None else euler[2] if euler else 0.0
    arrival = link.fly_to((north, east, down), yaw, round_first=start.yaw is not None)
    link.start_offboard()
    return _Sent((north, east, down), yaw, arrival)


def _levelled(link: Link, sent: _Sent, ground: _Ground, start: StartOffset) -> _Sent:
    """Correct a drone's height with its rangefinder, because the barometer drifts; return the new goal.

    Returns `sent` itself if there is nothing to correct, or no rangefinder.
    """
    range_m = link.track.mean_range(RANGED_S)
    place = link.track.mean_place(RANGED_S)
    if range_m is None or ground.range_m is None or place is None or start.yaw is None:
        return sent
    low_m = -start.offset_ned[2] - (range_m - ground.range_m)
    if not LEVEL_M < abs(low_m) < LEVEL_MAX_M:  # a larger error: the ground here has another height
        return sent
    north, east, _ = sent.position_ned
    position_ned = (north, east, place[2] - low_m)
    return _Sent(position_ned, sent.yaw, link.fly_to(position_ned, sent.yaw))


def _await(links: Sequence[Link], sent: Sequence[_Sent]) -> None:
    for link, order in zip(links, sent, strict=True):
        link.wait_for(partial(_settled, link, order.arrival), ARRIVAL_S, "settling at the start pose")


def _settled(link: Link, arrival: Arrival, state: VehicleState) -> bool:
    return arrival.settled(state, link.time_us)


def _on_the_ground(link: Link) -> None:
    """Raise LinkError if the vehicle is armed or in the air (another pilot flies it), or if its battery is too low."""
    if link.state.armed or link.state.landed is False:
        condition = "is already armed" if link.state.armed else "is in the air"
        raise LinkError(
            f"the vehicle {condition}, so dronecats does not arm it. Leave --arm out, and hand the vehicle over in Hold"
        )
    reason = broken_off(link.state, link.limits, 0.0) if link.limits else None
    if reason:
        raise LinkError(f"not armed: {reason}")
