"""Vehicles with our autopilot on one clock: plant and inner loop fused in one compiled loop, commanders around it."""

from collections.abc import Sequence
from pathlib import Path
from typing import Generic, TypeVar, Unpack

from autopilot.autopilot import Autopilot
from autopilot.control.flight_core import FlightCore
from dronecats.flight.disturbances import VehicleFaults
from dronecats.flight.sitl.bus import TruthBus
from dronecats.flight.sitl.collisions import Encounters, Traffic
from dronecats.flight.sitl.failures import Failures
from dronecats.flight.sitl.fused import Fused
from dronecats.flight.sitl.vehicle import STEP_US, TICK_US, BootPose, Physics, Vehicle
from foundation.airframe import Airframe


class VehiclePort:
    """Leads to the port that the vehicle's present autopilot has opened for it."""

    def __init__(self, autopilot: Autopilot, profile: str) -> None:
        """Open a port of `profile`. Raises UsageError for an unknown one."""
        self._profile = profile
        self._port = autopilot.open_port(profile)
        self._last_words = b""

    def take(self) -> bytes:
        """Return what the vehicle has sent since the last call."""
        said, self._last_words = self._last_words, b""
        return said + self._port.take()

    def receive(self, data: bytes) -> None:
        """Let the vehicle hear this."""
        self._port.receive(data)

    def note_malformed(self) -> None:
        """Have the vehicle say that what came on this port was no MAVLink."""
        self._port.note_malformed()

    def move(self, autopilot: Autopilot) -> None:
        """Lead to an autopilot that has just booted; what the former one had still to say is kept."""
        self._last_words, signing = self.take(), self._port.signing
        self._port = autopilot.open_port(self._profile)
        self._port.signing = signing  # PX4 keeps the key on its memory card

    def sign(self, key: bytes, timestamp: int, now_us: int) -> None:
        """Sign with a key, and believe nobody else, from `timestamp` (10 µs since 2015) on, which is `now_us`."""
        self._port.signing.set_up(key, timestamp, now_us)


__all__ = ["STEP_US", "TICK_US", "BootPose", "SimulatedVehicle", "Simulation"]

FINER_US = (5_000, 2_000)  # steps within a tick, while a client wants messages at more than 100 Hz
TRUTH_US = 20_000  # 50 Hz
V = TypeVar("V", bound=Vehicle)


class SimulatedVehicle(Vehicle):
    """One vehicle under our autopilot: physics, inner loop, commander."""

    def __init__(
        self,
        index: int,
        airframe: Airframe,
        pose: BootPose,
        *,
        state_dir: Path | None = None,
        **physics: Unpack[Physics],
    ) -> None:
        """`state_dir` keeps parameters, plans, flight logs and clients' files; without it none outlives the process."""
        super().__init__(index, airframe, pose, **physics)
        self._state_dir = state_dir
        self._failures = Failures(self.plant, physics.get("faults", ()))
        self._ports: list[VehiclePort] = []
        self._boot()

    def advance(self) -> None:
        """Advance by one tick."""
        if self.autopilot.stream_us < TICK_US:
            self._stream_through(self.autopilot.stream_us)
        else:
            self._fused.advance(TICK_US // STEP_US)
        self.autopilot.update()
        if self.autopilot.reboot_requested:
            self._reboot()

    def _stream_through(self, interval_us: int) -> None:
        """Live through one tick in steps no longer than a stream's interval, and send what is due after each."""
        step_us = next((step for step in FINER_US if step <= interval_us), STEP_US)
        for _ in range(TICK_US // step_us - 1):
            self._fused.advance(step_us // STEP_US)
            self.autopilot.stream()
        self._fused.advance(step_us // STEP_US)

    def _boot(self) -> None:
        airframe, folder = self.airframe, self._state_dir
        self.core = FlightCore(airframe)
        self.autopilot = Autopilot(
            airframe,
            self.core,
            self.plant.sensors,
            system_id=self.index + 1,
            parameter_file=folder / "parameters.json" if folder else None,
            plan_file=folder / "plans.json" if folder else None,
            log_dir=folder / "log" if folder else None,
            card_dir=folder / "card" if folder else None,
            actuators=self.plant.actuators,
            inject=self._failures.inject,
        )
        self._fused = Fused(self.plant.kernel_args, self.core.kernel_args(self.plant.sensors, self.plant.actuators))

    def _reboot(self) -> None:
        """Stand the vehicle on its start place and boot its autopilot; its clock, which a fleet shares, goes on."""
        former = self.autopilot
        former.close()
        self.plant.restore()
        self._boot()
        self.autopilot.adopt(former)  # with a file or without
        for port in self._ports:
            port.move(self.autopilot)

    def open_port(self, profile: str) -> VehiclePort:
        """Return a MAVLink port that survives a restart; profiles as `Autopilot.open_port` has them."""
        port = VehiclePort(self.autopilot, profile)
        self._ports.append(port)
        return port

    def sign(self, key: bytes, timestamp: int) -> None:
        """Sign on every open port with a key, and believe nobody else; `timestamp`: now, 10 µs since 2015."""
        for port in self._ports:
            port.sign(key, timestamp, self.time_us)

    def close(self) -> None:
        """Finish the flight log."""
        self.autopilot.close()


class Simulation(Generic[V]):
    """A fleet on one clock, what moves in its world, and the bus its truth goes out on."""

    def __init__(
        self, vehicles: Sequence[V], traffic: Traffic | None = None, disturbances: VehicleFaults | None = None
    ) -> None:
        """`disturbances`: of every vehicle from the episode's beginning on; None: nothing changes then."""
        self.vehicles = tuple(vehicles)
        self._disturbances = disturbances
        self.bus = TruthBus()
        self.traffic = traffic
        self._plants = tuple(vehicle.plant for vehicle in vehicles)
        self._encounters = Encounters(self._plants)

    def begin(self, t0_us: int) -> None:
        """From this vehicle time on the target moves, and what is to be disturbed is."""
        if self.traffic:
            self.traffic.begin(t0_us)
        if self._disturbances:
            for vehicle in self.vehicles:
                vehicle.meet(self._disturbances)

    @property
    def time_us(self) -> int:
        return self.vehicles[0].time_us

    def advance(self) -> None:
        """Advance every vehicle by one tick, and publish what it hit and, when due, where it is."""
        if self.traffic:
            self.traffic.place(self._plants)
        self._encounters.part(TICK_US / 1e6)
        for vehicle in self.vehicles:
            vehicle.advance()
            self.bus.publish(vehicle.collisions())
        if self.bus.heard and self.time_us % TRUTH_US == 0:
            for vehicle in self.vehicles:
                self.bus.publish(vehicle.truth())
