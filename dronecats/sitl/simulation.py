"""Vehicles with our autopilot on one clock: plant and inner loop fused in one compiled loop, commanders around it."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from autopilot.autopilot import Autopilot
from autopilot.flight_core import FlightCore
from dronecats.border.airframe import Airframe
from dronecats.border.camera import CameraModel
from dronecats.border.frames import Vec3
from dronecats.border.mavlink import Packer
from dronecats.border.obstacles import OPEN, Obstacles
from dronecats.border.terrain import FLAT, HeightField
from dronecats.border.truth import TRUTH_COMPONENT, Origin, truth_message
from dronecats.sitl.bus import TruthBus
from dronecats.sitl.collisions import CollisionReport, Encounters, Traffic
from dronecats.sitl.failures import Failures
from dronecats.sitl.fused import Fused
from dronecats.sitl.vehicle_port import VehiclePort
from vehicles.faults import Fault
from vehicles.multirotor import Multirotor
from vehicles.wind import CALM, Wind

STEP_US = 1_000  # plant and inner loop
TICK_US = 10_000  # commander, MAVLink and truth
FINER_US = (5_000, 2_000)  # steps within a tick, while a client wants messages at more than 100 Hz
TRUTH_US = 20_000  # 50 Hz


@dataclass(frozen=True, slots=True)
class Place:
    """Where a vehicle stands at boot."""

    position_ned: Vec3  # m, map frame, on the ground
    yaw: float  # rad


class SimulatedVehicle:
    """One vehicle: physics, inner loop, commander."""

    def __init__(
        self,
        index: int,
        airframe: Airframe,
        place: Place,
        *,
        seed: int,
        origin: Origin,
        terrain: HeightField = FLAT,
        obstacles: Obstacles = OPEN,
        wind: Wind = CALM,
        faults: Sequence[Fault] = (),
        state_dir: Path | None = None,
    ) -> None:
        """`state_dir` keeps parameters, plans and flight logs; without it none of them outlives the process."""
        self.index = index
        self.origin = origin
        self.plant = Multirotor(
            airframe,
            seed=seed,
            origin=origin,
            terrain=terrain,
            obstacles=obstacles,
            camera_frd=CameraModel().offset_frd,
            position_ned=place.position_ned,
            yaw=place.yaw,
            wind=wind,
            faults=faults,
        )
        self._state_dir = state_dir
        self._failures = Failures(self.plant, faults)
        self._ports: list[VehiclePort] = []
        self._boot()
        self._packer = Packer(index + 1, TRUTH_COMPONENT)
        self._collisions = CollisionReport(self.plant)

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
        airframe, folder = self.plant.airframe, self._state_dir
        self.core = FlightCore(airframe)
        self.autopilot = Autopilot(
            airframe,
            self.core,
            self.plant.sensors,
            system_id=self.index + 1,
            parameter_file=folder / "parameters.json" if folder else None,
            plan_file=folder / "plans.json" if folder else None,
            log_dir=folder / "log" if folder else None,
            actuators=self.plant.actuators,
            inject=self._failures.inject,
        )
        self._fused = Fused(self.plant.kernel_args, self.core.kernel_args(self.plant.sensors, self.plant.actuators))

    def _reboot(self) -> None:
        """Start estimator and autopilot anew where the vehicle is; its clock, which a fleet shares, goes on."""
        former = self.autopilot
        former.close()
        self._boot()
        self.autopilot.adopt(former)  # with a file or without
        for port in self._ports:
            port.move(self.autopilot)

    def open_port(self, profile: str) -> VehiclePort:
        """Return a MAVLink port that survives a restart; profiles as `Autopilot.open_port` has them."""
        port = VehiclePort(self.autopilot, profile)
        self._ports.append(port)
        return port

    def close(self) -> None:
        """Finish the flight log."""
        self.autopilot.close()

    @property
    def time_us(self) -> int:
        return int(self.plant.truth["time_us"])

    def truth(self) -> bytes:
        """Return HIL_STATE_QUATERNION as bytes."""
        truth = self.plant.truth
        return self._packer.pack(
            truth_message(
                int(truth["time_us"]),
                tuple(truth["position_ned"].tolist()),
                tuple(truth["velocity_ned"].tolist()),
                tuple(truth["attitude"].tolist()),
                tuple(truth["rates_frd"].tolist()),
                tuple(truth["accel_frd"].tolist()),
                self.origin,
            )
        )

    def collisions(self) -> bytes:
        """Return a STATUSTEXT about what was hit since the last call as bytes, empty when nothing was."""
        message = self._collisions.message()
        return self._packer.pack(message) if message else b""


class Simulation:
    """A fleet on one clock, what moves in its world, and the bus its truth goes out on."""

    def __init__(self, vehicles: Sequence[SimulatedVehicle], traffic: Traffic | None = None) -> None:
        self.vehicles = tuple(vehicles)
        self.bus = TruthBus()
        self.traffic = traffic
        self._plants = tuple(vehicle.plant for vehicle in vehicles)
        self._encounters = Encounters(self._plants)

    def begin(self, t0_us: int) -> None:
        """From this vehicle time on the target moves."""
        if self.traffic:
            self.traffic.begin(t0_us)

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
