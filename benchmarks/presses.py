"""What pressing against things does to a flight: walls, posts, cars, trees, slopes and the ground, on every map.

Each press takes off before a thing, flies into it at 1.2 m/s as an agent's go does, goes on pushing, and then backs
off. From the first contact on the truth is compared with what the autopilot believes. Prints one line a press, with the
names of the limits that it exceeds:

    python -m benchmarks.presses [--seeds N] [--only WORD] [--jobs N] [--json]
"""

import argparse
import json
import math
import statistics
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from itertools import product

import numpy as np

from autopilot.modes.setpoint import FREE, CascadeSetpoint
from autopilot.records import VELOCITY_TEST
from dronecats.sitl.flight_conditions import FlightConditions
from dronecats.sitl.scenario import build, load_world, origin
from dronecats.sitl.simulation import BootPose
from episodes.world import World
from foundation.frames import Vec3, geodetic_to_ned, ned_to_geodetic

SPEED = 1.2  # m/s, as fast as the agent's controller flies
BEFORE_M = 3.0  # of free way before the thing
BACK_S = 6.0
AWAY_M = 2.0  # that it has to come away within BACK_S, unless it meets another thing; it came from 2.4 m away
TICK_S = 0.01


@dataclass(frozen=True, slots=True)
class Press:
    """What is flown into, and how."""

    episode: str  # whose map it is
    thing: str  # name of an instance, or 'ground'
    turn_deg: float = 0.0  # between the course and the nearest axis of the thing: 0 is head-on
    beside: float = 0.0  # how far the course passes the thing's middle, over half of the thing's width
    seconds: float = 30.0  # of pushing
    wind_n: float = 0.0  # m/s, to the north
    height_m: float | None = None  # above the ground; None: two thirds of the thing's, at most 2 m


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

# The most that a press may do: `Outcome` fields and their limits.
LIMITS = {"attitude_deg": 3.0, "velocity_error": 1.0, "position_error_m": 3.0, "speed": 1.5 * SPEED, "tilt_deg": 90.0}


@dataclass(frozen=True, slots=True)
class Outcome:
    """The worst of a press, from the first contact to the end of backing off."""

    press: Press
    seed: int
    hits: int
    attitude_deg: float  # between true and estimated attitude
    velocity_error: float  # m/s
    position_error_m: float
    speed: float  # m/s, true
    tilt_deg: float  # true
    ratio: float  # worst test ratio of the fixes' velocity
    resets: int
    clipped: int  # milliseconds beyond the accelerometer's range
    crashed: bool
    left_m: float  # how far it came while backing off, which ends at AWAY_M or at another thing
    met_another: bool  # it came away and flew into another thing

    @property
    def beyond(self) -> tuple[str, ...]:
        """The names of the limits that were exceeded."""
        grounded = self.press.thing == "ground"  # lands and disarms
        stuck = ("left_m",) if not grounded and self.left_m < AWAY_M and not self.met_another else ()
        if not self.hits and not grounded:
            return ("nothing was touched",)
        return tuple(name for name, most in LIMITS.items() if not getattr(self, name) <= most) + stuck


def before(world: World, press: Press) -> tuple[BootPose, float]:
    """Return where to boot, and the height (m) to fly at: on the side of the thing that has the most room."""
    if press.thing == "ground":
        north, east, _ = world.record.starts[0].position_ned
        return BootPose(
            (north, east, world.ground_down(north, east)), math.radians(world.record.starts[0].yaw_deg)
        ), 1.2
    things = {each.name: each for each in world.scene.instances}
    thing = things[press.thing]
    points = thing.mesh.vertices
    cosine, sine = math.cos(thing.yaw), math.sin(thing.yaw)
    turned = np.stack(
        [cosine * points[:, 0] - sine * points[:, 1], sine * points[:, 0] + cosine * points[:, 1]], axis=1
    )
    others = [
        each.mesh.vertices[:, :2] + np.array(each.position_ned[:2])
        for each in things.values()
        if each.kind != "ground" and each.name != press.thing and each.solid
    ]
    cloud = np.concatenate(others)
    best: tuple[float, Vec3, float] = (-1.0, (0.0, 0.0, 0.0), 0.0)
    for yaw in thing.yaw + np.radians(press.turn_deg + np.arange(0.0, 360.0, 90.0)):
        ahead, right = np.array([math.cos(yaw), math.sin(yaw)]), np.array([-math.sin(yaw), math.cos(yaw)])
        across = turned @ right
        middle = (across.max() + across.min()) / 2 + press.beside * (across.max() - across.min()) / 2
        reach = float(-(turned @ ahead).min())
        place = np.array(thing.position_ned[:2]) - (reach + BEFORE_M) * ahead + middle * right
        room = min(float(np.linalg.norm(cloud - (place + k * ahead), axis=1).min()) for k in (0.0, 1.0, 2.0))
        if min(room, 3.0) > best[0] + 1e-9:
            best = min(room, 3.0), (float(place[0]), float(place[1]), 0.0), float(yaw)
    _, (north, east, _), yaw = best
    height = press.height_m or min(2.0, max(0.6, -0.67 * float(points[:, 2].min())))
    return BootPose((north, east, world.ground_down(north, east)), yaw), height


def fly(press: Press, seed: int) -> Outcome:
    """Fly one press; without a hit nothing was touched."""
    world = load_world(press.episode)
    simulation = build(world, seed=seed, count=1, conditions=FlightConditions(wind_ned=(press.wind_n, 0.0, 0.0)))
    (vehicle,) = simulation.vehicles
    state, truth, estimate = vehicle.plant.state, vehicle.plant.truth, vehicle.core.estimate
    pose, height = before(world, press)
    down = vehicle.plant.params["contact_position"][:, 2].max()
    state["position"] = (*pose.position_ned[:2], pose.position_ned[2] - down)
    state["attitude"] = (math.cos(pose.yaw / 2), 0.0, 0.0, math.sin(pose.yaw / 2))
    commander = vehicle.autopilot.commander
    while commander.arming_failures():
        simulation.advance()
    commander.take_off(-height - 0.5)
    commander.arm()
    for _ in range(800):
        simulation.advance()

    def stream(north: float, east: float, vertical: float) -> None:
        offboard = commander.flight.offboard
        offboard.setpoint = CascadeSetpoint(
            position_ned=FREE, velocity_ned=(north, east, vertical), acceleration_ned=FREE, yaw=pose.yaw
        )
        offboard.time_us = vehicle.autopilot.state.time_us

    def velocity(course: float, speed: float, vertical: float = 0.0) -> Vec3:
        return speed * math.cos(course), speed * math.sin(course), vertical

    stream(0.0, 0.0, 0.0)
    commander.set_mode("OFFBOARD")
    for _ in range(200):  # down to the height
        stream(0.0, 0.0, 0.25)
        simulation.advance()
    into = velocity(pose.yaw, SPEED, 0.5 if press.thing == "ground" else 0.0)
    worst = dict.fromkeys(("attitude_deg", "velocity_error", "position_error_m", "speed", "tilt_deg", "ratio"), 0.0)
    home, touched, hits = origin(world), 0, int(state["hits"])
    begun = int(vehicle.core.filter_state["resets"]), int(vehicle.plant.memory["accel_clipped"])
    until = round(press.seconds / TICK_S)
    back, left, away, last, met = round(BACK_S / TICK_S), np.zeros(3), 0.0, (0, 0), False
    for _ in range(round(12.0 / TICK_S) + until + back):
        pushing = touched < until
        if touched == until:
            left, last = truth["position_ned"].copy(), (int(state["hits"]), int(state["hit_owner"]))
        stream(*(into if pushing else velocity(pose.yaw + math.pi, SPEED, -0.3 if press.thing == "ground" else 0.0)))
        simulation.advance()
        if not touched and state["hits"] == hits and not (press.thing == "ground" and state["on_ground"]):
            continue
        touched += 1
        away = 0.0 if pushing else float(np.linalg.norm((truth["position_ned"] - left)[:2]))
        met = not pushing and state["hits"] != last[0] and state["hit_owner"] != last[1]
        if touched > until + back or away >= AWAY_M or met:
            break
        q, p = truth["attitude"], estimate["attitude"]
        where = np.array(geodetic_to_ned(*home, *ned_to_geodetic(*(
            float(estimate[name]) for name in ("origin_lat_deg", "origin_lon_deg", "origin_alt_m")
        ), *estimate["position_ned"].tolist())))  # fmt: skip
        now = {
            "attitude_deg": math.degrees(2.0 * math.acos(min(abs(float(np.dot(q, p))), 1.0))),
            "velocity_error": float(np.linalg.norm(truth["velocity_ned"] - estimate["velocity_ned"])),
            "position_error_m": float(np.linalg.norm(truth["position_ned"] - where)),
            "speed": float(np.linalg.norm(truth["velocity_ned"])),
            "tilt_deg": math.degrees(math.acos(max(-1.0, min(1.0, 1.0 - 2.0 * (q[1] ** 2 + q[2] ** 2))))),
            "ratio": float(np.sqrt(estimate["test_ratio"][VELOCITY_TEST : VELOCITY_TEST + 3].max())),
        }
        worst = {name: max(worst[name], now[name]) for name in worst}
    return Outcome(
        press,
        seed,
        int(state["hits"]) - hits,
        **{name: round(value, 2) for name, value in worst.items()},
        resets=int(vehicle.core.filter_state["resets"]) - begun[0],
        clipped=int(vehicle.plant.memory["accel_clipped"]) - begun[1],
        crashed=bool(state["crashed"]),
        left_m=round(away, 2),
        met_another=bool(met),
    )


def _told(outcome: Outcome) -> str:
    press = outcome.press
    what = f"{press.thing} {press.turn_deg:.0f}° {press.beside:g} {press.seconds:.0f} s" + (
        " wind" if press.wind_n else ""
    )
    return (
        f"{what:30} {outcome.seed} {outcome.hits:4} {outcome.attitude_deg:6.1f}° {outcome.velocity_error:5.2f} m/s"
        f" {outcome.position_error_m:5.2f} m {outcome.speed:5.2f} m/s {outcome.tilt_deg:4.0f}° {outcome.ratio:5.1f}"
        f" {outcome.resets} {outcome.clipped:3} {'crash' if outcome.crashed else '     '} {outcome.left_m:5.1f} m"
        f"  {' '.join(outcome.beyond)}"
    )


def _summary(outcomes: list[Outcome]) -> list[str]:
    """Return a line for each limit: the median and the worst of all presses, and how many exceed it."""
    lines = []
    for name, most in LIMITS.items():
        values = [float(getattr(outcome, name)) for outcome in outcomes]
        beyond = sum(not value <= most for value in values)
        lines.append(f"{name:16} limit {most:4.1f}  median {statistics.median(values):5.2f}  worst {max(values):6.2f}"
                     f"  beyond {beyond}")  # fmt: skip
    resets = sum(outcome.resets for outcome in outcomes)
    return [*lines, f"resets of the estimator: {resets}; clipped milliseconds: {sum(o.clipped for o in outcomes)}"]


def main() -> None:
    """Fly the presses and print them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=1, help="flights of each press")
    parser.add_argument("--only", default="", help="presses whose thing has this in its name")
    parser.add_argument("--short", action="store_true", help="two presses of five seconds, to see that it runs")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--json", action="store_true", help="print JSON")
    arguments = parser.parse_args()
    presses = [each for each in PRESSES if arguments.only in each.thing]
    if arguments.short:
        presses = [replace(each, seconds=5.0) for each in presses if each.episode == BLOCKS][:2]
    flights = list(product(presses, range(arguments.seeds)))
    outcomes = []
    with ProcessPoolExecutor(arguments.jobs) as pool:
        for outcome in pool.map(fly, *zip(*flights, strict=True)):
            outcomes.append(outcome)
            if not arguments.json:
                print(_told(outcome), flush=True)
    good = sum(not outcome.beyond for outcome in outcomes)
    if arguments.json:
        figures = {"within": good, "of": len(outcomes), "presses": [asdict(each) for each in outcomes]}
        print(json.dumps(figures))
    else:
        print(*_summary(outcomes), sep="\n")
        print(f"{good} of {len(outcomes)} within all limits")


if __name__ == "__main__":
    main()
