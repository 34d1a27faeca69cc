"""Simulates the fleet of an episode record on one clock, each vehicle with the project's autopilot.

The plant (physics) and the inner loop (estimator and controller) of a vehicle run in one compiled loop (`fused.py`).
The autopilot's commander (modes and commands) runs outside of this loop, at 100 Hz. The simulation publishes the truth
(the true state of all vehicles) on a bus within this process.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, Required, TypedDict, TypeVar, Unpack

from autopilot.autopilot import Autopilot
from autopilot.control.flight_core import FlightCore
from dronecats.flight.sitl.collisions import CollisionReport, Encounters, Traffic
from dronecats.flight.sitl.config import SimulatorConfig, noise_seed
from dronecats.flight.sitl.episode_world import origin
from dronecats.flight.sitl.failures import Failures
from dronecats.flight.sitl.fused import Fused
from dronecats.flight.sitl.pace import PaceReport, RateKeeper, Staller
from dronecats.flight.spec.disturbances import VehicleFaults
from episodes.world.obstacles import obstacles
from episodes.world.world import World
from foundation.airframe import Airframe
from foundation.camera import CameraModel
from foundation.frames import Vec3
from foundation.mavlink import Packer
from foundation.record_reader import reader
from foundation.sensors import TRUTH
from foundation.terrain import FLAT, OPEN, HeightField, Obstacles
from foundation.truth import TRUTH_COMPONENT, Origin, gimbal_message, truth_message
from vehicles import airframe as airframes
from vehicles import fault_script
from vehicles.airframe import with_payload
from vehicles.faults import Fault
from vehicles.gimbal import Gimbal
from vehicles.multirotor import Multirotor
from vehicles.sensors import Suite
from vehicles.wind import Wind

STEP_US = 1_000  # period of plant and inner loop
TICK_US = 10_000  # period of commander and MAVLink
FINER_US = (5_000, 2_000)  # steps within a tick, for telemetry up to 200 Hz and up to 500 Hz; above 500 Hz: STEP_US
TRUTH_US = 20_000  # period at which the truth is published, 50 Hz


class Tap:
    """A subscription to the truth bus."""

    def __init__(self, bus: "TruthBus") -> None:
        self._bus = bus
        self._queue = bytearray()

    def take(self) -> bytes:
        """Return the bytes that were published since the last call, except this subscriber's own."""
        if not self._queue:
            return b""
        data = bytes(self._queue)
        self._queue.clear()
        return data

    def receive(self, data: bytes) -> None:
        """Publish bytes from this subscriber to all others."""
        self._bus.publish(data, but=self)

    def put(self, data: bytes) -> None:
        self._queue += data


class TruthBus:
    """The truth bus within one process. It passes the bytes of a subscriber to all others."""

    def __init__(self) -> None:
        self._taps: list[Tap] = []

    def tap(self) -> Tap:
        tap = Tap(self)
        self._taps.append(tap)
        return tap

    @property
    def has_listeners(self) -> bool:
        return bool(self._taps)

    def publish(self, data: bytes, but: Tap | None = None) -> None:
        if not data:
            return
        for tap in self._taps:
            if tap is not but:
                tap.put(data)


@dataclass(frozen=True, slots=True)
class BootPose:
    position_ned: Vec3  # m, map frame, on the ground
    yaw: float  # rad


class Physics(TypedDict, total=False):
    """Arguments of `Vehicle` for its plant. Defaults: as in `Multirotor`; `payload_kg`: 0."""

    seed: Required[int]  # seeds all random values of the vehicle
    origin: Required[Origin]
    terrain: HeightField
    obstacles: Obstacles
    payload_kg: float
    faults: Sequence[Fault]
    suite: Suite


class Vehicle:
    """A plant, and the messages about its true state and its collisions. Subclasses add the autopilot in `advance`."""

    def __init__(self, index: int, airframe: Airframe, pose: BootPose, **physics: Unpack[Physics]) -> None:
        """Boot vehicle `index` of a fleet, counted from 0. Raises UsageError as `Multirotor` does."""
        self.index = index
        self.airframe = airframe  # without the payload, which the autopilot does not know
        self.origin = physics["origin"]
        self._suite = physics.get("suite", Suite())
        self.plant = Multirotor(
            with_payload(airframe, physics.get("payload_kg", 0.0)),
            seed=physics["seed"],
            origin=physics["origin"],
            terrain=physics.get("terrain", FLAT),
            obstacles=physics.get("obstacles", OPEN),
            camera_frd=CameraModel().offset_frd,
            position_ned=pose.position_ned,
            yaw=pose.yaw,
            suite=self._suite,
            faults=physics.get("faults", ()),
        )
        self._packer = Packer(index + 1, TRUTH_COMPONENT)
        self._truth, self._time = reader(self.plant.truth, *TRUTH.names or ()), reader(self.plant.truth, "time_us")
        self._collisions = CollisionReport(self.plant)
        mount = airframe.camera
        self.gimbal = Gimbal(mount.gimbal, mount.pitch_deg) if mount.gimbal else None

    def disturb(self, disturbances: VehicleFaults) -> None:
        """Apply wind, gusts and worse sensors from now on. Raises UsageError for a GPS delay that is too long."""
        self.plant.set_wind(Wind(disturbances.wind_ned, disturbances.gusts_w20))
        self.plant.set_sensor_suite(
            self._suite.degraded(
                gps_delay_s=disturbances.gps_delay_s,
                gps_noise=disturbances.gps_noise,
                noise=disturbances.estimator_noise,
            )
        )

    def advance(self) -> None:
        raise NotImplementedError

    def close(self) -> None:
        """Release the vehicle's resources."""

    @property
    def time_us(self) -> int:
        return int(self._time()[0])

    def truth(self) -> bytes:
        """Return HIL_STATE_QUATERNION as bytes, with GIMBAL_DEVICE_ATTITUDE_STATUS before it if there is a gimbal."""
        time_us, n, e, d, vn, ve, vd, w, x, y, z, p, q, r, ax, ay, az = self._truth()
        pointed = self._packer.pack(gimbal_message(time_us, self.gimbal.attitude((w, x, y, z)))) if self.gimbal else b""
        return pointed + self._packer.pack(
            truth_message(
                time_us, (n, e, d), (vn, ve, vd), (w, x, y, z), (p, q, r), (ax, ay, az), self.origin,
            )
        )  # fmt: skip

    def collisions(self) -> bytes:
        """Return a STATUSTEXT about a new hit, or about the end of a contact, as bytes; empty if there is none."""
        message = self._collisions.message()
        return self._packer.pack(message) if message else b""


class VehiclePort:
    """A vehicle's MAVLink port, which survives reboots: it forwards to a port of the current autopilot."""

    def __init__(self, autopilot: Autopilot, profile: str) -> None:
        """Open a port of `profile`. Raises UsageError for an unknown profile."""
        self._profile = profile
        self._port = autopilot.open_port(profile)
        self._last_words = b""

    def take(self) -> bytes:
        data, self._last_words = self._last_words, b""
        return data + self._port.take()

    def receive(self, data: bytes) -> None:
        """Pass bytes of a client to the vehicle. `autopilot.autopilot.handle` gets each decoded message."""
        self._port.receive(data)

    def note_malformed(self) -> None:
        """Make the vehicle report that it received bytes that are not MAVLink."""
        self._port.note_malformed()

    def move(self, autopilot: Autopilot) -> None:
        """Forward to an autopilot that has just booted. Unsent bytes of the former autopilot are kept."""
        self._last_words, signing = self.take(), self._port.signing
        self._port = autopilot.open_port(self._profile)
        self._port.signing = signing  # a reboot keeps the key, which PX4 stores on its memory card

    def sign(self, key: bytes, timestamp: int, now_us: int) -> None:
        """Sign messages and check signatures with a key.

        `now_us`: vehicle time (µs). `timestamp`: calendar time at `now_us`, in units of 10 µs since 2015.
        """
        self._port.signing.set_up(key, timestamp, now_us)


V = TypeVar("V", bound=Vehicle)


class SimulatedVehicle(Vehicle):
    """One vehicle with the project's autopilot: physics, inner loop, commander."""

    def __init__(
        self,
        index: int,
        airframe: Airframe,
        pose: BootPose,
        *,
        state_dir: Path | None = None,
        **physics: Unpack[Physics],
    ) -> None:
        """`state_dir` keeps parameters, plans, flight logs and clients' files. Without it, they are lost at the end."""
        super().__init__(index, airframe, pose, **physics)
        self._state_dir = state_dir
        self._failures = Failures(self.plant, physics.get("faults", ()))
        self._ports: list[VehiclePort] = []
        self._boot()

    def advance(self) -> None:
        """Advance by one tick: physics, estimator and controller each ms, then commander and MAVLink once."""
        if self.autopilot.stream_us < TICK_US:
            self._stream_through(self.autopilot.stream_us)
        else:
            self._fused.advance(TICK_US // STEP_US)
        if self.gimbal:
            self.gimbal.advance(TICK_US / 1e6)
        self.autopilot.update()
        if self.autopilot.reboot_requested:
            self._reboot()

    def _stream_through(self, interval_us: int) -> None:
        """Advance by one tick in steps of at most `interval_us` (of the fastest stream).

        After each step, queue the telemetry that is due; after the last step, `Autopilot.update` does this.
        """
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
            gimbal=self.gimbal,
        )
        self._fused = Fused(self.plant.kernel_args, self.core.kernel_args(self.plant.sensors, self.plant.actuators))

    def _reboot(self) -> None:
        """Put the vehicle back on its boot pose and boot its autopilot. The clock, which the fleet shares, runs on."""
        former = self.autopilot
        former.close()
        self.plant.restore()
        if self.gimbal:
            self.gimbal.restore()
        self._boot()
        self.autopilot.adopt(former)  # keeps parameters and plans, even without a state_dir
        for port in self._ports:
            port.move(self.autopilot)

    def open_port(self, profile: str) -> VehiclePort:
        """Return a MAVLink port that survives a reboot; `profile` as in `Autopilot.open_port`."""
        port = VehiclePort(self.autopilot, profile)
        self._ports.append(port)
        return port

    def sign(self, key: bytes, timestamp: int) -> None:
        """Sign messages and check signatures on every open port. `timestamp`: now, in units of 10 µs since 2015."""
        for port in self._ports:
            port.sign(key, timestamp, self.time_us)

    def close(self) -> None:
        """Finish the flight log."""
        self.autopilot.close()


class Simulation(Generic[V]):
    """Simulates a fleet and the moving target (`traffic`) on one clock, and publishes the truth on `bus`."""

    def __init__(
        self,
        vehicles: Sequence[V],
        traffic: Traffic | None = None,
        disturbances: VehicleFaults | None = None,
        *,
        from_boot: bool = False,
    ) -> None:
        """`disturbances` act on every vehicle from the episode's start, or from boot with `from_boot`."""
        self.vehicles = tuple(vehicles)
        self._disturbances = disturbances
        self.bus = TruthBus()
        self.traffic = traffic
        self._plants = tuple(vehicle.plant for vehicle in vehicles)
        self._encounters = Encounters(self._plants)
        self.time_us = self.vehicles[0].time_us  # cached, because it is read several times a tick
        if from_boot:
            self._disturb()

    def begin(self, t0_us: int) -> None:
        """Begin the episode at this vehicle time: start the target's motion and the disturbances."""
        if self.traffic:
            self.traffic.begin(t0_us)
        self._disturb()

    def _disturb(self) -> None:
        if self._disturbances:
            for vehicle in self.vehicles:
                vehicle.disturb(self._disturbances)

    def advance(self) -> None:
        """Advance every vehicle by one tick; publish its collisions, and the truth at 50 Hz."""
        if self.traffic:
            self.traffic.place(self._plants, self.time_us)
        self._encounters.part(TICK_US / 1e6)
        for vehicle in self.vehicles:
            vehicle.advance()
            self.bus.publish(vehicle.collisions())
        self.time_us = self.vehicles[0].time_us
        if self.bus.has_listeners and self.time_us % TRUTH_US == 0:
            for vehicle in self.vehicles:
                self.bus.publish(vehicle.truth())


def boot_poses(world: World) -> list[BootPose]:
    """Return the boot pose of each drone of the record: on the ground below its start pose."""
    poses = []
    for start in world.record.starts:
        north, east, _ = start.position_ned
        poses.append(BootPose((north, east, world.ground_down(north, east)), math.radians(start.yaw_deg)))
    return poses


def build(make: Callable[..., V], world: World, config: SimulatorConfig) -> Simulation[V]:
    """Return the simulation that a configuration describes, in `world`. `make` has the arguments of `Vehicle`.

    Random values follow from the record's seed and from `config.seed`. All drones have the same faults and
    disturbances. A payload acts from boot. Raises UsageError for an unknown airframe, a payload that the airframe
    cannot carry or an impossible fault.
    """
    solid = obstacles(world.scene)
    frame = airframes.load(config.airframe)
    gps_delay_s = config.disturbances.gps_delay_s if config.disturbances else 0.0
    suite = Suite().degraded(gps_delay_s=gps_delay_s)  # the delays of GPS faults add to it
    faults = fault_script.load(Path(config.faults), len(frame.rotors), suite) if config.faults else ()
    poses, count = boot_poses(world), config.count
    while count is not None and len(poses) < count:  # each additional drone boots 2 m east of the previous one
        last = poses[-1].position_ned
        north, east = last[0], last[1] + 2.0
        poses.append(BootPose((north, east, world.ground_down(north, east)), poses[-1].yaw))
    return Simulation(
        [
            make(
                index,
                frame,
                pose,
                seed=noise_seed(world.record.seed, config.seed, index),
                origin=origin(world),
                terrain=world.scene.terrain,
                obstacles=solid,
                payload_kg=config.disturbances.payload_kg if config.disturbances else 0.0,
                faults=faults,
            )
            for index, pose in enumerate(poses[:count])
        ],
        Traffic(world.target_upright) if solid.moving else None,
        config.disturbances,
        from_boot=config.from_boot,
    )


class PacedSimulator(Generic[V]):
    """Base class of simulators that follow the wall clock. It implements `do` of `processes.child.Part`."""

    simulation: Simulation[V]
    speed: float | None  # factor on real time; None: as fast as possible

    def __init__(self, config: SimulatorConfig, world: World) -> None:
        self._staller = Staller(config.disturbances, noise_seed(world.record.seed, config.seed, 0))

    def _reset_pace(self) -> None:
        self._keeper = RateKeeper(TICK_US / 1e6 / (self.speed or 1.0))
        self.pace = PaceReport(self._keeper)

    def do(self, command: str, arguments: dict[str, Any]) -> Any:
        if command == "begin":
            self.simulation.begin(arguments["t0_us"])
            self._staller.begin(arguments["t0_us"])
        if command == "pace":
            return self._keeper.figures()
        return None
