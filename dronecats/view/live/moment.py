"""One moment of a flight as pages show it, from a live run folder, a simulator or a recording."""

from dataclasses import dataclass, field

from dronecats.agent.action import Go
from dronecats.agent.controller import displacement
from dronecats.report.recorded.flight import action_of
from episodes.maps.scene import Moved
from foundation.camera import CameraModel
from foundation.frames import Quat, Vec3, quat_from_euler, quat_yaw, rotate
from foundation.run_folder.rows import Decision


@dataclass(frozen=True, slots=True)
class ShownPicture:
    """A picture that a pilot got."""

    frame_id: int
    jpeg: bytes
    t_s: float | None  # s since the episode began, when the picture was taken; None: not known yet


@dataclass(frozen=True, slots=True)
class DroneMoment:
    drone: int  # 0 is the first
    position_ned: Vec3 | None = None  # m, map frame, of the body; None: not known yet
    attitude: Quat = (1.0, 0.0, 0.0, 0.0)  # w, x, y, z, FRD → NED
    velocity_ned: Vec3 | None = None  # m/s
    height_m: float | None = None  # m above the ground; above the map's origin when no ground is known
    true: bool = False  # True: the pose is the simulator's; False: the autopilot's estimate
    setpoint_ned: Vec3 | None = None  # m/s, commanded velocity, map frame
    mode: str = ""  # PX4's name of the mode; "": not known
    armed: bool | None = None
    battery: float | None = None  # 0 … 1
    messages: tuple[str, ...] = ()  # newest last: the autopilot's warnings, active safety limits, orders
    prompt: str = ""  # the prompt of `decision`; "": not known
    picture: ShownPicture | None = None  # the newest picture that the pilot got
    decision: Decision | None = None  # the newest decision
    decided_on: ShownPicture | None = None  # the picture of `decision`
    chosen_ned: Vec3 | None = None  # m, map frame, the point that the action `go` chose; None for other actions
    lens_ned: Vec3 | None = None  # m, map frame, the camera's optical centre when `decided_on` was taken


@dataclass(frozen=True, slots=True)
class JudgeMoment:
    """Data that only the judge has; a page hides them by default."""

    target_ned: Vec3 | None = None  # m, map frame, centre of the target
    distance_m: tuple[float | None, ...] = ()  # m, distance of each drone from the target's centre; None: not known
    messages: tuple[str, ...] = ()  # newest last: declarations with their distances, the verdict


@dataclass(frozen=True, slots=True)
class Moment:
    """The state of a flight at one time."""

    t_s: float  # s of vehicle time since the episode began, ≤ 0 before; with a simulator, the vehicle's clock
    drones: tuple[DroneMoment, ...]
    judge: JudgeMoment = JudgeMoment()
    moved: Moved = field(default_factory=dict)  # poses of moving objects other than drones
    state: str = ""  # for example "in the air" or "over: cap"
    rate_hz: float | None = None  # newest value of decisions per s of vehicle time
    instruction: str = ""  # "": not known


@dataclass(frozen=True, slots=True)
class ChosenSight:
    """The ray of a `go` action: from the camera to the chosen point, at the pose of the pilot's picture."""

    lens_ned: Vec3  # m, map frame, the optical centre
    place_ned: Vec3  # m, map frame, the chosen point: at the depth along the optical axis that the pilot gave


def chosen_go(decision: Decision) -> Go | None:
    """Return the action of a decision if it is a `go`; None for other actions, and for an invalid one."""
    action = action_of(decision)
    return action if isinstance(action, Go) else None


def sight(go: Go, position_ned: Vec3, attitude: Quat, camera: CameraModel) -> ChosenSight:
    """Return the ray of a `go`, from body position (m, NED), attitude (FRD → NED) and camera of the pilot's picture."""
    lens = _added(position_ned, rotate(attitude, camera.offset_frd))
    right, forward, up = displacement(go, camera)
    axes = quat_from_euler(0.0, 0.0, quat_yaw(attitude)) if camera.gimballed else attitude
    return ChosenSight(lens, _added(lens, rotate(axes, (forward, right, -up))))


def _added(place: Vec3, way: Vec3) -> Vec3:
    return (place[0] + way[0], place[1] + way[1], place[2] + way[2])
