"""What a page shows of a flight at one moment, wherever it comes from: a live run folder, a wire, or a recording."""

from dataclasses import dataclass, field

from episodes.maps.scene import Moved
from foundation.frames import Quat, Vec3
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
