"""Pushes a vehicle against obstacles (each push is a press): walls, posts, cars, trees, slopes, ground, on all maps.

In each press the vehicle takes off before an obstacle, flies into it at 1.2 m/s as for an agent's action `go`, keeps
pushing, and then backs off. From the first contact on, the true state is compared with the autopilot's estimate.
Prints one line per press, with the names of the exceeded limits:

    python -m benchmarks.presses [--seeds N] [--only WORD] [--jobs N] [--json] [--px4 COMMAND]
"""

import json
import math
import statistics
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.machine import benchmark_parser
from dronecats.flight.logger.estimator_resets import ResetWatch
from dronecats.flight.run.ascent import StartOffset, ascend
from dronecats.flight.sitl.episode_world import load_world, world_of
from dronecats.flight.sitl.simulation import TICK_US, BootPose, Vehicle
from dronecats.flight.spec.disturbances import VehicleFaults
from dronecats.flight.stages.lockstep import one_vehicle
from episodes.records import catalogue
from episodes.records.record import StartPose
from episodes.world.obstacles import obstacles
from episodes.world.world import World
from foundation.frames import Vec3, geodetic_to_ned, ned_to_geodetic, quat_yaw, rotate, wrap_pi
from foundation.mavlink import dialect
from foundation.setpoints import Velocity
from foundation.terrain import Obstacles
from hil.link.link import Link
from vehicles.solids import in_triangle

SPEED = 1.2  # m/s, as fast as the agent's controller flies
BEFORE_M = 3.0  # m of free way before the obstacle
ROOM_M = 3.0  # m; free room beyond this does not count in the comparison of an obstacle's sides
AHEAD_S = 12.0  # s within which the vehicle must meet the obstacle
BACK_S = 6.0
AWAY_M = 2.0  # m that the vehicle must back off within BACK_S, unless it meets another obstacle
TICK_S = TICK_US / 1e6
WATCHED = (
    dialect.MAVLINK_MSG_ID_ATTITUDE_QUATERNION,
    dialect.MAVLINK_MSG_ID_ODOMETRY,
    dialect.MAVLINK_MSG_ID_ESTIMATOR_STATUS,
    dialect.MAVLINK_MSG_ID_ATTITUDE_TARGET,
)
COMPARED = ("attitude_deg", "velocity_error", "position_error_m", "speed", "tilt_deg", "ratio")  # fields of `Outcome`


@dataclass(frozen=True, slots=True)
class Press:
    """An obstacle, and the course into it."""

    episode: str  # id of the episode whose map is used
    thing: str  # name of an object on the map, or 'ground'
    turn_deg: float = 0.0  # angle between the course and the nearest axis of the obstacle; 0: head-on
    beside: float = 0.0  # distance of the course from the obstacle's middle, as a fraction of half its width
    seconds: float = 30.0  # duration of pushing
    wind_n: float = 0.0  # m/s, wind to the north


RESIDENTIAL, CAMPUS, BLOCKS = "residential-searching-01", "campus-searching-01", "blocks-commanding-01"
PRESSES = (
    Press(RESIDENTIAL, "house-11"),
    Press(RESIDENTIAL, "house-11", 50.0, seconds=20.0),
    Press(RESIDENTIAL, "house-12", seconds=60.0, wind_n=5.0),
    Press(RESIDENTIAL, "mailbox-64"),
    Press(RESIDENTIAL, "mailbox-64", 30.0, 0.5, 20.0, wind_n=5.0),
    Press(RESIDENTIAL, "lamp-440", 90.0, 0.8),
    Press(RESIDENTIAL, "lamp-440", 90.0, 0.8, 10.0, wind_n=5.0),
    Press(RESIDENTIAL, "sedan-474"),
    Press(RESIDENTIAL, "sedan-474", 40.0, seconds=20.0),
    Press(RESIDENTIAL, "van-477", seconds=60.0),
    Press(RESIDENTIAL, "fence-56", 30.0),
    Press(RESIDENTIAL, "tree-81"),
    Press(RESIDENTIAL, "hedge-66", seconds=20.0),
    Press(RESIDENTIAL, "ground", seconds=20.0),
    Press(CAMPUS, "hall-1"),
    Press(CAMPUS, "hall-1", 60.0, seconds=20.0, wind_n=5.0),
    Press(CAMPUS, "kiosk-1", 10.0),
    Press(CAMPUS, "bollard-1", seconds=20.0),
    Press(CAMPUS, "statue-1"),
    Press(CAMPUS, "clock-tower-1", 30.0, seconds=60.0),
    Press(CAMPUS, "bench-1", seconds=20.0),
    Press(CAMPUS, "ground", seconds=20.0, wind_n=5.0),
    Press(BLOCKS, "box-1"),
    Press(BLOCKS, "box-1", 45.0, wind_n=5.0),
    Press(BLOCKS, "cylinder-1", seconds=60.0),
    Press(BLOCKS, "cylinder-1", beside=0.7, seconds=20.0),
    Press(BLOCKS, "cone-1"),
    Press(BLOCKS, "arch-1", beside=0.8),
    Press(BLOCKS, "ramp-1", seconds=20.0),
    Press(BLOCKS, "pyramid-1", 15.0),
)

# Upper limits of a press, by field of `Outcome`.
LIMITS = {"attitude_deg": 3.0, "velocity_error": 1.0, "position_error_m": 3.0, "speed": 1.5 * SPEED, "tilt_deg": 90.0}
PX4_LIMITS = {"position_error_m": 5.0, "speed": 3.0}  # a real PX4 has only these limits


@dataclass(frozen=True, slots=True)
class Fastest:
    """The moment of the greatest true speed, and the flight since the last hit before it.

    The controller caused a speed that grows after the hit while the vehicle leans as commanded. The contact caused a
    speed that exists at the hit or grows against the commanded lean.
    """

    second: float  # s since the first contact
    phase: str
    since_hit_s: float
    speed_at_hit: float  # m/s, true, 20 ms after the last hit
    speed_believed: float  # m/s, by LOCAL_POSITION_NED
    lean_commanded_deg: float  # largest lean of ATTITUDE_TARGET since the last hit, within the last second
    lean_deg: float  # largest true lean in the same time
    off_target_deg: float  # median angle between true and commanded attitude in the same time


@dataclass(frozen=True, slots=True)
class Outcome:
    """The worst figures of a press, from the first contact to the end of backing off."""

    press: Press
    seed: int
    hits: int
    attitude_deg: float  # angle between true and estimated attitude
    velocity_error: float  # m/s
    position_error_m: float
    speed: float  # m/s, true
    tilt_deg: float  # true
    ratio: float  # worst test ratio of the GPS velocity (ESTIMATOR_STATUS)
    resets: int
    clipped: int  # accelerometer readings (every 1 ms) beyond the range, summed over the three axes
    crashed: bool
    left_m: float  # distance backed off, measured until AWAY_M is reached or another obstacle is hit
    met_another: bool  # the vehicle backed off into another obstacle
    fastest: Fastest | None
    px4: bool = False  # flown by a real PX4

    @property
    def limits(self) -> dict[str, float]:
        """The limits for the autopilot that flew the press."""
        return PX4_LIMITS if self.px4 else LIMITS

    @property
    def beyond(self) -> tuple[str, ...]:
        """The names of the limits that were exceeded, or a note that the drone touched nothing."""
        stuck = ("left_m",) if not self.px4 and self.left_m < AWAY_M and not self.met_another else ()
        if not self.hits and self.press.thing != "ground":
            return ("the drone touched nothing",)
        return tuple(name for name, most in self.limits.items() if not getattr(self, name) <= most) + stuck


def before(world: World, press: Press) -> tuple[BootPose, float]:
    """Return the boot pose, on the obstacle's side with the most free room, and the height of the flight (m)."""
    if press.thing == "ground":
        north, east, _ = world.record.starts[0].position_ned
        return BootPose(
            (north, east, world.ground_down(north, east)), math.radians(world.record.starts[0].yaw_deg)
        ), 1.2
    instance = next(instance for instance in world.scene.instances if instance.name == press.thing)
    points = instance.mesh.vertices
    cosine, sine = math.cos(instance.yaw), math.sin(instance.yaw)
    turned = np.stack(
        [cosine * points[:, 0] - sine * points[:, 1], sine * points[:, 0] + cosine * points[:, 1]], axis=1
    )
    height = min(2.0, max(0.6, -0.67 * float(points[:, 2].min())))
    solid = obstacles(world.scene)
    rest = np.flatnonzero(solid.owner != solid.names.index(press.thing))
    best: tuple[float, Vec3, float] = (-1.0, (0.0, 0.0, 0.0), 0.0)
    for yaw in instance.yaw + np.radians(press.turn_deg + np.arange(0.0, 360.0, 90.0)):
        ahead, right = np.array([math.cos(yaw), math.sin(yaw)]), np.array([-math.sin(yaw), math.cos(yaw)])
        across = turned @ right
        middle = (across.max() + across.min()) / 2 + press.beside * (across.max() - across.min()) / 2
        reach = float(-(turned @ ahead).min())
        place = np.array(instance.position_ned[:2]) - (reach + BEFORE_M) * ahead + middle * right
        down = world.ground_down(float(place[0]), float(place[1]))
        way = [(*(place + k * ahead), down - up) for k in (0.0, 1.0, 2.0) for up in (0.2, height)]
        room = min(_room(solid, rest, point) for point in way)
        if room > best[0] + 1e-9:
            best = room, (float(place[0]), float(place[1]), 0.0), float(yaw)
    _, (north, east, _), yaw = best
    return BootPose((north, east, world.ground_down(north, east)), yaw), height


def _room(solid: Obstacles, which: NDArray[np.intp], point: Vec3) -> float:
    """Return the distance (m) from a point to the nearest of the triangles `which`, at most ROOM_M."""
    near = which[np.linalg.norm(solid.bounds[which, :3] - point, axis=1) - solid.bounds[which, 3] < ROOM_M]
    gaps = [math.dist(point, in_triangle(solid.corners, int(t), *point)[:3]) for t in near]
    return min([ROOM_M, *gaps])


class Pose(NamedTuple):
    """The truth at one time."""

    position_ned: NDArray[np.float64]  # m
    velocity_ned: NDArray[np.float64]  # m/s
    attitude: NDArray[np.float64]  # FRD to NED
    target: NDArray[np.float64] | None = None  # commanded attitude; its heading has the estimate's error


def lean_deg(attitude: NDArray[np.float64]) -> float:
    """Return the angle between the vehicle's down axis and the vertical."""
    return between_axes_deg(attitude, np.array((1.0, 0.0, 0.0, 0.0)))


def between_axes_deg(first: NDArray[np.float64], second: NDArray[np.float64]) -> float:
    """Return the angle between the down axes of two attitudes with almost the same heading."""
    down, other_down = (rotate(tuple(attitude.tolist()), (0.0, 0.0, 1.0)) for attitude in (first, second))
    return math.degrees(math.acos(max(-1.0, min(1.0, float(np.dot(down, other_down))))))


class BackOffStart(NamedTuple):
    """The state when the vehicle begins to back off: place, count of hits, number of the obstacle hit last."""

    position_ned: NDArray[np.float64]  # m
    hits: int
    owner: int


@dataclass(slots=True)
class Watch:
    """Follows a press: records the truth at every tick and compares the autopilot's messages with it."""

    press: Press
    vehicle: Vehicle
    link: Link
    hits: int  # number of hits before the press
    phase: str = "ahead"  # then "pushing", "back", "over"
    ticks: int = 0  # since the phase began
    left: BackOffStart | None = None
    away_m: float = 0.0
    met_another: bool = False
    resets: int = 0
    worst: dict[str, float] = field(default_factory=lambda: dict.fromkeys(COMPARED, 0.0))
    passed: dict[int, Pose] = field(default_factory=dict)  # the truth of the last second, by tick
    resetting: ResetWatch = field(default_factory=ResetWatch)
    target: NDArray[np.float64] | None = None  # commanded attitude in the last ATTITUDE_TARGET
    believed: float = 0.0  # m/s, speed in the last LOCAL_POSITION_NED
    touched: int = 0  # tick of the first contact
    hit: int = 0  # tick of the last hit
    hits_seen: int = 0
    fastest: Fastest | None = None

    def look(self) -> None:
        """Record the truth of this tick, and begin the next phase if the present phase is over."""
        state, truth = self.vehicle.plant.state, self.vehicle.plant.truth
        tick = self.vehicle.time_us // TICK_US
        position, velocity, attitude = (truth[name].copy() for name in ("position_ned", "velocity_ned", "attitude"))
        pose = Pose(position, velocity, attitude, self.target)
        self.passed[tick] = pose
        self.passed.pop(tick - round(1.0 / TICK_S), None)
        if state["hits"] != self.hits_seen:
            self.hit, self.hits_seen = tick, int(state["hits"])
        self.ticks += 1
        if self.phase == "ahead":
            grounded = self.press.thing == "ground" and bool(state["on_ground"])
            if state["hits"] > self.hits or grounded:
                self.touched = tick
                self._begin("pushing")
            elif self.ticks * TICK_S >= AHEAD_S:
                self._begin("over")
            return
        if float(np.linalg.norm(pose.velocity_ned)) > self.worst["speed"]:
            self.fastest = self._moment(tick)
        self._worst("speed", float(np.linalg.norm(pose.velocity_ned)))
        self._worst("tilt_deg", lean_deg(pose.attitude))
        if self.phase == "pushing" and self.ticks * TICK_S >= self.press.seconds:
            self.left = BackOffStart(truth["position_ned"].copy(), int(state["hits"]), int(state["hit_owner"]))
            self._begin("back")
        elif self.phase == "back" and self.left:
            self.away_m = float(np.linalg.norm((truth["position_ned"] - self.left.position_ned)[:2]))
            self.met_another = bool(state["hits"] != self.left.hits and state["hit_owner"] != self.left.owner)
            if self.met_another or self.away_m >= AWAY_M or self.ticks * TICK_S >= BACK_S:
                self._begin("over")

    def compare(self, message: dialect.MAVLink_message) -> None:
        """Compare a message of the autopilot with the truth of the same time."""
        kind = message.get_msgId()
        if kind == dialect.MAVLINK_MSG_ID_ATTITUDE_TARGET:
            self.target = np.array(message.q)
        if self.phase not in ("pushing", "back"):
            if kind == dialect.MAVLINK_MSG_ID_ODOMETRY:
                self.resetting.message(message)
        elif kind == dialect.MAVLINK_MSG_ID_ODOMETRY:
            reset = self.resetting.message(message)
            self.resets += reset.count if reset else 0
        elif kind == dialect.MAVLINK_MSG_ID_ESTIMATOR_STATUS:
            self._worst("ratio", message.vel_ratio)
        elif kind == dialect.MAVLINK_MSG_ID_ATTITUDE_QUATERNION:
            q = np.array([message.q1, message.q2, message.q3, message.q4])
            if truth := self._then(message):
                cosine = min(abs(float(np.dot(truth.attitude, q))) / float(np.linalg.norm(q)), 1.0)
                self._worst("attitude_deg", math.degrees(2.0 * math.acos(cosine)))
        elif kind == dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED and (truth := self._then(message)):
            self.believed = math.hypot(message.vx, message.vy, message.vz)
            self._worst("velocity_error", math.dist(truth.velocity_ned, (message.vx, message.vy, message.vz)))
            if origin := self.link.state.origin:
                believed = ned_to_geodetic(*origin, message.x, message.y, message.z)
                where = geodetic_to_ned(*self.vehicle.origin, *believed)
                self._worst("position_error_m", math.dist(truth.position_ned, where))

    def _moment(self, tick: int) -> Fastest:
        """Return the figures of this tick, and of the flight since the last hit (at most one second)."""
        since = [pose for then, pose in self.passed.items() if then >= self.hit]
        steered = [(pose.attitude, pose.target) for pose in since if pose.target is not None]
        off_target = [between_axes_deg(*pair) for pair in steered]
        after = self.passed.get(self.hit + 2)
        return Fastest(
            second=round((tick - self.touched) * TICK_S, 2),
            phase=self.phase,
            since_hit_s=round((tick - self.hit) * TICK_S, 2),
            speed_at_hit=round(float(np.linalg.norm((after or since[0]).velocity_ned)), 2),
            speed_believed=round(self.believed, 2),
            lean_commanded_deg=round(max((lean_deg(target) for _, target in steered), default=math.nan), 1),
            lean_deg=round(max(lean_deg(pose.attitude) for pose in since), 1),
            off_target_deg=round(statistics.median(off_target), 1) if off_target else math.nan,
        )

    def _then(self, message: dialect.MAVLink_message) -> Pose | None:
        return self.passed.get(round(message.time_boot_ms * 1000 / TICK_US))

    def _worst(self, name: str, value: float) -> None:
        self.worst[name] = max(self.worst[name], value)

    def _begin(self, phase: str) -> None:
        self.phase, self.ticks = phase, 0


def aim(link: Link, vehicle: Vehicle, start: StartPose) -> float:
    """Fly to the start of the press, and return the bearing of the press's course from the nose (rad, + right).

    The truth corrects the position, because the estimate's errors are larger than some obstacles.
    """
    assert link.state.position_ned is not None
    off = np.array(start.position_ned) - vehicle.plant.truth["position_ned"]
    north, east, down = (np.array(link.state.position_ned) + off).tolist()
    arrival = link.fly_to((north, east, down), math.radians(start.yaw_deg))
    link.wait_for(lambda state: arrival.settled(state, link.time_us), 30.0, "settling before the obstacle")
    return wrap_pi(math.radians(start.yaw_deg) - quat_yaw(tuple(vehicle.plant.truth["attitude"].tolist())))


def fly(press: Press, seed: int, px4: str | None = None) -> Outcome:
    """Fly one press under the project's autopilot, or under the PX4 that the command `px4` starts."""
    pose, height = before(load_world(press.episode), press)
    record = catalogue.load(press.episode)
    start = StartPose((*pose.position_ned[:2], pose.position_ned[2] - height), math.degrees(pose.yaw))
    world = world_of(replace(record, starts=(start,)), count=1)
    wind = VehicleFaults(wind_ned=(press.wind_n, 0.0, 0.0))
    with ExitStack() as ends:
        clock = ends.enter_context(one_vehicle(world, seed=seed, disturbances=wind, px4=px4))
        link = Link(clock.transport(0), simulated=True)
        ends.callback(link.close)
        ascend([link], [StartOffset((0.0, 0.0, -height), pose.yaw)], lambda line: None)
        (vehicle,) = clock.simulation.vehicles
        bearing = aim(link, vehicle, start)
        sight = link.sight(link.time_us)
        watch = Watch(press, vehicle, link, int(vehicle.plant.state["hits"]))
        for message_id in WATCHED:
            link.order("telemetry", dialect.MAV_CMD_SET_MESSAGE_INTERVAL, message_id, 50_000)
        link.listeners.append(watch.compare)
        clock.followers.append(watch.look)
        clipped = int(vehicle.plant.memory["accel_clipped"])
        grounded = press.thing == "ground"
        while watch.phase != "over":
            back = watch.phase == "back"
            up = (0.3 if back else -0.5) if grounded else None
            link.fly(Velocity(-SPEED if back else SPEED, up, bearing), seen=sight)
            link.tick()
        return Outcome(
            press,
            seed,
            int(vehicle.plant.state["hits"]) - watch.hits,
            **{name: round(value, 2) for name, value in watch.worst.items()},
            resets=watch.resets,
            clipped=int(vehicle.plant.memory["accel_clipped"]) - clipped,
            crashed=bool(vehicle.plant.state["crashed"]),
            left_m=round(watch.away_m, 2),
            met_another=watch.met_another,
            fastest=watch.fastest,
            px4=px4 is not None,
        )


def _line(outcome: Outcome) -> str:
    press = outcome.press
    label = f"{press.thing} {press.turn_deg:.0f}° {press.beside:g} {press.seconds:.0f} s" + (
        " wind" if press.wind_n else ""
    )
    return (
        f"{label:30} {outcome.seed} {outcome.hits:4} {outcome.attitude_deg:6.1f}° {outcome.velocity_error:5.2f} m/s"
        f" {outcome.position_error_m:5.2f} m {outcome.speed:5.2f} m/s {outcome.tilt_deg:4.0f}° {outcome.ratio:5.1f}"
        f" {outcome.resets} {outcome.clipped:3} {'crash' if outcome.crashed else '     '} {outcome.left_m:5.1f} m"
        f"  {' '.join(outcome.beyond)}"
    )


def _summary(outcomes: list[Outcome]) -> list[str]:
    """Return a line for each limit (median, worst, number of presses beyond it), and a last line about resets."""
    lines = []
    for name, most in outcomes[0].limits.items():
        values = [float(getattr(outcome, name)) for outcome in outcomes]
        beyond = sum(not value <= most for value in values)
        lines.append(f"{name:16} limit {most:4.1f}  median {statistics.median(values):5.2f}  worst {max(values):6.2f}"
                     f"  beyond {beyond}")  # fmt: skip
    resets = sum(outcome.resets for outcome in outcomes)
    return [*lines, f"resets of the estimator: {resets}; clipped milliseconds: {sum(o.clipped for o in outcomes)}"]


def main() -> None:
    """Fly the presses and print them."""
    parser = benchmark_parser(__doc__, short="fly two presses of five seconds, to check that it runs")
    parser.add_argument("--seeds", type=int, default=1, help="flights of each press")
    parser.add_argument("--only", default="", help="only presses against obstacles with this in their name")
    parser.add_argument("--px4", metavar="COMMAND", help="command that starts a real PX4, as in `fly --px4`")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    args = parser.parse_args()
    presses = [press for press in PRESSES if args.only in press.thing]
    if args.short:
        presses = [replace(press, seconds=5.0) for press in presses if press.episode == BLOCKS][:2]
    flights = list(product(presses, range(args.seeds)))
    outcomes = []
    with ProcessPoolExecutor(args.jobs) as pool:
        for outcome in pool.map(partial(fly, px4=args.px4), *zip(*flights, strict=True)):
            outcomes.append(outcome)
            if not args.json:
                print(_line(outcome), flush=True)
    good = sum(not outcome.beyond for outcome in outcomes)
    if args.json:
        figures = {"within": good, "of": len(outcomes), "presses": [asdict(press) for press in outcomes]}
        print(json.dumps(figures))
    else:
        print(*_summary(outcomes), sep="\n")
        print(f"{good} of {len(outcomes)} within all limits")


if __name__ == "__main__":
    main()
