"""A test bench for the commander: a MAVLink client in memory and a kinematic stand-in for core and vehicle."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from autopilot.autopilot import Autopilot
from autopilot.logging.flight_log import FlightLogWriter
from autopilot.mavlink.node import Port
from autopilot.records import ESTIMATE, KIND_TRAJECTORY, SETPOINT
from foundation.airframe import Airframe, Battery, Rotor, RotorCurve
from foundation.mavlink import Packer, Parser, dialect
from foundation.sensors import SENSORS

TICK_US = 20_000
ORIGIN = (47.397742, 8.545594, 488.0)

AIRFRAME = Airframe(
    name="stand-in",
    mass_kg=2.0,
    inertia_frd=(0.02, 0.02, 0.04),
    rotors=tuple(Rotor((x, y, 0.0), s) for x, y, s in ((1, 1, 1), (-1, -1, 1), (1, -1, -1), (-1, 1, -1))),
    curve=RotorCurve(1e-5, 1e-7, 1000.0, 100.0, 0.01, 0.02, 1e-5, 0.1, 1e-5),
    drag_linear_frd=(0.1, 0.1, 0.1),
    drag_quadratic_frd=(0.0, 0.0, 0.0),
    contact_points_frd=((0.0, 0.0, 0.1),),
    battery=Battery(4, 5.0, 0.02, 5.0),
)


class StandInCore:
    """Follows the setpoint with a first-order lag and a floor at z = 0; the estimate is exact."""

    def __init__(self) -> None:
        self.estimate = np.zeros(1, ESTIMATE)[0]
        self.setpoint = np.zeros(1, SETPOINT)[0]
        self.state = np.zeros(1, np.dtype([("landed", "i8")]))[0]
        self.parameter_changes: list[tuple[str, float]] = []
        e = self.estimate
        e["attitude"] = e["attitude_setpoint"] = (1.0, 0.0, 0.0, 0.0)
        e["hover_thrust"] = 0.5

    def set_parameter(self, name: str, value: float) -> None:
        self.parameter_changes.append((name, value))

    def parameter_defaults(self) -> dict[str, float]:
        return {"MPC_XY_P": 0.95, "MPC_XY_VEL_MAX": 12.0, "MC_ROLLRATE_P": 0.15}

    def converge(self) -> None:
        e = self.estimate
        for flag in ("attitude_valid", "velocity_valid", "position_valid", "altitude_valid", "origin_set"):
            e[flag] = 1
        e["origin_lat_deg"], e["origin_lon_deg"], e["origin_alt_m"] = ORIGIN
        e["position_std_h"], e["velocity_std_h"] = 0.3, 0.1

    def step(self, time_us: int) -> None:
        """Integrate one tick."""
        e, s, dt = self.estimate, self.setpoint, TICK_US * 1e-6
        e["time_us"] = time_us
        p, v = e["position_ned"], e["velocity_ned"]
        flying = s["armed"] and s["kind"] == KIND_TRAJECTORY and s["thrust_limit"] > 0.5
        limits = (s["speed_limit_horizontal"], s["speed_limit_horizontal"], s["speed_limit_up"])
        for i in range(3):
            wish = 0.0 if np.isnan(s["velocity_ned"][i]) else s["velocity_ned"][i]
            if not np.isnan(s["position_ned"][i]):
                wish += float(np.clip(s["position_ned"][i] - p[i], -limits[i], limits[i]))
            if not flying:
                wish = 0.0 if i < 2 or p[2] >= 0.0 else 5.0
            v[i] += (wish - v[i]) * 0.2
            p[i] += v[i] * dt
        if p[2] >= 0.0:  # the ground
            pressed = v[2] > 0.0 or not flying
            p[2] = 0.0
            v[:] = 0.0 if pressed else v
            e["thrust_setpoint"] = 0.2 if pressed else 0.5
        else:
            e["thrust_setpoint"] = 0.5 if s["armed"] else 0.0
        yaw = s["yaw"]
        if flying and not np.isnan(yaw):
            e["attitude"] = (math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2))


class Client:
    """A client at a port: packs requests and collects answers."""

    def __init__(self, port: Port, system: int = 245, component: int = 190) -> None:
        self.port = port
        self.system, self.component = system, component
        self._packer = Packer(system, component)
        self._parser = Parser()
        self.inbox: list[dialect.MAVLink_message] = []

    def send(self, message: dialect.MAVLink_message) -> None:
        self.port.receive(self._packer.pack(message))

    def drain(self) -> list[dialect.MAVLink_message]:
        """Collect and return the messages since the last drain."""
        new = self._parser.feed(self.port.take())
        self.inbox += new
        return new

    def of(self, kind: str) -> list[dialect.MAVLink_message]:
        self.drain()
        return [m for m in self.inbox if m.get_type() == kind]

    def forget(self) -> None:
        self.drain()
        self.inbox.clear()

    def command(self, command: int, *p: float, target: tuple[int, int] = (1, 1)) -> int | None:
        """Send COMMAND_LONG; return the result of its acknowledgement, None without one."""
        self.forget()
        params = [*p, *[math.nan] * (7 - len(p))]
        self.send(dialect.MAVLink_command_long_message(*target, command, 0, *params))
        return self._acknowledged(command)

    def command_int(
        self, command: int, p: tuple[float, ...] = (), x: int = 0, y: int = 0, z: float = 0.0, frame: int = 5
    ) -> int | None:
        """Send COMMAND_INT; return the result of its acknowledgement."""
        self.forget()
        params = [*p, *[math.nan] * (4 - len(p))]
        self.send(dialect.MAVLink_command_int_message(1, 1, frame, command, 0, 0, *params, x, y, z))
        return self._acknowledged(command)

    def _acknowledged(self, command: int) -> int | None:
        acks = [m for m in self.of("COMMAND_ACK") if m.command == command]
        for ack in acks:
            assert (ack.target_system, ack.target_component) == (self.system, self.component)
            assert (ack.get_srcSystem(), ack.get_srcComponent()) == (1, 1)
        assert len(acks) <= 1
        return acks[0].result if acks else None

    def arm(self) -> int | None:
        return self.command(dialect.MAV_CMD_COMPONENT_ARM_DISARM, 1)

    def disarm(self, force: bool = False) -> int | None:
        return self.command(dialect.MAV_CMD_COMPONENT_ARM_DISARM, 0, 21196 if force else 0)

    def mode(self, main: int, sub: int = 0) -> int | None:
        return self.command(dialect.MAV_CMD_DO_SET_MODE, 1, main, sub)

    def velocity(self, vx: float, vy: float, vz: float, *, frame: int = 8, mask: int = 0x5C7, yaw_rate: float = 0.0,
                 yaw: float = 0.0) -> None:  # fmt: skip
        self.send(
            dialect.MAVLink_set_position_target_local_ned_message(
                0, 1, 1, frame, mask, 0, 0, 0, vx, vy, vz, 0, 0, 0, yaw, yaw_rate
            )
        )

    def texts(self) -> list[str]:
        return [m.text for m in self.of("STATUSTEXT")]

    def set_parameter(self, name: str, value: float, kind: int) -> None:
        self.send(dialect.MAVLink_param_set_message(1, 1, name.encode(), value, kind))


class Timed:
    """An autopilot whose time passes only on request."""

    autopilot: Autopilot

    @property
    def commander(self) -> Any:
        return self.autopilot.commander

    def run(self, seconds: float, each_50ms: Callable[[], None] | None = None) -> None:
        raise NotImplementedError

    def until(self, condition: Callable[[], bool], seconds: float, each_50ms: Callable[[], None] | None = None) -> None:
        """Let time pass until the condition holds; fail if it does not hold within `seconds`."""
        for _ in range(round(seconds * 10)):
            if condition():
                return
            self.run(0.1, each_50ms)
        raise AssertionError(f"did not happen within {seconds} s: mode {self.commander.mode}")


class Bench(Timed):
    """Autopilot, stand-in and one client, with a clock."""

    def __init__(self, *, profile: str = "onboard", converged: bool = True, **options: Any) -> None:
        self.core = StandInCore()
        self.sensors = np.zeros(1, SENSORS)[0]
        self.time_us = 0
        self.sensors["range_m"] = math.nan
        self.sensors["gps_fix_type"] = 3
        self.sensors["battery_voltage"], self.sensors["battery_remaining"] = 16.0, 0.9
        self.sensors["accel_frd"][2] = -9.81
        self.sensors["pressure_hpa"] = 1000.0
        if converged:
            self.core.converge()
        self._stamp()
        self.autopilot = Autopilot(AIRFRAME, self.core, self.sensors, **options)
        self.client = Client(self.autopilot.open_port(profile))
        self.run(1.5)

    @property
    def log(self) -> FlightLogWriter:
        assert self.autopilot.log is not None
        return self.autopilot.log

    @property
    def height(self) -> float:
        return -float(self.core.estimate["position_ned"][2])

    @property
    def velocity(self) -> list[float]:
        return [float(x) for x in self.core.estimate["velocity_ned"]]

    def _stamp(self) -> None:
        self.time_us += TICK_US
        self.sensors["time_us"] = self.time_us
        for name in ("imu", "mag", "baro", "gps", "battery"):
            self.sensors[f"{name}_time_us"] = self.time_us

    def tick(self) -> None:
        self._stamp()
        self.core.step(self.time_us)
        self.autopilot.update()

    def run(self, seconds: float, each_50ms: Callable[[], None] | None = None) -> None:
        """Let time pass; `each_50ms` is the client's stream of setpoints."""
        for i in range(round(seconds * 1e6 / TICK_US)):
            if each_50ms is not None and i % 5 in (0, 2):
                each_50ms()
            self.tick()

    def fly(self, height: float = 5.0) -> None:
        """Arm, take off, wait for HOLD."""
        self.autopilot.parameters.set("MIS_TAKEOFF_ALT", height)
        assert self.client.arm() == 0
        assert self.client.command(dialect.MAV_CMD_NAV_TAKEOFF) == 0
        self.until(lambda: self.commander.mode == "HOLD", 30)
        self.run(2.0)


def put(bench: Bench, **parameters: float) -> None:
    """Set parameters on board."""
    for name, value in parameters.items():
        bench.autopilot.parameters.set(name, value)


def sticks(bench: Bench, x: int = 0, y: int = 0, z: int = 500, r: int = 0) -> None:
    """Send one MANUAL_CONTROL message. Axes are in thousandths; z is thrust, and its centre is 500."""
    bench.client.send(dialect.MAVLink_manual_control_message(1, x, y, z, r, 0))
