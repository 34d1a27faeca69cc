"""A MAVSDK 4 script: takes off, flies body velocities offboard, lands. `python examples/mavsdk4.py [URL]`.

URL is the address of the vehicle; the default is the simulated vehicle of `dronecats sitl`.
For mavsdk 3 see mavsdk3.py.
"""

import asyncio
import math
import sys
from collections.abc import AsyncIterator, Callable
from typing import Any

from mavsdk.asyncio.component_type import ComponentType
from mavsdk.asyncio.mavsdk import Configuration, Mavsdk
from mavsdk.asyncio.plugins.action import ActionAsync
from mavsdk.asyncio.plugins.offboard import OffboardAsync
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync
from mavsdk.plugins.offboard import VelocityBodyYawspeed

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
    async with Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION)) as mavsdk:
        await mavsdk.add_any_connection(url)
        system = await mavsdk.first_autopilot(timeout_s=WAIT_S)
        telemetry, action, offboard = TelemetryAsync(system), ActionAsync(system), OffboardAsync(system)
        await first(telemetry.subscribe_health_all_ok(), bool)
        await action.set_takeoff_altitude(3.0)
        await action.arm()
        await action.takeoff()
        high = await first(telemetry.subscribe_position(), lambda position: position.relative_altitude_m > 2.7)
        print(f"height {high.relative_altitude_m:.2f} m")
        await offboard.set_velocity_body(VelocityBodyYawspeed(0.0, 0.0, 0.0, 0.0))  # offboard needs a first setpoint
        await offboard.start()
        await offboard.set_velocity_body(VelocityBodyYawspeed(2.0, 0.0, 0.0, 0.0))
        fast = await first(telemetry.subscribe_velocity_ned(), lambda velocity: speed(velocity) > 1.9)
        print(f"speed {speed(fast):.2f} m/s")
        await offboard.stop()
        await action.land()
        await first(telemetry.subscribe_armed(), lambda is_armed: not is_armed)
        print("landed")


if __name__ == "__main__":
    asyncio.run(fly(sys.argv[1] if len(sys.argv) > 1 else SITL))
