"""What every simulated vehicle is, whoever flies it: a body in the world, and the word of where it truly is."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Required, TypedDict, Unpack

from dronecats.sitl.collisions import CollisionReport
from foundation.airframe import Airframe
from foundation.camera import CameraModel
from foundation.frames import Vec3
from foundation.mavlink import Packer
from foundation.obstacles import Obstacles
from foundation.terrain import HeightField
from foundation.truth import TRUTH_COMPONENT, Origin, truth_message
from vehicles.faults import Fault
from vehicles.multirotor import Multirotor
from vehicles.sensors import Suite
from vehicles.wind import Wind

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
    wind: Wind
    faults: Sequence[Fault]
    suite: Suite


class Vehicle:
    """A plant that tells its truth. Who flies it is added by those that inherit, in `advance`."""

    def __init__(self, index: int, airframe: Airframe, pose: BootPose, **physics: Unpack[Physics]) -> None:
        """Boot vehicle `index` of a fleet, counted from 0. Raises UsageError as `Multirotor` does."""
        self.index = index
        self.origin = physics["origin"]
        self.plant = Multirotor(
            airframe,
            camera_frd=CameraModel().offset_frd,
            position_ned=pose.position_ned,
            yaw=pose.yaw,
            **physics,
        )
        self._packer = Packer(index + 1, TRUTH_COMPONENT)
        self._collisions = CollisionReport(self.plant)

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
