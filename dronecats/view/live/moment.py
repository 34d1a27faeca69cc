"""One moment of a flight as pages show it, from a live run folder, a simulator or a recording."""

from dataclasses import dataclass, field

from dronecats.agent.action import ActionError, Go, action_from
from dronecats.agent.controller import displacement
from episodes.maps.scene import Moved
from foundation.camera import CameraModel
from foundation.frames import Quat, Vec3, rotate
from foundation.run_folder.rows import Decision


@dataclass(frozen=True, slots=True)
class ShownPicture:
    """What a pilot was shown."""

    frame_id: int
    jpeg: bytes
    t_s: float | None  # s since the episode began, when it was taken; None: nobody has said so yet


@dataclass(frozen=True, slots=True)
class DroneMoment:
    """One drone."""

    drone: int  # 0 is the first
    position_ned: Vec3 | None = None  # m, map frame, of the body; None: not heard yet
    attitude: Quat = (1.0, 0.0, 0.0, 0.0)  # w, x, y, z, FRD → NED
    velocity_ned: Vec3 | None = None  # m/s
    height_m: float | None = None  # m of the body above the ground, above the map's origin where no ground is known
    true: bool = False  # the pose is the truth bus's; else its autopilot's own
    setpoint_ned: Vec3 | None = None  # m/s, the velocity that it is told, map frame
    mode: str = ""  # as PX4 names it; "": not heard
    armed: bool | None = None
    battery: float | None = None  # 0 … 1
    said: tuple[str, ...] = ()  # newest last: warnings of the autopilot, and what the envelope limited
    prompt: str = ""  # the text of the question of the newest decision; "": not known
    picture: ShownPicture | None = None  # the newest that the pilot was asked about
    decision: Decision | None = None  # the newest
    decided_on: ShownPicture | None = None  # the picture of that decision
    chosen_ned: Vec3 | None = None  # m, map frame, the place that a go names; None of another action
    lens_ned: Vec3 | None = None  # m, map frame, the optical centre from which it was chosen


@dataclass(frozen=True, slots=True)
class JudgeMoment:
    """What only the judge knows; a page hides it until it is asked for."""

    target_ned: Vec3 | None = None  # m, map frame, of its centre
    distance_m: tuple[float | None, ...] = ()  # m, of each drone to the target's centre
    said: tuple[str, ...] = ()  # newest last: declarations with their distances, the verdict


@dataclass(frozen=True, slots=True)
class Moment:
    """One flight at one time."""

    t_s: float  # s of vehicle time since the episode began; before it, negative or 0
    drones: tuple[DroneMoment, ...]
    judge: JudgeMoment = JudgeMoment()
    moved: Moved = field(default_factory=dict)  # where what moves in the pictures is, but for drones
    state: str = ""  # in a few words: waiting, in the air, over: cap …
    rate_hz: float | None = None  # decisions per s of vehicle time, the newest
    instruction: str = ""  # what is to be done; "": not known


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
