"""Builds the world of an episode, and moves the poses of a vehicle from another world onto the episode's map."""

from dataclasses import dataclass

from dronecats.flight.sitl.config import AIRFRAME
from episodes.maps.assets.multirotor import outline
from episodes.records import catalogue
from episodes.records.record import EpisodeRecord
from episodes.world.world import World
from foundation.conditions import AS_BUILT, SceneConditions
from foundation.frames import Vec3, geodetic_to_ned, quat_from_euler, quat_multiply, quat_yaw, rotate, wrap_pi
from foundation.mavlink import dialect
from foundation.truth import Origin, TruthSample, truth_sample
from vehicles import airframe as airframes


def load_world(
    episode: str, airframe: str | None = None, count: int | None = None, conditions: SceneConditions = AS_BUILT
) -> World:
    """Return the world of an episode id or file. Raises UsageError.

    Pictures show the drones with the shape of `airframe` (None: the default airframe). `count`: number of drones; None:
    one for each start of the record.
    """
    return world_of(catalogue.load(episode), airframe, count, conditions)


def world_of(
    record: EpisodeRecord, airframe: str | None = None, count: int | None = None, conditions: SceneConditions = AS_BUILT
) -> World:
    """Return the world of a record; other arguments as in `load_world`. Raises UsageError."""
    return World(record, outline(airframes.load(airframe or AIRFRAME)), count, conditions)


def origin(world: World) -> Origin:
    """Return latitude (°), longitude (°) and altitude (m above mean sea level) of the map's NED origin."""
    return world.scene.latitude_deg, world.scene.longitude_deg, world.scene.altitude_m


@dataclass(frozen=True, slots=True)
class Placement:
    """The transform from a vehicle's own world to the map: a shift and a rotation about the vertical."""

    home: Origin  # lat °, lon °, alt m of the vehicle's first pose
    place_ned: Vec3  # m, map frame, position of the first pose on the map
    turn: float  # rad, heading on the map minus heading in the vehicle's own world, clockwise positive

    def sample(self, message: dialect.MAVLink_message, time_us: int, drone: int = 0) -> TruthSample:
        """Return the sample on the map for a HIL_STATE_QUATERNION."""
        there = truth_sample(message, self.home)
        turned = quat_from_euler(0.0, 0.0, self.turn)
        return TruthSample(
            drone,
            time_us,
            self._moved(there.position_ned),
            rotate(turned, there.velocity_ned),
            quat_multiply(turned, there.attitude),
        )

    def on_map(self, place: Origin) -> Vec3:
        """Return the position on the map (m, NED) for a position in the vehicle's own world (lat °, lon °, alt m)."""
        return self._moved(geodetic_to_ned(*self.home, *place))

    def _moved(self, position_ned: Vec3) -> Vec3:
        north, east, down = rotate(quat_from_euler(0.0, 0.0, self.turn), position_ned)
        return (self.place_ned[0] + north, self.place_ned[1] + east, self.place_ned[2] + down)


def placement_of(message: dialect.MAVLink_message, place_ned: Vec3, yaw: float) -> Placement:
    """Return the placement that moves the pose in a HIL_STATE_QUATERNION to `place_ned` (m) and `yaw` (rad)."""
    home = (message.lat / 1e7, message.lon / 1e7, message.alt / 1e3)
    return Placement(home, place_ned, wrap_pi(yaw - quat_yaw(tuple(message.attitude_quaternion))))
