"""From a decision to the place in the world that it names: a ray through the pixel, as deep as the pilot said."""

from dataclasses import dataclass

from dronecats.agent.action import ActionError, Go, action_from
from dronecats.agent.controller import displacement
from foundation.camera import CameraModel
from foundation.frames import Quat, Vec3, rotate
from foundation.run_folder.rows import Decision


@dataclass(frozen=True, slots=True)
class ChosenSight:
    """The ray of a go, as the picture has it: where the drone was when that was taken, leaning as it leant."""

    lens_ned: Vec3  # m, map frame, the optical centre
    place_ned: Vec3  # m, map frame, on the ray, at the pilot's depth along the optical axis


def chosen_go(decision: Decision) -> Go | None:
    """Return the go of a decision, None of any other action and of what is none."""
    try:
        action = action_from(decision.action)
    except ActionError:
        return None
    return action if isinstance(action, Go) else None


def sight(go: Go, position_ned: Vec3, attitude: Quat, camera: CameraModel) -> ChosenSight:
    """Return the ray of a go from where its picture was taken: m NED of the body, attitude FRD → NED."""
    lens = _added(position_ned, rotate(attitude, camera.offset_frd))
    right, forward, up = displacement(go, camera)
    return ChosenSight(lens, _added(lens, rotate(attitude, (forward, right, -up))))


def _added(place: Vec3, way: Vec3) -> Vec3:
    return (place[0] + way[0], place[1] + way[1], place[2] + way[2])
