"""The MAVSDK-Python examples that a PX4-like autopilot should serve, and the output of each on success.

The selection, the plugins and the ratings `core` and `yes` are those of the client survey (MAVSDK-Python, folder
`examples`). The examples themselves print the expected lines. The count of a pattern is the least number of its lines.
"""

import math
from dataclasses import dataclass, field

HEALTHY = "[Gg]lobal position (estimate OK|state is good enough)"


@dataclass(frozen=True)
class Example:
    """One script and its conditions for success."""

    script: str  # relative to the examples' folder
    plugins: str
    expectation: str  # core, or yes
    shows: dict[str, int] = field(default_factory=dict)  # regular expression -> least number of lines with it
    limit_s: float = 90.0  # wall seconds for the script alone; the simulator's start is not counted
    endless: bool = False  # the script never returns: it is interrupted when it has shown everything
    linger_s: float = 0.0  # for an endless script: how long it continues after its last expected line
    climbs_m: float = 0.0  # the flight log must reach at least this height; spool-up and take-off ramp cost about 2 s
    arguments: tuple[str, ...] = ()
    files: tuple[str, ...] = ()  # files of the examples' folder that must lie in the working directory
    written: dict[str, str] = field(default_factory=dict)  # files to write there: name -> text
    after: str | None = None  # an example flown first, to its end, in the same simulator
    server: str | None = None  # the script needs a running mavsdk_server: the vehicle's address for it
    eventful: bool = False  # a ground station arms and disarms meanwhile: a vehicle at rest sends no text
    downloads: str | None = None  # a pattern of files that it writes; they must equal the vehicle's logs
    stays_below_m: float = math.inf  # the flight log must stay below this height
    refused: str | None = None  # the expected error: the script requests something that does not exist here
    note: str = ""

    @property
    def name(self) -> str:
        return self.script.rsplit("/", 1)[-1]


PARAMETERS = "# vehicle\tcomponent\tname\tvalue\ttype\n1\t1\tMIS_TAKEOFF_ALT\t3.5\t9\n1\t1\tCOM_OBL_RC_ACT\t1\t6\n"
OFFBOARD = {HEALTHY: 1, "-- Starting offboard": 1, "-- Stopping offboard": 1}
SERVER = "the script needs a running mavsdk_server; it gets one that uses UDP instead of a serial port"

EXAMPLES = (
    Example("takeoff_and_land.py", "telemetry, action", "core",
            {HEALTHY: 1, "-- Taking off": 1, "-- Landing": 1, "Status: ": 1}, climbs_m=2.0),
    Example("telemetry_takeoff_and_land.py", "telemetry, action", "core",
            {"Altitude: [89]": 1, "Flight mode: TAKEOFF": 1, "Flight mode: LAND": 1}, climbs_m=7.0),
    Example("offboard_velocity_body.py", "offboard", "core", {**OFFBOARD, "-- Fly a circle": 2}, climbs_m=2.5),
    Example("offboard_velocity_ned.py", "offboard", "core", {**OFFBOARD, "-- Go": 6}, climbs_m=3.0),
    Example("offboard_position_ned.py", "offboard", "core", {**OFFBOARD, "-- Go": 4}, climbs_m=4.5),
    Example("offboard_position_velocity_ned.py", "offboard, telemetry", "core",
            {**OFFBOARD, r"^-?\d\.\d+ -?\d\.\d+": 100}, climbs_m=9.5),
    Example("offboard_attitude.py", "offboard", "core",
            {**OFFBOARD, "-- Hover at 60% thrust": 1}, climbs_m=3.0),
    Example("offboard_from_csv/offboard_from_csv.py", "offboard, telemetry", "core",
            {HEALTHY: 1, "-- Performing trajectory": 1, "Mode number": 5, "-- Shape completed": 1,
             "-- Disarming": 1},
            limit_s=240, climbs_m=14.0, files=("offboard_from_csv/active.csv",)),
    Example("goto.py", "action, telemetry", "core", {"-- Taking off": 1, "Staying connected": 45},
            endless=True, climbs_m=18.0),
    Example("do_orbit.py", "action", "yes", {"Do orbit at 10m": 1, "--- Landing": 1}, limit_s=120, climbs_m=8.0),
    Example("mission.py", "mission, telemetry", "core",
            {"-- Starting mission": 1, "Mission progress: 3/3": 1}, limit_s=240, climbs_m=23.0),
    Example("mission_raw.py", "mission_raw", "yes", {"-- Done": 1}),
    Example("mission_import.py", "mission_raw", "yes", {"Mission uploaded": 1}, files=("example-mission.plan",)),
    Example("geofence.py", "geofence, telemetry", "yes", {"Geofence uploaded!": 1}),
    Example("follow_me_example.py", "follow_me", "yes",
            {"-- Following Target": 3, "-- Stopping Follow Me": 1, "-- Landing": 1}, climbs_m=7.5,
            stays_below_m=9.5),
    Example("manual_control.py", "manual_control", "yes", {HEALTHY: 1, "-- Starting manual control": 1},
            endless=True, linger_s=15.0, climbs_m=2.0),
    Example("telemetry.py", "telemetry", "core",
            {"^Battery: ": 3, "GPS info: ": 5, "^In air: False": 1, "Position: .*latitude_deg": 20}, endless=True),
    Example("telemetry_flight_mode.py", "telemetry", "core", {"FlightMode: HOLD": 1}, endless=True),
    Example("telemetry_is_armed_is_in_air.py", "telemetry", "core",
            {"Is_armed: False": 2, "Is_in_air: False": 2}, endless=True),
    Example("telemetry_status_text.py", "telemetry", "core", {"Statustext: ": 2}, endless=True, eventful=True,
            note="meanwhile a ground station arms and disarms"),
    Example("highres_imu.py", "telemetry", "yes", {"HIGHRES_IMU": 400, "Time \\(us\\): [1-9]": 400}, endless=True),
    Example("all_params.py", "param", "core", {"^MIS_TAKEOFF_ALT: 2.5": 1, "^[A-Z0-9_]+: ": 100}),
    Example("upload_params.py", "param, telemetry", "yes", {"Params uploaded!": 1},
            arguments=("udpin://0.0.0.0:14540", "vehicle.params"), written={"vehicle.params": PARAMETERS}),
    Example("firmware_version.py", "info", "yes", {"Version: ": 1}),
    Example("logfile_download.py", "log_files", "yes", {"^Log 0 from ": 1, "[0-9]+ %": 10}, limit_s=240,
            downloads="log-*.ulog", after="takeoff_and_land.py",
            note="downloads the log of a flight of takeoff_and_land.py; the copy is identical"),
    Example("calibration.py", "calibration", "yes",
            {"-- (Gyroscope|Accelerometer|Magnetometer|Board level) calibration finished": 4}, limit_s=180),
    Example("failure_injection.py", "failure, param", "yes",
            {"-- Injecting GPS failure": 1, "-- Disabling failure injection": 1}, climbs_m=10.0),
    Example("mavlink_direct_send.py", "mavlink_direct", "yes", {"Sending airspeed": 20}),
    Example("mavlink_direct_receive.py", "mavlink_direct", "yes", {"ATTITUDE from 1/1": 50}, endless=True),
    Example("send_status_message.py", "server_utility", "yes", {"-- Connected to drone!": 1}),
    Example("ftp_list_dir.py", "ftp", "yes", {"directory list": 1}, server="udpin://0.0.0.0:14540", note=SERVER),
    Example("ftp_download_file.py", "ftp", "yes", {"-- Connected": 1}, server="udpin://0.0.0.0:14540",
            refused="FILE_DOES_NOT_EXIST", note=f"the script requests a file that only a real board has; {SERVER}"),
)  # fmt: skip
