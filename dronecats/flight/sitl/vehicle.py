"""What every simulated vehicle is, whoever flies it: a body in the world, and the word of where it truly is."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Required, TypedDict, Unpack

import numpy as np

from dronecats.flight.disturbances import VehicleFaults
from dronecats.flight.sitl.collisions import CollisionReport
from foundation.airframe import Airframe
from foundation.camera import CameraModel
from foundation.frames import Vec3
from foundation.mavlink import Packer
from foundation.obstacles import OPEN, Obstacles
from foundation.terrain import FLAT, HeightField
from foundation.truth import TRUTH_COMPONENT, Origin, truth_message
from vehicles.faults import Fault
from vehicles.multirotor import Multirotor
from vehicles.payload import laden
from vehicles.sensors import Suite
from vehicles.wind import CALM, Wind

STEP_US = 1_000  # plant and inner loop
TICK_US = 10_000  # commander, MAVLink and truth


@dataclass(frozen=True, slots=True)
class BootPose:
    """Where a vehicle stands at boot."""

    position_ned: Vec3  # m, map frame, on the ground
    yaw: float  # rad


class Physics(TypedDict, total=False):
    """What else a plant is made with; what is left out is as `Multirotor` has it."""

    seed: Required[int]  # of all that is random about the vehicle
    origin: Required[Origin]
    terrain: HeightField
    obstacles: Obstacles
    payload_kg: float
    wind: Wind
    faults: Sequence[Fault]
    suite: Suite


class Vehicle:
    """A plant that tells its truth. Who flies it is added by those that inherit, in `advance`."""

    def __init__(self, index: int, airframe: Airframe, pose: BootPose, **physics: Unpack[Physics]) -> None:
        """Boot vehicle `index` of a fleet, counted from 0. Raises UsageError as `Multirotor` does."""
        self.index = index
        self.airframe = airframe  # as those who fly it know it
        self.origin = physics["origin"]
        self._suite = physics.get("suite", Suite())
        self.plant = Multirotor(
            laden(airframe, physics.get("payload_kg", 0.0)),
            seed=physics["seed"],
            origin=physics["origin"],
            terrain=physics.get("terrain", FLAT),
            obstacles=physics.get("obstacles", OPEN),
            camera_frd=CameraModel().offset_frd,
            position_ned=pose.position_ned,
            yaw=pose.yaw,
            wind=physics.get("wind", CALM),
            suite=self._suite,
            faults=physics.get("faults", ()),
        )
        self._packer = Packer(index + 1, TRUTH_COMPONENT)
        # position to acceleration of TRUTH as one array of numbers: a record's fields are slow to read one by one
        self._numbers = np.frombuffer(self.plant.truth, np.float64)[1:17]
        self._collisions = CollisionReport(self.plant)

    def meet(self, disturbances: VehicleFaults) -> None:
        """From now on be disturbed by wind, gusts and worse sensors. Raises UsageError for sensors that cannot be."""
        self.plant.meet(Wind(disturbances.wind_ned, disturbances.gusts_w20))
        self.plant.sense(
            self._suite.worsened(
                gps_delay_s=disturbances.gps_delay_s,
                gps_noise=disturbances.gps_noise,
                noise=disturbances.estimator_noise,
            )
        )

    def advance(self) -> None:
        """Advance by one tick."""
        raise NotImplementedError

    def close(self) -> None:
        """Let go of what the vehicle holds."""

    @property
    def time_us(self) -> int:
        return int(self.plant.truth["time_us"])

    def truth(self) -> bytes:
        """Return HIL_STATE_QUATERNION as bytes."""
        n, e, d, vn, ve, vd, w, x, y, z, p, q, r, ax, ay, az = self._numbers.tolist()
        return self._packer.pack(
            truth_message(
                self.time_us, (n, e, d), (vn, ve, vd), (w, x, y, z), (p, q, r), (ax, ay, az), self.origin,
            )
        )  # fmt: skip

    def collisions(self) -> bytes:
        """Return a STATUSTEXT about what was hit since the last call as bytes, empty when nothing was."""
        message = self._collisions.message()
        return self._packer.pack(message) if message else b""
