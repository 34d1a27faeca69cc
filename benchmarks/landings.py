"""Flies landings at random places of every map: on the ground, on roofs, cars, trees and fences.

    python -m benchmarks.landings [--places N] [--seed N] [--jobs N] [--json] [--short]

Half of the places are drawn from the whole map, half from above a random object. The vehicle boots on a platform above
the place and takes off. Then the platform is removed, and the vehicle is ordered to land. The result `upright` means
that the vehicle is disarmed and upright. Any other landing has the result `says why` if the autopilot sent a
warning, and `silent` if it sent none. The goal is that no landing is silent.
"""

import json
import math
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from itertools import repeat

import numpy as np
from numpy.typing import NDArray

from autopilot.commander.ground import UPRIGHT_DEG
from benchmarks.machine import benchmark_parser
from benchmarks.presses import BLOCKS, CAMPUS, RESIDENTIAL, lean_deg
from dronecats.flight.sitl.episode_world import load_world, origin
from dronecats.flight.sitl.simulation import BootPose, SimulatedVehicle
from episodes.world.obstacles import obstacles
from episodes.world.world import World
from foundation.mavlink import Parser, dialect
from foundation.terrain import Obstacles
from vehicles import airframe
from vehicles.ground import peaks

MAPS = {"residential": RESIDENTIAL, "campus": CAMPUS, "blocks": BLOCKS}
ABOVE_M = 4.0  # m, height of the platform above the highest point within AROUND_M
AROUND_M = 2.0
HOVER_S, LANDING_S = 8.0, 90.0
TICKS = 100  # per second


@dataclass(frozen=True, slots=True)
class Landing:
    """The result of a landing."""

    map: str
    place: str  # name of the object below the start, or 'ground'
    north_m: float
    east_m: float
    disarmed: bool
    lean_deg: float
    crashed: bool
    texts: tuple[str, ...]  # warnings since the order to land

    @property
    def result(self) -> str:
        """'upright': disarmed and upright. Otherwise 'says why' if the autopilot sent a warning, else 'silent'."""
        if self.disarmed and self.lean_deg <= UPRIGHT_DEG:
            return "upright"
        return "says why" if self.texts else "silent"


def top(world: World, solid: Obstacles, north: float, east: float) -> tuple[float, str]:
    """Return the NED z (m) of the highest surface at a point, and the name of the object or 'ground'."""
    best, name = world.ground_down(north, east), "ground"
    middle, radius = solid.bounds[:, :2], solid.bounds[:, 3]
    for t in np.flatnonzero(np.hypot(*(middle - (north, east)).T) <= radius):
        a, b, c = solid.corners[t].reshape(3, 3).astype(float)
        (ux, uy), (vx, vy), (px, py) = (b - a)[:2], (c - a)[:2], (north - a[0], east - a[1])
        area = ux * vy - uy * vx
        if abs(area) < 1e-9:
            continue
        u, v = (px * vy - py * vx) / area, (ux * py - uy * px) / area
        z = float(a[2] + u * (b - a)[2] + v * (c - a)[2])
        if u >= 0.0 and v >= 0.0 and u + v <= 1.0 and z < best:
            best, name = z, solid.names[solid.owner[t]]
    return best, name


def draw(world: World, solid: Obstacles, rng: np.random.Generator, over_thing: bool) -> tuple[float, float]:
    """Return a random place (north, east; m): above a random object, or between the outermost objects."""
    points: NDArray[np.float32] = solid.bounds
    if over_thing:
        points = points[solid.owner == rng.integers(len(solid.names))]
        points = points if len(points) else solid.bounds
        north, east, *_ = points[rng.integers(len(points))].tolist()
        return north, east
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    north, east = rng.uniform(low, high).tolist()
    return north, east


def land(map_: str, number: int, seed: int) -> Landing:
    """Fly the landing at place `number`."""
    world = load_world(MAPS[map_])
    solid = obstacles(world.scene)
    rng = np.random.default_rng((seed, list(MAPS).index(map_), number))
    north, east = draw(world, solid, rng, over_thing=bool(number % 2))
    _, name = top(world, solid, north, east)
    around = np.linspace(-AROUND_M, AROUND_M, 5)
    highest = min(top(world, solid, north + x, east + y)[0] for x in around for y in around) - ABOVE_M
    terrain = world.scene.terrain
    platform = replace(terrain, down=np.full_like(terrain.down, highest))
    pose = BootPose((north, east, highest), float(rng.uniform(-math.pi, math.pi)))
    vehicle = SimulatedVehicle(
        0, airframe.load("x500"), pose, seed=number, origin=origin(world), terrain=platform, obstacles=solid
    )
    port, parser, texts = vehicle.open_port("onboard"), Parser(), list[str]()
    commander, plant = vehicle.autopilot.commander, vehicle.plant

    def live(seconds: float) -> None:
        for _ in range(round(seconds * TICKS)):
            vehicle.advance()
            for message in parser.feed(port.take()):
                if message.get_type() == "STATUSTEXT" and message.severity <= dialect.MAV_SEVERITY_WARNING:
                    texts.append(message.text)

    while commander.arming_failures():
        live(0.1)
    commander.take_off(math.nan)
    commander.arm()
    live(HOVER_S)
    plant.kernel_args.down[:] = terrain.down
    plant.kernel_args.peak[:] = peaks(terrain, float(plant.params["reach"]))
    texts.clear()
    commander.set_mode("LAND")
    deadline_us = vehicle.time_us + round(LANDING_S * 1e6)
    while commander.armed and vehicle.time_us < deadline_us:
        live(1.0)
    live(1.0)
    attitude = plant.truth["attitude"].copy()
    return Landing(
        map_, name, round(north, 1), round(east, 1), not commander.armed, round(lean_deg(attitude), 1),
        bool(plant.state["crashed"]), tuple(texts),
    )  # fmt: skip


def main() -> None:
    parser = benchmark_parser(__doc__, short="land at one place of a map, to check that it runs")
    parser.add_argument("--places", type=int, default=20, help="of each map (default 20)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    args = parser.parse_args()
    places = [(map_, k) for map_ in MAPS for k in range(args.places)]
    places = [("blocks", 0)] if args.short else places
    landings = []
    with ProcessPoolExecutor(args.jobs) as pool:
        for landing in pool.map(land, *zip(*places, strict=True), repeat(args.seed)):
            landings.append(landing)
            if not args.json:
                print(
                    f"{landing.map:12} {landing.place:16} {landing.lean_deg:5.1f}° {landing.result:9}"
                    f" {' | '.join(landing.texts)}",
                    flush=True,
                )
    results = Counter(landing.result for landing in landings)
    if args.json:
        rows = [{**asdict(landing), "result": landing.result} for landing in landings]
        print(json.dumps({"of": len(landings), **results, "landings": rows}))
    else:
        print(", ".join(f"{count} {result}" for result, count in results.most_common()), f"of {len(landings)}")


if __name__ == "__main__":
    main()
