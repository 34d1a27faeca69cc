"""The flight controller above its compiled inner loop: commander, modes, failsafes, parameters and MAVLink ports."""

from functools import partial
from pathlib import Path
from typing import Any, Protocol

from autopilot.commander.commander import Commander, SetpointWriter
from autopilot.commander.health import SensorCalibration
from autopilot.commander.plans import Plans
from autopilot.estimator.estimated_state import EstimatedState, Vibration
from autopilot.logging.flight_log import FlightLogWriter, LogDirectory, make_folder
from autopilot.mavlink import dispatch, mission
from autopilot.mavlink.node import Inject, Node, Uploads
from autopilot.mavlink.port import Port
from autopilot.mavlink.status_makers import TelemetrySource
from autopilot.parameters import ParameterTable
from foundation.airframe import Airframe

COMMANDER_US = 20_000  # 50 Hz: modes and failsafes change slowly, telemetry and the inner loop have rates of their own


class Core(Protocol):
    """The interface of the inner loop to the commander (`autopilot.control.flight_core.FlightCore`)."""

    estimate: Any  # ESTIMATE record, read
    state: Any  # its field `landed` is written: 1 while the vehicle stands
    setpoint: Any  # SETPOINT record, written

    def set_parameter(self, name: str, value: float) -> float | None: ...

    def parameter_defaults(self) -> dict[str, float]: ...


class Autopilot:
    """Flies one vehicle. Call `update` every 10 ms of vehicle time, after the inner loop has run.

    Pure: no socket, no thread, no wall clock. Time is `core.estimate.time_us`, or the sensors' before the first
    estimate. `actuators` (ACTUATORS record, read only) feeds SERVO_OUTPUT_RAW.
    `log_dir` (one per vehicle) receives a ULog file for every flight; without it nothing is logged.
    `card_dir` (one per vehicle) is the memory card, on which clients store files by MAVLink FTP.
    `inject` (unit, type, instance as in MAV_CMD_INJECT_FAILURE) breaks or mends a part of the simulated vehicle and
    returns whether it could; without it failure injection is unsupported.
    `parameter_file` and `plan_file` keep what a flight controller keeps without power; a missing one is begun.
    Raises UsageError when one of them exists but cannot be read, or `log_dir` or `card_dir` cannot be made.
    """

    def __init__(
        self,
        airframe: Airframe,
        core: Core,
        sensors: Any,
        *,
        system_id: int = 1,
        parameter_file: Path | None = None,
        plan_file: Path | None = None,
        log_dir: Path | None = None,
        card_dir: Path | None = None,
        actuators: Any | None = None,
        inject: Inject | None = None,
    ) -> None:
        self._core = core
        self._core_landed: bool | None = None
        self._commanded_us = -COMMANDER_US
        self.parameters = ParameterTable(core.parameter_defaults(), core.set_parameter, parameter_file)
        self.parameters.set("MAV_SYS_ID", system_id)
        self.parameters.set("MAV_TYPE", airframe.mav_type)
        self.state = EstimatedState(core.estimate, sensors)
        self.commander = Commander(self.state, self.parameters, SetpointWriter(core.setpoint), self._send_text)
        self._keep_plans(Plans(plan_file))
        self.calibration = SensorCalibration(self.state, self._send_text)
        self.vibration = Vibration()
        vehicle = TelemetrySource(
            airframe, self.state, self.commander, self.parameters, actuators, self.calibration, self.vibration
        )
        self.log = FlightLogWriter(vehicle, LogDirectory(log_dir)) if log_dir is not None else None
        if card_dir is not None:
            make_folder(card_dir)
        self.node = Node(vehicle, system_id, Uploads(), self.log, inject, card_dir)

    def update(self) -> None:
        """Run the commander once and queue the telemetry that is due on every port."""
        self.state.refresh()
        self.calibration.tick()
        now = self.state.time_us
        if not 0 <= now - self._commanded_us < COMMANDER_US:
            self._commanded_us = now
            self.vibration.take(self.state)
            self.commander.tick()
            self._update_core()
        if self.log is not None:
            self.log.tick()
        self.node.show_mode()
        mission.tell_progress(self.node)
        self.node.uploads.tick(self.state.time_us)
        for port in self.node.ports:
            port.tick()

    def stream(self) -> None:
        """Queue the telemetry that is due between two updates. Call it as often as `stream_us` asks for."""
        self.state.refresh()
        for port in self.node.ports:
            port.stream()

    @property
    def stream_us(self) -> int:
        """The interval (µs) of the fastest stream that a client has asked for; below 10 ms `stream` is wanted."""
        return self.node.shortest_us

    def close(self) -> None:
        """End the flight log that is being written, if any."""
        if self.log is not None:
            self.log.close()

    def open_port(self, profile: str) -> Port:
        """Return a new port with the stream rates of 'onboard' (PX4's 14540), 'gcs' (14550) or 'minimal'.

        Raises UsageError for another profile.
        """
        port = Port(self.node, profile, len(self.node.ports), partial(dispatch.handle, self.node))
        self.node.ports.append(port)
        self.node.find_shortest()
        return port

    def close_port(self, port: Port) -> None:
        """Forget a port. Raises ValueError when it is not open here."""
        self.node.ports.remove(port)
        self.node.find_shortest()

    @property
    def reboot_requested(self) -> bool:
        """True if a client has requested a restart. The owner of this object may grant it by making a new one."""
        return self.node.reboot_requested

    def adopt(self, former: "Autopilot") -> None:
        """Take over what outlives a restart: the parameters, the plans and the item of the mission that comes next."""
        for name in former.parameters.names:
            self.parameters.set(name, former.parameters[name])
        self._keep_plans(former.commander.flight.plans)

    def _keep_plans(self, plans: Plans) -> None:
        self.commander.flight.plans = plans
        if plans.current:
            self.commander.mission.rewind(plans.current)

    def _update_core(self) -> None:
        landed = self.commander.landed
        if landed != self._core_landed:
            self._core.state["landed"] = self._core_landed = landed

    def _send_text(self, severity: int, text: str) -> None:
        self.node.send_text(severity, text)
