"""Measures how fast the project's flight stack flies, and how well it holds real time.

    python -m benchmarks.flight [--json] [--repeat N] [--seconds S] [--quick] [--short] [--peers --peers-dir DIR]

Prints the real-time factor (`…_rtf`) for the plant with its autopilot (`core`), for a client that flies it through
MAVLink as an agent does (`mavlink`; with more telemetry `mavlink_onboard`), and for a fleet of four (`fleet4`). Also
prints the memory of one simulator process, the compile time of a first run, the time that a flight with pictures takes
to its first decision, and how well real-time mode holds its rate. The task is always the same: hover and steps of
1 m/s.

Every `…_rtf` is the median over the repetitions of vehicle seconds per wall second. `…_rtf_cpu` counts processor
seconds instead, which other programs on a shared machine disturb less. `…_rtf_x_loop` is `…_rtf_cpu` times
`machine.python_loop_ms`; it depends little on the machine (`benchmarks/machine.py`). `--short` takes seconds and only
checks that every figure can be measured.
"""

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import psutil

from autopilot.records import NAN, CascadeSetpoint
from benchmarks import flight_peers
from benchmarks.machine import Machine, benchmark_parser, print_figures
from dronecats.flight.run.ascent import StartOffset, ascend
from dronecats.flight.sitl.pace import RateKeeper
from dronecats.flight.sitl.simulation import TICK_US, BootPose, SimulatedVehicle, Simulation
from dronecats.flight.stages.lockstep import Lockstep
from foundation.frames import PX4_HOME
from foundation.setpoints import Hold, Setpoint, Turn, Velocity
from hil.link.link import Link
from vehicles import airframe

HEIGHT_M = 5.0
STEP_S = 2.0  # s, duration of each part of the task
STEPS_NED = ((0.0, 0.0), (1.0, 0.0), (0.0, 0.0), (0.0, 1.0), (0.0, 0.0), (-1.0, 0.0), (0.0, 0.0), (0.0, -1.0))  # m/s
MOVES: tuple[Setpoint, ...] = (Hold(), Velocity(1.0, None), Hold(), Turn(0.5), Hold(), Velocity(1.0, None))
FLIGHTS = ("core", "mavlink", "mavlink_onboard", "fleet4")


@dataclass(frozen=True, slots=True)
class Stretch:
    """One timed stretch of flight."""

    vehicle_s: float  # vehicle time
    wall_s: float
    cpu_s: float


def stretch(clock_us: Callable[[], int], fly_on: Callable[[float], None], seconds: float) -> Stretch:
    """Return the durations of `fly_on(seconds)`. `clock_us` reads the vehicle time (µs)."""
    began_us, wall, cpu = clock_us(), time.perf_counter(), time.process_time()
    fly_on(seconds)
    return Stretch((clock_us() - began_us) / 1e6, time.perf_counter() - wall, time.process_time() - cpu)


def simulation(count: int, seed: int) -> Simulation[SimulatedVehicle]:
    """Return `count` X500s side by side on flat ground."""
    frame = airframe.load("x500")
    return Simulation(
        [
            SimulatedVehicle(i, frame, BootPose((0.0, 3.0 * i, 0.0), 0.0), seed=seed + i, origin=PX4_HOME)
            for i in range(count)
        ]
    )


class CoreFlight:
    """Plant and autopilot without open ports. Setpoints go to the commander directly, not by MAVLink."""

    def __init__(self, vehicle: SimulatedVehicle, height_m: float) -> None:
        """Take off and climb for 15 s."""
        self.vehicle = vehicle
        commander = vehicle.autopilot.commander
        while commander.arming_failures() and vehicle.time_us < 60_000_000:
            vehicle.advance()
        for _ in range(500):
            vehicle.advance()
        commander.take_off(-height_m)
        commander.arm()
        for _ in range(1500):
            vehicle.advance()

    def stream(self, setpoint: CascadeSetpoint) -> None:
        """Send a setpoint to the commander."""
        offboard = self.vehicle.autopilot.commander.flight.offboard
        offboard.setpoint, offboard.time_us = setpoint, self.vehicle.autopilot.state.time_us

    def check(self) -> None:
        """Raise RuntimeError if the vehicle does not fly offboard."""
        commander = self.vehicle.autopilot.commander
        if commander.mode != "OFFBOARD" or commander.landed:
            name = self.vehicle.plant.airframe.name
            raise RuntimeError(f"{name} does not fly: mode {commander.mode}, landed {commander.landed}")


class SteppedFlight(CoreFlight):
    """An X500 that flies the task."""

    def __init__(self, seed: int) -> None:
        super().__init__(simulation(1, seed).vehicles[0], HEIGHT_M)
        self._stream(0)
        self.vehicle.autopilot.commander.set_mode("OFFBOARD")
        self.vehicle.advance()
        self.check()

    def _stream(self, step: int) -> None:
        north, east = STEPS_NED[step % len(STEPS_NED)]
        self.stream(CascadeSetpoint(position_ned=(NAN, NAN, -HEIGHT_M), velocity_ned=(north, east, NAN), yaw=0.0))

    def fly(self, seconds: float) -> None:
        """Advance, with a setpoint every 50 ms."""
        for tick in range(round(seconds * 1e6) // TICK_US):
            if tick % 5 == 0:
                self._stream(int(tick * TICK_US / 1e6 / STEP_S))
            self.vehicle.advance()
        self.check()

    def run(self, seconds: float) -> Stretch:
        return stretch(lambda: self.vehicle.time_us, self.fly, seconds)


class LinkedFlight:
    """A fleet. A `hil.link.link.Link` flies each vehicle at 20 Hz: every message is encoded, decoded and handled.

    `profile` is the stream profile of the MAVLink ports; an agent's port has "minimal".
    """

    def __init__(self, count: int, seed: int, profile: str = "minimal") -> None:
        self.clock = Lockstep(simulation(count, seed))
        self.links = [Link(self.clock.transport(i, profile), simulated=True) for i in range(count)]
        self.messages = 0
        for link in self.links:
            link.on_wait = partial(self._keep_up_others, link)
        ascend(self.links, [StartOffset((0.0, 0.0, -HEIGHT_M), None)] * count, lambda line: None)
        for link in self.links:  # from now on `fly` ticks them all in turn
            link.on_wait = lambda: None
            link.listeners.append(self._count)

    def _keep_up_others(self, waiting: Link) -> None:
        for link in self.links:
            if link is not waiting:
                link.keep_up()

    def _count(self, message: Any) -> None:
        self.messages += 1

    def fly(self, seconds: float) -> None:
        """Tick all links until the time has passed, each with the same moves."""
        began = self.clock.simulation.time_us
        end, step = began + round(seconds * 1e6), -1
        while (now := self.clock.simulation.time_us) < end:
            wanted = int((now - began) / 1e6 / STEP_S)
            for link in self.links:
                if wanted != step:
                    link.fly(MOVES[wanted % len(MOVES)])
                link.tick()
            step = wanted
        if any(link.state.mode != "OFFBOARD" for link in self.links):
            raise RuntimeError("a vehicle fell out of offboard")

    def run(self, seconds: float) -> Stretch:
        return stretch(lambda: self.clock.simulation.time_us, self.fly, seconds)


def figures(name: str, runs: list[Stretch]) -> dict[str, float]:
    """Return the median real-time factors, by wall time and by processor time."""
    return {
        f"{name}_rtf": round(statistics.median(r.vehicle_s / r.wall_s for r in runs), 1),
        f"{name}_rtf_cpu": round(statistics.median(r.vehicle_s / r.cpu_s for r in runs), 1),
    }


def pace(seconds: float, period_s: float, work: Callable[[], None]) -> dict[str, float]:
    """Return the lateness of a loop that calls `work` every `period_s` in real time, for `seconds`."""
    for _ in range(100):
        work()
    keeper = RateKeeper(period_s)
    for _ in range(round(seconds / period_s)):
        work()
        keeper.wait()
    return {
        "ticks": keeper.ticks,
        "within_2ms": round(1.0 - keeper.late_share, 5),
        "lag_max_ms": round(1e3 * keeper.lag_max_s, 2),
    }


CHILD = """
import json, os, time
began = time.perf_counter()
from benchmarks.flight import simulation
fleet = simulation(1, 1)
loaded = time.perf_counter()
fleet.advance()
compiled = time.perf_counter()
port = fleet.vehicles[0].autopilot.open_port("onboard")
for _ in range(500):
    fleet.advance()
    port.take()
import psutil
print(json.dumps({"load_s": loaded - began, "first_step_s": compiled - loaded,
                  "rss_mb": psutil.Process().memory_info().rss / 1e6,
                  "cpu_s": sum(os.times()[:4])}))  # with what a second process compiled
"""


def child(cache: str | None) -> dict[str, float]:
    """Return the start times and the memory of a fresh simulator process. `cache`: folder of compiled code."""
    environment = dict(os.environ) | ({"NUMBA_CACHE_DIR": cache} if cache else {})
    done = subprocess.run(
        [sys.executable, "-c", CHILD],
        env=environment,
        cwd=Path(__file__).resolve().parents[1],
        capture_output=True,
        text=True,
        check=True,
    )
    measured: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return measured


def processes() -> dict[str, float]:
    """Return the figures of a process that compiles everything, and of one that loads the compiled code."""
    with tempfile.TemporaryDirectory() as cache:
        cold, warm = child(cache), child(cache)
    return {
        "cold_compile_s": round(cold["load_s"] + cold["first_step_s"] - warm["load_s"] - warm["first_step_s"], 1),
        "cold_compile_cpu_s": round(cold["cpu_s"] - warm["cpu_s"], 1),
        "warm_start_s": round(warm["load_s"] + warm["first_step_s"], 2),
        "rss_mb": round(warm["rss_mb"]),
        "rss_cold_mb": round(cold["rss_mb"]),
    }


def first_decision(repeat: int) -> dict[str, float]:
    """Return the median time from the start of `dronecats fly` to its first decision, which has a picture.

    A first flight, which is not counted, creates all files that later flights reuse.
    """
    command = [sys.executable, "-m", "dronecats.cli.main", "fly", "--sitl", "--pilot", "vision"]
    command += ["--episode", "residential-approaching-01", "--speed", "max", "--latency", "fixed:0.5", "--out"]
    wall_s, cpu_s = [], []
    for _ in range(repeat + 1):
        with tempfile.TemporaryDirectory() as folder:
            began = time.perf_counter()
            with subprocess.Popen([*command, f"{folder}/run"], stdout=subprocess.PIPE, text=True) as process:
                assert process.stdout
                next(line for line in process.stdout if line.startswith("   0 "))
                wall_s.append(time.perf_counter() - began)
                used = psutil.Process(process.pid).cpu_times()
                cpu_s.append(used.user + used.system)
                process.kill()
    return {
        "first_decision_s": round(statistics.median(wall_s[1:]), 2),
        "first_decision_cpu_s": round(statistics.median(cpu_s[1:]), 2),
    }


def measure(repeat: int, seconds: float, quick: bool) -> dict[str, Any]:
    """Return all figures of the project's flight stack."""
    results: dict[str, Any] = {
        "seconds": seconds,
        "repeat": repeat,
        "airframe": "x500",
        "task": "hover and 1 m/s steps",
    }
    machine = Machine()
    core = SteppedFlight(1)
    results |= figures("core", [core.run(seconds) for _ in range(repeat)])
    linked = LinkedFlight(1, 1)
    linked.messages = 0
    results |= figures("mavlink", [linked.run(seconds) for _ in range(repeat)])
    results["mavlink_messages_per_s"] = round(linked.messages / (repeat * seconds))
    results |= figures("mavlink_onboard", _runs(LinkedFlight(1, 1, "onboard"), repeat, seconds))
    results |= figures("fleet4", _runs(LinkedFlight(4, 1), repeat, seconds / 2))
    machine.look()
    for name in FLIGHTS:
        results[f"{name}_rtf_x_loop"] = machine.rtf_x_loop(results[f"{name}_rtf_cpu"])
    if not quick:
        results |= processes() | first_decision(repeat)
        vehicle, port = linked.clock.simulation.vehicles[0], linked.clock.simulation.vehicles[0].autopilot.node.ports[0]

        def turn() -> None:
            vehicle.advance()
            port.take()

        results["pace_10ms"] = pace(10.0, TICK_US / 1e6, turn)
        results["pace_4ms"] = pace(10.0, 0.004, lambda: vehicle._fused.advance(4))
    results["machine"] = machine.figures()
    return results


def _runs(flight: LinkedFlight, repeat: int, seconds: float) -> list[Stretch]:
    return [flight.run(seconds) for _ in range(repeat)]


def main() -> None:
    parser = benchmark_parser(__doc__, short="fly one second of each, to check that it runs")
    parser.add_argument("--repeat", type=int, default=5, help="number of repetitions, for the median")
    parser.add_argument("--seconds", type=float, default=20.0, help="vehicle seconds of one repetition")
    parser.add_argument("--quick", action="store_true", help="measure only the factor on real time")
    parser.add_argument("--peers", action="store_true", help="also fly the same task in other simulators, for ratios")
    parser.add_argument(
        "--peers-dir", type=Path, default=Path(".peers"), help="folder with a virtual environment for each simulator"
    )
    args = parser.parse_args()
    if args.short:
        args.repeat, args.seconds, args.quick = 1, 1.0, True
    results = measure(max(1, args.repeat), max(1.0, args.seconds), args.quick)
    if args.peers:
        results["peers"] = flight_peers.compare(args.peers_dir, results["core_rtf"], results["core_rtf_cpu"])
    print_figures(results, args.json)


if __name__ == "__main__":
    main()
