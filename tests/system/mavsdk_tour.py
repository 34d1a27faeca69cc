"""A MAVSDK 4 script: it uses every telemetry stream, files, offboard setpoints, and a mission with a return home.

Argument: the connection URL. The script prints its observations as JSON.
"""

import asyncio
import json
import sys
import tempfile
from pathlib import Path

from mavsdk.asyncio.component_type import ComponentType
from mavsdk.asyncio.mavsdk import Configuration, Mavsdk
from mavsdk.asyncio.plugins.action import ActionAsync
from mavsdk.asyncio.plugins.ftp import FtpAsync
from mavsdk.asyncio.plugins.mission import MissionAsync
from mavsdk.asyncio.plugins.offboard import OffboardAsync
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync
from mavsdk.plugins.mission import MissionItem, MissionPlan
from mavsdk.plugins.offboard import Attitude, PositionNedYaw, VelocityNedYaw

NAN = float("nan")
SILENT = {  # streams of missing parts, of the truth, and of messages that PX4 no longer sends
    "actuator_control_target", "ground_truth", "raw_imu", "status_text", "wind",
}  # fmt: skip
ON_REQUEST = ("scaled_imu", "actuator_output_status")


async def first(stream, wanted=lambda value: True, seconds=40):
    async def wait():
        async for value in stream:
            if wanted(value):
                return value

    return await asyncio.wait_for(wait(), seconds)


async def silent_streams(telemetry):
    """Return the names of the streams that give no value."""

    async def is_silent(name):
        try:
            await first(getattr(telemetry, f"subscribe_{name}")(), seconds=8)
        except TimeoutError:
            return name
        return None

    for name in ON_REQUEST:
        await getattr(telemetry, f"set_rate_{name}")(5.0)
    names = [name.removeprefix("subscribe_") for name in dir(telemetry) if name.startswith("subscribe_")]
    return sorted(filter(None, await asyncio.gather(*map(is_silent, (n for n in names if n not in SILENT)))))


async def keep_a_file(files):
    """Store a file on the vehicle, compare it, and remove it. Return whether the copy was identical."""
    with tempfile.TemporaryDirectory() as folder:
        local = Path(folder) / "note.txt"
        local.write_text("kept")
        await files.create_directory("/fs/microsd/notes")
        async for _ in files.upload(str(local), "/fs/microsd/notes"):
            pass
        same = await files.are_files_identical(str(local), "/fs/microsd/notes/note.txt")
        await files.remove_file("/fs/microsd/notes/note.txt")
        await files.remove_directory("/fs/microsd/notes")
        return same


def near(place, north, east, down):
    p = place.position
    return abs(p.north_m - north) < 1.0 and abs(p.east_m - east) < 1.0 and abs(p.down_m - down) < 1.0


async def fly_offboard(telemetry, offboard):
    """Fly with a position, a velocity and an attitude setpoint, in this order."""
    here = (await first(telemetry.subscribe_position_velocity_ned())).position
    north, east, down = here.north_m + 3.0, here.east_m, here.down_m - 3.0
    await offboard.set_position_ned(PositionNedYaw(north, east, down, 90.0))
    await offboard.start()
    await first(telemetry.subscribe_position_velocity_ned(), lambda p: near(p, north, east, down))
    await first(telemetry.subscribe_attitude_euler(), lambda a: abs(a.yaw_deg - 90.0) < 5.0)
    await offboard.set_velocity_ned(VelocityNedYaw(0.0, 0.0, -1.5, 90.0))
    await first(telemetry.subscribe_velocity_ned(), lambda v: v.down_m_s < -1.2)
    await offboard.set_attitude(Attitude(0.0, 0.0, 90.0, 0.75))
    await first(telemetry.subscribe_velocity_ned(), lambda v: v.down_m_s < -1.7)
    await offboard.stop()


async def fly_mission(telemetry, mission):
    """Fly three waypoints and return home. Return whether it finished, the downloaded items and the progress."""
    home = await first(telemetry.subscribe_home())

    def waypoint(north, east):
        return MissionItem(
            home.latitude_deg + north / 111_195.0, home.longitude_deg + east / 75_300.0, 20.0, 5.0, True, NAN, NAN,
            MissionItem.CameraAction.NONE, NAN, NAN, 2.0, NAN, NAN, MissionItem.VehicleAction.NONE,
        )  # fmt: skip

    plan = MissionPlan([waypoint(10.0, 0.0), waypoint(10.0, 10.0), waypoint(0.0, 10.0)])
    await mission.set_return_to_launch_after_mission(True)
    await mission.upload_mission(plan)
    downloaded = await mission.download_mission()
    shown = []

    async def watch():
        async for progress in mission.subscribe_mission_progress():
            shown.append((progress.current, progress.total))

    watching = asyncio.ensure_future(watch())
    await mission.start_mission()
    for _ in range(240):
        if await mission.is_mission_finished():
            break
        await asyncio.sleep(0.25)
    finished = await mission.is_mission_finished()
    watching.cancel()
    return {"finished": finished, "items": len(downloaded.mission_items), "progress": shown}


async def tour(url):
    async with Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION)) as mavsdk:
        await mavsdk.add_any_connection(url)
        system = await mavsdk.first_autopilot(timeout_s=30.0)
        telemetry, action = TelemetryAsync(system), ActionAsync(system)
        await first(telemetry.subscribe_health_all_ok(), bool)
        seen = {
            "silent": await silent_streams(telemetry),
            "epoch_us": await first(telemetry.subscribe_unix_epoch_time()),
            "file": await keep_a_file(FtpAsync(system)),
        }
        await action.set_takeoff_altitude(10.0)
        await action.set_return_to_launch_altitude(20.0)
        await action.arm()
        await action.takeoff()
        await first(telemetry.subscribe_position(), lambda p: p.relative_altitude_m > 9.0)
        await fly_offboard(telemetry, OffboardAsync(system))
        seen["mission"] = await fly_mission(telemetry, MissionAsync(system))
        await first(telemetry.subscribe_armed(), lambda armed: not armed, 90)
        place = (await first(telemetry.subscribe_position_velocity_ned())).position
        seen["end"] = (place.north_m, place.east_m)
        print(json.dumps(seen))


asyncio.run(tour(sys.argv[1]))
