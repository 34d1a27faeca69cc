"""A MAVSDK 3 script: takes off, flies body velocities offboard, lands. `python examples/mavsdk3.py [URL]`.

The script needs its own environment with `pip install "mavsdk<4"`, because DroneCATS installs mavsdk 4. URL is the
address of the vehicle; the default is the simulated vehicle of `dronecats sitl`. For mavsdk 4 see mavsdk4.py.
"""

import asyncio
import math
import sys
from collections.abc import AsyncIterator, Callable
from typing import Any

from mavsdk import System
from mavsdk.offboard import VelocityBodyYawspeed

SITL = "udpin://0.0.0.0:14540"
WAIT_S = 60.0


async def first(stream: AsyncIterator[Any], is_wanted: Callable[[Any], bool]) -> Any:
    """Return the first value of a telemetry stream for which `is_wanted` is true.

    Raises TimeoutError after WAIT_S, or ConnectionError if the stream ends.
    """

    async def wait() -> Any:
        async for value in stream:
            if is_wanted(value):
                return value
        raise ConnectionError("the telemetry ended")

    return await asyncio.wait_for(wait(), WAIT_S)


def speed(velocity: Any) -> float:
    """Return the speed over the ground, m/s."""
    return math.hypot(velocity.north_m_s, velocity.east_m_s)


async def fly(url: str) -> None:
    """Fly 2 m/s ahead from 3 m above the ground, and land."""
    drone = System()
    await drone.connect(system_address=url)
    await first(drone.core.connection_state(), lambda state: state.is_connected)
    await first(drone.telemetry.health_all_ok(), bool)
    await drone.action.set_takeoff_altitude(3.0)
    await drone.action.arm()
    await drone.action.takeoff()
    high = await first(drone.telemetry.position(), lambda position: position.relative_altitude_m > 2.7)
    print(f"height {high.relative_altitude_m:.2f} m")
    await drone.offboard.set_velocity_body(VelocityBodyYawspeed(0.0, 0.0, 0.0, 0.0))  # offboard needs a first setpoint
    await drone.offboard.start()
    await drone.offboard.set_velocity_body(VelocityBodyYawspeed(2.0, 0.0, 0.0, 0.0))
    fast = await first(drone.telemetry.velocity_ned(), lambda velocity: speed(velocity) > 1.9)
    print(f"speed {speed(fast):.2f} m/s")
    await drone.offboard.stop()
    await drone.action.land()
    await first(drone.telemetry.armed(), lambda is_armed: not is_armed)
    print("landed")


if __name__ == "__main__":
    asyncio.run(fly(sys.argv[1] if len(sys.argv) > 1 else SITL))
