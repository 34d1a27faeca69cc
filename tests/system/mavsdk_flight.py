"""A plain MAVSDK 4 script: takes off, flies body velocities offboard, lands. Run with the connection URL."""

import asyncio
import json
import sys

from mavsdk.asyncio.component_type import ComponentType
from mavsdk.asyncio.mavsdk import Configuration, Mavsdk
from mavsdk.asyncio.plugins.action import ActionAsync
from mavsdk.asyncio.plugins.offboard import OffboardAsync
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync
from mavsdk.plugins.offboard import VelocityBodyYawspeed


async def first(stream, wanted, seconds=40):
    async def wait():
        async for value in stream:
            if wanted(value):
                return value

    return await asyncio.wait_for(wait(), seconds)


async def fly(url):
    async with Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION)) as mavsdk:
        await mavsdk.add_any_connection(url)
        system = await mavsdk.first_autopilot(timeout_s=30.0)
        telemetry, action, offboard = TelemetryAsync(system), ActionAsync(system), OffboardAsync(system)
        await first(telemetry.subscribe_health_all_ok(), bool)
        await action.set_takeoff_altitude(3.0)
        await action.arm()
        await action.takeoff()
        high = await first(telemetry.subscribe_position(), lambda p: p.relative_altitude_m > 2.7)
        await offboard.set_velocity_body(VelocityBodyYawspeed(0.0, 0.0, 0.0, 0.0))
        await offboard.start()
        await offboard.set_velocity_body(VelocityBodyYawspeed(2.0, 0.0, 0.0, 0.0))
        fast = await first(telemetry.subscribe_velocity_ned(), lambda v: (v.north_m_s**2 + v.east_m_s**2) ** 0.5 > 1.9)
        await offboard.stop()
        await action.land()
        await first(telemetry.subscribe_armed(), lambda armed: not armed)
        print(json.dumps({"height": high.relative_altitude_m, "speed": (fast.north_m_s**2 + fast.east_m_s**2) ** 0.5}))


asyncio.run(fly(sys.argv[1]))
