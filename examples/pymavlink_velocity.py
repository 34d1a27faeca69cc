"""A pymavlink script: takes off, flies body velocities offboard, lands. `python examples/pymavlink_velocity.py [URL]`.

URL is the vehicle's address in pymavlink's notation; the default is the simulated vehicle of `dronecats sitl`.
"""

import math
import sys
import time
from collections.abc import Callable
from typing import Any

from pymavlink import mavutil
from pymavlink.dialects.v20 import common as mavlink

SITL = "udpin:0.0.0.0:14540"
WAIT_S = 60.0
PERIOD_S = 0.05  # interval of the setpoints; PX4 needs more than 2 Hz
KEEP = math.nan  # as a command's parameter: the vehicle uses its own value
VELOCITY_ONLY = 0b0101_1100_0111  # type mask: the vehicle ignores position, acceleration and yaw


class Vehicle:
    """A vehicle behind a MAVLink connection."""

    def __init__(self, url: str) -> None:
        self.link: Any = mavutil.mavlink_connection(url)
        self.forward_mps: float | None = None  # m/s, velocity in the setpoints; None: no setpoints are sent
        beat = self.wait_for("HEARTBEAT", lambda beat: beat.autopilot == mavlink.MAV_AUTOPILOT_PX4)
        self.system: int = beat.get_srcSystem()

    def wait_for(self, kind: str, is_wanted: Callable[[Any], bool]) -> Any:
        """Return the first message of a kind for which `is_wanted` is true. Raises TimeoutError after WAIT_S.

        While it waits, the method sends heartbeats, and setpoints if `forward_mps` is set.
        """
        end = time.monotonic() + WAIT_S
        while time.monotonic() < end:
            self.link.mav.heartbeat_send(mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 0)
            if self.forward_mps is not None:
                self.link.mav.set_position_target_local_ned_send(
                    0, self.system, 1, mavlink.MAV_FRAME_BODY_NED, VELOCITY_ONLY,
                    0, 0, 0, self.forward_mps, 0, 0, 0, 0, 0, 0, 0,
                )  # fmt: skip
            message = self.link.recv_match(type=kind, blocking=True, timeout=PERIOD_S)
            if message is not None and is_wanted(message):
                return message
        raise TimeoutError(f"no matching {kind} within {WAIT_S:.0f} s")

    def command(self, number: int, *parameters: float) -> None:
        """Send a command until the vehicle accepts it. Raises TimeoutError."""
        end = time.monotonic() + WAIT_S
        filled = (*parameters, *(0.0,) * (7 - len(parameters)))
        while time.monotonic() < end:
            self.link.mav.command_long_send(self.system, 1, number, 0, *filled)
            reply = self.wait_for("COMMAND_ACK", lambda ack: ack.command == number)
            if reply.result == mavlink.MAV_RESULT_ACCEPTED:
                return
            time.sleep(0.1)
        raise TimeoutError(f"command {number} is not accepted")


def fly(url: str) -> None:
    """Fly 2 m/s ahead from about 2.5 m above the ground, and land."""
    vehicle = Vehicle(url)
    vehicle.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    vehicle.command(mavlink.MAV_CMD_NAV_TAKEOFF, KEEP, KEEP, KEEP, KEEP, KEEP, KEEP, KEEP)
    position = vehicle.wait_for("LOCAL_POSITION_NED", lambda position: position.z < -2.3)
    print(f"height {-position.z:.2f} m")
    vehicle.forward_mps = 2.0  # PX4 needs setpoints before offboard
    vehicle.command(mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, 6)  # PX4's mode Offboard
    position = vehicle.wait_for("LOCAL_POSITION_NED", lambda position: math.hypot(position.vx, position.vy) > 1.9)
    print(f"speed {math.hypot(position.vx, position.vy):.2f} m/s")
    vehicle.forward_mps = None
    vehicle.command(mavlink.MAV_CMD_NAV_LAND, KEEP, KEEP, KEEP, KEEP, KEEP, KEEP, KEEP)
    vehicle.wait_for("HEARTBEAT", lambda beat: not beat.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
    print("landed")


if __name__ == "__main__":
    fly(sys.argv[1] if len(sys.argv) > 1 else SITL)
