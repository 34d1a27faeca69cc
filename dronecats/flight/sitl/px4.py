"""Simulates vehicles that a real PX4 flies: exchanges sensors and motor outputs, and manages PX4 processes and ports.

Every EXCHANGE_US of vehicle time PX4 gets one HIL_SENSOR, which sets PX4's clock, and the vehicle waits for the answer.
A PX4 that has just connected does not answer yet. Until PX4's first answer, and after PX4 stops answering, the vehicle
sends sensors without waiting, and its rotors stand still.

In lockstep, vehicle and PX4 are synchronised, and a flight is as fast as the machine allows. Only PX4's MAVLink threads
are not synchronised. So the agent waits a short wall time for telemetry after each tick, and the logs of a repeated
flight differ.
"""

import os
import shlex
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack, closing, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Unpack

from dronecats.flight.processes.supervisor import close_process
from dronecats.flight.sitl.config import SimulatorConfig
from dronecats.flight.sitl.episode_world import load_world
from dronecats.flight.sitl.simulation import STEP_US, TICK_US, BootPose, PacedSimulator, Physics, Vehicle, build
from dronecats.flight.sitl.sockets import AGENT_LOCAL, AGENT_PORT, GCS_LOCAL, TRUTH_LOCAL, truth_port
from episodes.world.world import World
from foundation.airframe import Airframe
from foundation.compiled import ROOT
from foundation.errors import InfrastructureError, UsageError
from foundation.mavlink import Packer, dialect
from foundation.redaction import keyless_environment
from foundation.run_folder.layout import onboard_log_name
from foundation.truth import TRUTH_COMPONENT
from hil.simulator import (
    PORT,
    SampleTimes,
    SimulatorServer,
    gps_message,
    is_armed,
    rotor_commands,
    sample_times,
    sensor_message,
)
from vehicles import airframe as airframes
from vehicles.sensors import Suite

EXCHANGE_US = 4_000  # µs, period of HIL_SENSOR; PX4's SITL start script expects 250 Hz (IMU_INTEG_RATE)
# period of the truth that PX4 gets for its log; PX4 asks for 5 ms, but the period must be a multiple of EXCHANGE_US
TRUTH_US = 8_000
# Wall seconds to wait for an answer. After that, vehicle time advances without PX4. This happens after each flight
# termination, because PX4 then never answers again. The agent's link detects a PX4 that hangs.
ANSWER_S = 3.0
PATIENCE_S = 0.2  # wall seconds between two checks while the vehicle waits for an answer
# PX4's start script sets EKF2_GPS_DELAY to 10 ms for this interface. Each exchange has one (mean) IMU sample.
SUITE = Suite(imu_period_us=EXCHANGE_US, gps_latency_us=10_000)
ACTUATORS = dialect.MAVLINK_MSG_ID_HIL_ACTUATOR_CONTROLS
# µs since boot; until then PX4 gets no sensors. At boot the legs drop onto the ground, so the specific force is wrong
# by up to 3 m/s² for 0.2 s. PX4's EKF2 computes its first tilt from the first samples. An initial error of 16° would
# become a wrong gyro bias: PX4 would not detect that it stands still, and its heading could be wrong when it arms.
SETTLED_US = 500_000


class HilVehicle(Vehicle):
    """A vehicle whose external autopilot gets HIL messages every `period_us` and answers with motor outputs."""

    def __init__(
        self, index: int, airframe: Airframe, pose: BootPose, *, period_us: int, **physics: Unpack[Physics]
    ) -> None:
        super().__init__(index, airframe, pose, **physics)
        curve = self.plant.airframe.curve
        self._idle = curve.speed_idle / curve.speed_max
        self._rotors = len(self.plant.airframe.rotors)
        self._period_us = period_us
        self._sent = SampleTimes()

    def advance(self) -> None:
        """Advance by one tick, and exchange messages when they are due."""
        end_us = self.time_us + TICK_US
        while (now_us := self.time_us) < end_us:
            exchange_us = now_us - now_us % self._period_us + self._period_us
            self.plant.advance((min(exchange_us, end_us) - now_us) // STEP_US)
            if self.time_us == exchange_us:
                self._exchange()

    def _exchange(self) -> None:
        """Send the sensors and take the motor outputs."""
        raise NotImplementedError

    def _has_fix(self) -> bool:
        """Return whether there is a GPS fix that has not been sent."""
        return int(self.plant.sensors["gps_time_us"]) > self._sent.gps_us

    def _sensor_message(self) -> dialect.MAVLink_message:
        """Return HIL_SENSOR with the new samples, and mark all samples and the GPS fix as sent."""
        message = sensor_message(self.plant.sensors, self.time_us, self._sent)
        self._sent = sample_times(self.plant.sensors)
        return message

    def _obey(self, message: dialect.MAVLink_message, time_us: int) -> None:
        """Apply a HIL_ACTUATOR_CONTROLS to the rotors. `time_us`: time of the commands (µs)."""
        actuators = self.plant.actuators
        actuators["armed"] = int(is_armed(message))
        actuators["command"] = rotor_commands(message.controls, self._rotors, self._idle)
        actuators["time_us"] = time_us


class Px4Vehicle(HilVehicle):
    def __init__(
        self, index: int, airframe: Airframe, pose: BootPose, *, server: SimulatorServer, **physics: Unpack[Physics]
    ) -> None:
        """`server`: the TCP server to which PX4 connects. `close` closes the server."""
        physics.setdefault("suite", SUITE)
        super().__init__(index, airframe, pose, period_us=EXCHANGE_US, **physics)
        self.server = server
        self.released = False  # set by another thread; ends all waits
        self.in_step = False  # whether PX4 answers each sensor message; the vehicle waits for answers only if True
        self.answers = 0
        self._to_px4 = Packer(self.index + 1, TRUTH_COMPONENT)

    def close(self) -> None:
        self.server.close()

    def _exchange(self) -> None:
        if self.time_us <= SETTLED_US:
            return
        if self.server.accept():
            self.in_step = False
        if not self.server.connected:
            self._stop()
            return
        self.server.send(self._sensors())
        if not self.in_step:
            for message in self.server.messages(0.0):
                self._take(message)
            return
        sent_us, sent_s = self.time_us, time.monotonic()
        while self.server.connected and not self.released and int(self.plant.actuators["time_us"]) < sent_us:
            for message in self.server.messages(PATIENCE_S):
                self._take(message)
            if self.server.accept():
                self.in_step = False
                return
            if time.monotonic() - sent_s > ANSWER_S:
                self._stop()
                return

    def _sensors(self) -> bytes:
        """Return the new messages for PX4 as bytes. HIL_SENSOR is the last, because it starts PX4's next cycle."""
        data = self._to_px4.pack(gps_message(self.plant.sensors)) if self._has_fix() else b""
        if self.time_us % TRUTH_US == 0:
            data += self.truth()
        return data + self._to_px4.pack(self._sensor_message())

    def _take(self, message: dialect.MAVLink_message) -> None:
        if message.get_msgId() == ACTUATORS:
            self._obey(message, message.time_usec)
            self.in_step = True
            self.answers += 1

    def _stop(self) -> None:
        """Go on without PX4, and stop the motors."""
        self.in_step = False
        self.plant.actuators["armed"] = 0


MODEL = "none_iris"  # a PX4 airframe with the rotor order of the project's quadrotors
INSTANCE = "{instance}"  # placeholder for the instance's number in a command


class Px4Process:
    """One PX4 process. Its parameters and logs stay in its folder; its output is appended to `log`."""

    def __init__(self, command: str, instance: int, folder: Path, log: Path, speed: float) -> None:
        """Start PX4. Raises UsageError for a command that cannot be run."""
        self.folder, self.log = folder, log
        self._arguments = arguments(command, instance)
        self._environment = environment(instance, speed)
        self._process = self._start()

    def poll(self) -> int | None:
        """Return the exit status of a PX4 that has ended, None while it runs."""
        return self._process.poll()

    def restart(self) -> None:
        """Restart a PX4 that has ended, in the same folder."""
        self.close()
        self._process = self._start()

    def close(self) -> None:
        """End PX4 and all other processes that the command has started."""
        close_process(self._process)

    def _start(self) -> "subprocess.Popen[bytes]":
        self.folder.mkdir(parents=True, exist_ok=True)
        with self.log.open("ab") as log:
            return subprocess.Popen(
                [sys.executable, "-m", "dronecats.flight.processes.guard", *self._arguments],
                cwd=self.folder,
                env=self._environment,
                stdin=subprocess.PIPE,
                stdout=log,
                stderr=log,
                start_new_session=True,  # a Ctrl-C in the terminal does not reach PX4
            )


def arguments(command: str, instance: int) -> list[str]:
    """Return a command's words with the instance filled in and existing paths made absolute. Raises UsageError."""
    try:
        words = [word.replace(INSTANCE, str(instance)) for word in shlex.split(command)]
    except ValueError as error:
        raise UsageError(f"--px4 {command!r} is not a valid command line: {error}") from None
    if not words or shutil.which(words[0]) is None:
        raise UsageError(
            f"--px4 {command!r} is not a program that can be run. Give the path of PX4, or of a script that starts it"
        )
    return [os.path.abspath(word) if os.sep in word and os.path.exists(word) else word for word in words]


def environment(instance: int, speed: float) -> dict[str, str]:
    """Return this process's environment without API keys, with the variables of PX4's start script."""
    ours = keyless_environment(os.environ)
    if "PX4_SYS_AUTOSTART" not in ours:
        ours.setdefault("PX4_SIM_MODEL", MODEL)
    ours["PX4_INSTANCE"] = str(instance)
    if speed > 1.0:  # PX4 multiplies its timeouts by this factor, so that their wall time stays the same
        ours["PX4_SIM_SPEED_FACTOR"] = f"{speed:g}"
    ours["PYTHONPATH"] = os.pathsep.join(filter(None, (str(ROOT), ours.get("PYTHONPATH"))))
    return ours


INSTANCES = 10  # PX4 gives only this many instances an offboard port of their own
UDP_PORTS = (AGENT_PORT, AGENT_LOCAL, GCS_LOCAL, TRUTH_LOCAL)  # UDP ports that an instance needs besides its TCP port
ULOGS = "log/*/*.ulg"  # PX4's logs in its working folder
IDLE_S = 0.02  # wall seconds between two checks for a PX4 that has not connected yet


def free_servers(count: int) -> list[SimulatorServer]:
    """Return the TCP servers for the first `count` consecutive instances of PX4 whose ports are free.

    The servers keep their ports, so that another flight chooses other instances. Raises UsageError if too few
    are free.
    """
    for first in range(INSTANCES - count + 1):
        with ExitStack() as opened, suppress(UsageError):
            servers = [opened.enter_context(closing(_free_server(first + k))) for k in range(count)]
            opened.pop_all()  # the servers stay open
            return servers
    raise UsageError(
        f"PX4's instances 0 to {INSTANCES - 1} have no {count} consecutive instances with free ports (TCP {PORT} to"
        f" {PORT + INSTANCES - 1}). Stop another simulator or PX4"
    )


def _free_server(instance: int) -> SimulatorServer:
    """Return the server of an instance. Raises UsageError if one of the instance's ports is in use."""
    server = SimulatorServer(PORT + instance)
    try:
        for port in UDP_PORTS:
            with socket.socket(type=socket.SOCK_DGRAM) as trial:
                trial.bind(("", port + instance))
    except OSError as error:
        server.close()
        raise UsageError(f"PX4's instance {instance} has a port that is in use: {error.strerror}") from None
    return server


def _servers(config: SimulatorConfig, count: int) -> list[SimulatorServer]:
    """Return the servers to which the PX4s connect. Raises UsageError."""
    if config.instance is None and INSTANCE in (config.px4 or ""):
        return free_servers(count)
    instead = f"write {INSTANCE} into --px4" if config.instance is None else "choose another --instance"
    return [SimulatorServer(PORT + (config.instance or 0) + k, instead=instead) for k in range(count)]


def _state_name(index: int) -> str:
    """Return the name of the folder in which a vehicle's PX4 runs."""
    return f"vehicle-{index + 1}"


def _print_line(line: str) -> None:
    sys.stderr.write(f"{line}\n")


class Px4Simulator(PacedSimulator[Px4Vehicle]):
    """The simulator with PX4. Once every PX4 has connected, a call of `turn` simulates one tick."""

    def __init__(
        self, config: SimulatorConfig, notify: Callable[[str], None] = _print_line, world: World | None = None
    ) -> None:
        """`notify` receives progress lines; `world`: the episode's world, if already loaded. Raises UsageError.

        `config.instance` None: a free instance if the command has the placeholder INSTANCE, else 0. Without a
        `state_dir`, PX4 runs in a temporary folder.
        """
        world = world or load_world(config.episode)
        super().__init__(config, world)
        command = config.px4
        airframes.require_quadrotor(airframes.load(config.airframe))
        self._notify, self._restarts = notify, config.restart
        self.speed = config.speed
        with ExitStack() as stack:
            self._passing = stack.enter_context(TemporaryDirectory(prefix="dronecats-px4-", ignore_cleanup_errors=True))
            self._servers = _servers(config, config.count or len(world.record.starts))
            for server in self._servers:
                stack.callback(server.close)
            self.instance = self._servers[0].port - PORT
            self.simulation = build(self._vehicle, world, config)
            self.vehicles = self.simulation.vehicles
            for vehicle in self.vehicles:
                vehicle.plant.advance(0)  # compiles the physics on the first run of an installation
            self._truth = truth_port(self.simulation.bus, config.instance)
            stack.callback(self._truth.close)
            self._in_step = [False] * len(self.vehicles)
            self._started_at = [0] * len(self.vehicles)
            self._processes: list[Px4Process] = []
            if config.keep_ulogs:
                stack.callback(self._keep_ulogs, Path(config.keep_ulogs), Path(config.state_dir or self._passing))
            if command is not None:
                for vehicle in self.vehicles:
                    self._processes.append(self._px4(command, vehicle.index, config))
                    stack.callback(self._processes[-1].close)
            self._stack = stack.pop_all()
        self._reset_pace()
        if command is None:
            ports = ", ".join(str(server.port) for server in self._servers)
            notify(f"waiting for PX4 on TCP port {ports}; the simulated time stands still until it connects")

    def _vehicle(self, index: int, airframe: Airframe, pose: BootPose, **physics: Unpack[Physics]) -> Px4Vehicle:
        return Px4Vehicle(index, airframe, pose, server=self._servers[index], **physics)

    def _px4(self, command: str, index: int, config: SimulatorConfig) -> Px4Process:
        name = _state_name(index)
        folder = Path(config.state_dir or self._passing).absolute() / name
        log = Path(config.log_dir).absolute() / f"px4-{name}.log" if config.log_dir else folder / "px4.log"
        return Px4Process(command, self.instance + index, folder, log, self.speed or 1.0)

    def _keep_ulogs(self, kept: Path, states: Path) -> None:
        """Copy the newest log of every PX4. Call it after all PX4 processes have ended."""
        for vehicle in self.vehicles:
            logs = sorted((states / _state_name(vehicle.index)).glob(ULOGS), key=lambda log: log.stat().st_mtime)
            if not logs:
                self._notify(f"vehicle {vehicle.index + 1}: PX4 wrote no log")
                continue
            shutil.copyfile(logs[-1], kept / onboard_log_name(vehicle.index))

    def _reset_pace(self) -> None:
        super()._reset_pace()
        self._began_s, self._began_us = time.monotonic(), self.simulation.time_us

    def summary(self) -> str:
        """Return the vehicle time since PX4 connected, and the ratio of vehicle time to wall time."""
        seconds, wall_s = (self.simulation.time_us - self._began_us) / 1e6, time.monotonic() - self._began_s
        return f"{seconds:.1f} s of vehicle time at {seconds / max(wall_s, 1e-3):.1f} × real time"

    @property
    def all_there(self) -> bool:
        """Whether a PX4 has connected to every vehicle. Until then vehicle time stands still."""
        return all(vehicle.server.connections for vehicle in self.vehicles)

    def ready(self) -> dict[str, Any]:
        self._reset_pace()
        agent = [AGENT_PORT + self.instance + vehicle.index for vehicle in self.vehicles]
        px4 = [vehicle.server.port for vehicle in self.vehicles]
        return {"agent": agent, "log": [], "truth": self._truth.port, "px4": px4}

    def do(self, command: str, arguments: dict[str, Any]) -> Any:
        return all(self._in_step) if command == "in step" else super().do(command, arguments)

    def turn(self) -> None:
        self._look_after()
        if not self.all_there:
            for vehicle in self.vehicles:
                vehicle.server.accept()
            time.sleep(IDLE_S)
            self._reset_pace()
            return
        self._truth.exchange()
        self.simulation.advance()
        self._truth.exchange()
        self._staller.turn(self.simulation.time_us)
        if self.speed is not None:
            self._keeper.wait()

    def orphaned(self) -> None:
        """End every wait, because the parent process is gone."""
        for vehicle in self.vehicles:
            vehicle.released = True

    def close(self) -> None:
        self._stack.close()

    def _look_after(self) -> None:
        """Report changed connections, and restart PX4s that have ended.

        Raises InfrastructureError if restarts are off, or if PX4 never answered after its start.
        """
        for k, vehicle in enumerate(self.vehicles):
            if vehicle.in_step != self._in_step[k]:
                self._in_step[k] = vehicle.in_step
                lost = "does not answer" if vehicle.server.connected else "has gone"
                change = "is in step" if vehicle.in_step else f"{lost}, and the rotors stop"
                self._notify(f"vehicle {k + 1}: PX4 {change}, at {vehicle.time_us / 1e6:.1f} s")
        for k, process in enumerate(self._processes):
            status = process.poll()
            if status is None:
                continue
            if not self._restarts or self.vehicles[k].answers == self._started_at[k]:
                reason = f"PX4 ended with exit status {status}. See its output in {process.log}"
                self._notify(reason)
                raise InfrastructureError(reason)
            self._notify(f"vehicle {k + 1}: PX4 ended with exit status {status} and is restarted")
            self._started_at[k] = self.vehicles[k].answers
            process.restart()
