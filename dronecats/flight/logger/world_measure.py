"""The measure of a flight in an episode's world. Apart from the others, which log where no world is installed."""

from collections.abc import Sequence

from dronecats.flight.logger.recorder import Measure
from episodes.world.fleet import DronePose
from episodes.world.world import World
from foundation.camera import CameraModel
from foundation.measurement import TargetMeasurement
from foundation.truth import TruthSample


def measured_in(world: World) -> Measure:
    """Return the measure of an episode's world, in which the other drones stand before the target, too."""

    def measure(
        t_s: float, sample: TruthSample, camera: CameraModel, others: Sequence[TruthSample]
    ) -> TargetMeasurement:
        around = [DronePose(one.position_ned, one.attitude) for one in others]
        return world.measure(t_s, sample.position_ned, sample.attitude, camera, around)

    return measure
