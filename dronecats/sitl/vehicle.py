"""What every simulated vehicle is, whoever flies it: a body in the world, and the word of where it truly is."""

from collections.abc import Sequence
from dataclasses import dataclass

from dronecats.sitl.collisions import CollisionReport
from foundation.airframe import Airframe
from foundation.camera import CameraModel
from foundation.frames import Vec3
from foundation.mavlink import Packer
from foundation.obstacles import OPEN, Obstacles
from foundation.terrain import FLAT, HeightField
from foundation.truth import TRUTH_COMPONENT, Origin, truth_message
from vehicles.faults import Fault
from vehicles.multirotor import Multirotor
from vehicles.sensors import Suite
from vehicles.wind import CALM, Wind

STEP_US = 1_000  # plant and inner loop
TICK_US = 10_000  # commander, MAVLink and truth


@dataclass(frozen=True, slots=True)
class BootPose:
    """Where a vehicle stands at boot."""

    position_ned: Vec3  # m, map frame, on the ground
    yaw: float  # rad


class Vehicle:
    """A plant that tells its truth. Who flies it is added by those that inherit, in `advance`."""

    def __init__(
        self,
        index: int,
        airframe: Airframe,
        place: BootPose,
        *,
        seed: int,
        origin: Origin,
        terrain: HeightField = FLAT,
        obstacles: Obstacles = OPEN,
        wind: Wind = CALM,
        faults: Sequence[Fault] = (),
        suite: Suite | None = None,
    ) -> None:
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
            suite=suite,
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
