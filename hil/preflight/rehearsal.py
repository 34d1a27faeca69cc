"""Offboard, rehearsed while disarmed: does the autopilot take our setpoints, switch, and switch back?

PX4 lets a disarmed vehicle switch to any mode, setpoints or not. What shows that they arrive is its pre-arm check: in
OFFBOARD it passes only while they do (measured on 1.15; offboardCheck.cpp).
"""

import contextlib
from collections.abc import Callable

from foundation.errors import DronecatsError, LinkError
from foundation.mavlink import dialect
from foundation.setpoints import Velocity
from hil.link.link import Link
from hil.preflight.row import Row

NAME = "offboard rehearsal"
STREAM_S = 2.0  # s of vehicle time
SHOWN_S = 3.0  # s: HEARTBEAT comes once a second, CURRENT_MODE may not come at all
STANDING = Velocity(forward=0.0, up=0.0)


def rehearse(link: Link) -> Row:
    """Stream a velocity of zero, switch to OFFBOARD, see it shown, go back to HOLD; return what came of it.

    Never arms, and does nothing with a vehicle that is armed. Raises LinkError when the vehicle is gone.
    """
    if link.state.armed:
        return Row(NAME, False, "not done: the vehicle is armed", "disarm it first")
    link.fly(STANDING)
    try:
        link.wait(STREAM_S)
        return _switch(link)
    finally:
        link.stop_stream()
        with contextlib.suppress(DronecatsError):  # what went wrong before says more
            link.set_mode("HOLD")


def _switch(link: Link) -> Row:
    try:
        link.set_mode("OFFBOARD")
    except LinkError as refusal:
        link.tick()  # raises when it was the wire that broke
        return Row(NAME, False, str(refusal), "PX4 wants a place, a velocity and our setpoints for it")
    shown_s = _until(link, lambda: link.state.mode == "OFFBOARD", SHOWN_S)
    if shown_s is None:
        return Row(NAME, False, f"OFFBOARD was accepted, but {link.state.mode} is shown {SHOWN_S:g} s later",
                   "is somebody else switching modes: a transmitter, a ground station?")  # fmt: skip
    would_arm = _would_arm(link)
    link.stop_stream()
    try:
        link.set_mode("HOLD")
    except LinkError as refusal:
        link.tick()
        return Row(NAME, False, f"OFFBOARD was shown, but there is no way back: {refusal}", "switch to Hold by hand")
    if _until(link, lambda: link.state.mode == "HOLD", SHOWN_S) is None:
        return Row(NAME, False, f"{link.state.mode} is still shown after Hold was accepted", "switch to Hold by hand")
    if not would_arm:
        return Row(NAME, False, "OFFBOARD was shown, but it would not arm in it; back in HOLD",
                   "either our setpoints do not arrive, or the pre-arm check fails anyway")  # fmt: skip
    return Row(NAME, True, f"accepted, shown after {shown_s:.1f} s, would arm in it; back in HOLD; nothing was armed")


def _would_arm(link: Link) -> bool:
    """Return whether the pre-arm check passes within SHOWN_S, by a SYS_STATUS that comes from now on."""
    checks: list[bool] = []

    def hear(message: dialect.MAVLink_message) -> None:
        if message.get_msgId() == dialect.MAVLINK_MSG_ID_SYS_STATUS and message.get_srcSystem() == link.system:
            checks.append(bool(message.onboard_control_sensors_health & dialect.MAV_SYS_STATUS_PREARM_CHECK))

    link.listeners.append(hear)
    end_us = link.time_us + SHOWN_S * 1e6
    try:
        while not any(checks) and link.time_us < end_us:
            link.command(dialect.MAV_CMD_REQUEST_MESSAGE, dialect.MAVLINK_MSG_ID_SYS_STATUS)  # the stream may be slow
            link.tick()
        return any(checks)
    finally:
        link.listeners.remove(hear)


def _until(link: Link, reached: Callable[[], bool], seconds: float) -> float | None:
    """Tick until `reached`; return how long it took in s of vehicle time, None when it did not within `seconds`."""
    began_us = link.time_us
    while not reached():
        if link.time_us - began_us >= seconds * 1e6:
            return None
        link.tick()
    return (link.time_us - began_us) * 1e-6
