"""Measures the agent's own time per step, and the cost of many flights that wait for their models.

    python -m benchmarks.agent [--json] [--steps N] [--jobs N] [--seconds S] [--short]

`step_ms…` is the agent's own time per step: from the delivery of the frame until the question reaches the model, plus
from the reply until the link gets the setpoint. The frames of a map, the HTTP client and the logs on disk are real.
Vehicle, camera and model are stand-ins that take no time.

`in_flight` flies `--jobs` episodes at once in lockstep and renders every frame. The model takes 2 s per question.
`wall_over_model` is the wall time of all flights divided by the time that the model alone takes for the longest flight.
`rss_mb` is the largest sum of the resident memory of all processes; `pss_mb` counts shared memory once.
"""

import math
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import httpx
import psutil

from benchmarks.machine import Machine, benchmark_parser, children_cpu_s, print_figures
from dronecats.agent.cockpit import Cockpit
from dronecats.agent.latency import LatencyPolicy
from dronecats.agent.loop import PaperAgent, Questions
from dronecats.agent.models.spec import ModelSpec
from dronecats.agent.models.wire_formats import open_model
from dronecats.agent.prompt import Prompt
from dronecats.bench.campaign import Batch, fly_run
from dronecats.flight.spec.flight_spec import FlightSpec, Simulated
from dronecats.flight.spec.spec_file import as_redacted_json
from episodes.camera.renderer.renderer import Renderer
from episodes.records import catalogue
from episodes.world.world import World
from foundation.camera import CameraModel, Frame, camera_pose
from foundation.frames import quat_from_euler
from foundation.run_folder.rows import Decision
from foundation.run_folder.writing import LineLog
from foundation.setpoints import PicturePose, Setpoint
from foundation.threads import InlineExecutor

EPISODE = "blocks-commanding-01"  # has four starts, each with objects in view
ACTION = '{"action": "go", "point": [480, 520], "depth_m": 9.5}'
MODEL_S = 2.0
TICK_US = 50_000
UNCOUNTED = 5  # first steps, which open connections and fill caches; not counted


@contextmanager
def stand_in(seconds: float, reply: str) -> Iterator[str]:
    """Run a stand-in model in its own process and yield its address. It sends `reply` after `seconds`."""
    command = [sys.executable, "-m", "benchmarks.stand_in", str(seconds), reply]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdin is not None
    try:
        yield process.stdout.readline().strip()
    finally:
        process.stdin.close()
        process.wait()
        process.stdout.close()


class StandInAircraft:
    """A vehicle that needs no wall time. It stores the time of the last command."""

    steady = True

    def __init__(self) -> None:
        self.time_us = 0
        self.commanded_s = 0.0  # monotonic clock

    def sight(self, time_us: int) -> PicturePose:
        return PicturePose((0.0, 0.0, 0.0), 0.0)

    def fly(self, setpoint: Setpoint, seconds: float | None = None, seen: PicturePose | None = None) -> None:
        if seen is not None:
            self.commanded_s = time.monotonic()

    def listen(self) -> None:
        """No message arrives."""

    def tick(self) -> None:
        self.time_us += TICK_US


class StandInCamera:
    """Delivers the same frames again and again. Stores the time of delivery."""

    def __init__(self, frames: Sequence[Frame], aircraft: Sequence[StandInAircraft]) -> None:
        self._frames, self._aircraft = frames, aircraft
        self._taken = 0
        self.in_hand_s = 0.0  # monotonic clock

    def close(self) -> None:
        """Nothing to close."""

    def newest(self, drone: int = 0) -> Frame:
        self._taken += 1
        frame = Frame(self._taken, drone, self._aircraft[drone].time_us, self._frames[drone].image_rgb)
        self.in_hand_s = time.monotonic()
        return frame


def frames() -> list[Frame]:
    """Return the first frame of each of the four drones of EPISODE."""
    world, camera = World(catalogue.load(EPISODE)), CameraModel()
    renderer = Renderer(world.filmed, camera)
    pictures = []
    for drone, start in enumerate(world.record.starts):
        pose = camera_pose(start.position_ned, quat_from_euler(0.0, 0.0, math.radians(start.yaw_deg)), camera)
        pictures.append(Frame(0, drone, 0, renderer.render(pose, world.moved(0.0)).rgb))
    renderer.close()
    return pictures


def own_time(seen: Sequence[Frame], steps: int) -> dict[str, float]:
    """Return the agent's own milliseconds per step.

    `seen` has one frame for each drone. One model decides for all these drones.
    """
    reply = ACTION if len(seen) == 1 else "[" + ", ".join([ACTION] * len(seen)) + "]"
    aircraft = [StandInAircraft() for _ in seen]
    camera = StandInCamera(seen, aircraft)
    before: list[float] = []
    after: list[float] = []
    with stand_in(0.0, reply) as address, tempfile.TemporaryDirectory() as folder, httpx.Client() as looker:
        model = open_model(ModelSpec(provider="local", name="stand-in", base_url=f"{address}/v1"))
        questions = Questions(
            model, Prompt.load(), "Find the red sign that reads EXIT.", LatencyPolicy.parse("fixed:0")
        )

        log = LineLog(Path(folder) / "decisions.jsonl")
        cockpit = Cockpit(
            aircraft=aircraft, camera=camera, camera_model=CameraModel(), log=log, frames_dir=Path(folder),
            executor=InlineExecutor(), t0_us=0,
        )  # fmt: skip

        def note_step(decision: Decision) -> bool:
            """Note the times of a commanded step. Return whether it is the last one."""
            if decision.drone == 0:
                times = looker.get(f"{address}/times").json()
                before.append(times["asked"] - camera.in_hand_s)
                after.append(max(vehicle.commanded_s for vehicle in aircraft) - times["answered"])
            return len(before) == UNCOUNTED + steps

        PaperAgent(questions, cockpit).fly(1e6, note_step)
        log.close()
        model.close()
    own_ms = [1e3 * (b + a) for b, a in zip(before, after, strict=True)][UNCOUNTED:]
    name = "step_ms" if len(seen) == 1 else f"step_ms_{len(seen)}_drones"
    return {
        name: round(statistics.median(own_ms), 2),
        f"{name}_p95": round(sorted(own_ms)[int(0.95 * len(own_ms))], 2),
        f"{name}_to_the_model": round(1e3 * statistics.median(before[UNCOUNTED:]), 2),
        f"{name}_from_the_model": round(1e3 * statistics.median(after[UNCOUNTED:]), 2),
    }


class Memory:
    """Samples the memory of this process and of all its children twice a second."""

    def __init__(self) -> None:
        self.rss, self.pss = 0, 0  # bytes, largest sum at one time
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._over.set()
        self._thread.join()

    def _watch(self) -> None:
        us = psutil.Process()
        while not self._over.wait(0.5):
            rss = pss = 0
            for process in (us, *us.children(recursive=True)):
                with suppress(psutil.Error):  # the process has ended
                    full = process.memory_full_info()
                    rss, pss = rss + full.rss, pss + full.pss
            self.rss, self.pss = max(self.rss, rss), max(self.pss, pss)


def in_flight(jobs: int, seconds: float) -> dict[str, Any]:
    """Return the cost of `jobs` simultaneous episodes, each `seconds` of vehicle time long."""
    episodes = catalogue.suite_ids("one-drone")[:: max(1, 80 // jobs)][:jobs]
    memory = Memory()
    with stand_in(MODEL_S, ACTION) as address, tempfile.TemporaryDirectory() as folder:
        model = ModelSpec(provider="local", name="stand-in", base_url=f"{address}/v1")
        flight = FlightSpec(
            model=model,
            simulated=Simulated(speed=None),
            latency=LatencyPolicy.parse(f"fixed:{MODEL_S:g}"),
            seconds=seconds,
            full=True,
        )
        batch = Batch(Path(folder) / "run", {"flight": as_redacted_json(flight)})
        began, cpu = time.monotonic(), children_cpu_s()
        results = fly_run(batch, flight, episodes, jobs)
        wall_s, cpu_s = time.monotonic() - began, children_cpu_s() - cpu
        memory.close()
        batch.close()
    finished = [r for r in results if r.outcome != "error"]
    steps = [r.steps for r in finished]
    alone_s = MODEL_S * max(steps)
    return {
        "flights": len(finished),
        "steps": sum(steps),
        "wall_s": round(wall_s, 1),
        "model_alone_s": round(alone_s, 1),
        "wall_over_model": round(wall_s / alone_s, 3),
        "cpu_ms_per_step": round(1e3 * cpu_s / sum(steps), 1),
        "rss_mb": round(memory.rss / 2**20),
        "pss_mb": round(memory.pss / 2**20),
    }


def main() -> None:
    """Print the figures."""
    parser = benchmark_parser(__doc__, short="quick check that every figure can be measured")
    parser.add_argument("--steps", type=int, default=100, metavar="N", help="number of timed steps (100)")
    parser.add_argument("--jobs", type=int, default=16, metavar="N", help="number of episodes in flight (16)")
    parser.add_argument("--seconds", type=float, default=300.0, metavar="S", help="vehicle time of each episode (300)")
    args = parser.parse_args()
    if args.short:
        args.steps, args.jobs, args.seconds = 3, 2, 10.0
    machine, seen = Machine(), frames()
    figures: dict[str, Any] = {**own_time(seen[:1], args.steps), **own_time(seen, args.steps)}
    machine.look()
    figures["in_flight"] = in_flight(args.jobs, args.seconds)
    machine.look()
    figures["machine"] = machine.figures()
    print_figures(figures, args.json)


if __name__ == "__main__":
    main()
