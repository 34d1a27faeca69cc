"""The same episodes flown in lockstep and in real time, beside more and more processes that compute."""

import hashlib
import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from dronecats.agent.latency import LatencyPolicy
from dronecats.bench.campaign import Batch, fly_run
from dronecats.flight.run.fly import settings
from dronecats.flight.spec.flight import look_up
from dronecats.flight.spec.flight_spec import FlightSpec, Simulated
from foundation.errors import InfrastructureError
from foundation.run_folder import layout
from foundation.run_folder.reading import stored_result
from foundation.run_folder.results import SCORED

# it ends by itself soon after whoever started it, however that one ended
BUSY = """
import os, sys
parent = int(sys.argv[1])
while os.getppid() == parent:
    for _ in range(1_000_000):
        pass
"""


@contextmanager
def busy(count: int) -> Iterator[list[subprocess.Popen[bytes]]]:
    """Have so many processes compute for the block, each as much as the host gives it.

    Each is a session of its own: where Linux shares the processor out by sessions (sched(7), autogroup), all of them
    together would otherwise weigh no more than one.
    """
    command = [sys.executable, "-c", BUSY, str(os.getpid())]
    started = [subprocess.Popen(command, stdin=subprocess.DEVNULL, start_new_session=True) for _ in range(count)]
    try:
        yield started
    finally:
        for process in started:
            process.kill()
        for process in started:
            process.wait()


Clock = Literal["lockstep", "real time"]
CLOCKS: tuple[Clock, ...] = ("lockstep", "real time")
LOGS = (layout.DECISIONS, layout.TRUTH, layout.VERDICT)


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadedFlight:
    """One flight, and what the host was doing."""

    episode: str
    clock: Clock
    busy: int  # processes that computed beside it
    flight: int  # of its episode, from 1: each has a seed of its own
    success: bool
    ne_m: float | None  # m, as the verdict has it
    steps: int
    stalled_steps: int  # that the host delayed, as `bench` marks them
    digest: str  # of what was decided, what was true, and the verdict

    @property
    def marked(self) -> bool:
        """Whether `bench --drop-stalled` leaves it out."""
        return self.stalled_steps > 0


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadPlan:
    """What is flown of a study of the host's load."""

    pilot: str
    episodes: Sequence[str]
    levels: Sequence[int]  # processes that compute beside it, the first being what the others are compared with
    flights: int = 1
    seconds: float = 60.0  # s of vehicle time
    latency: str = "fixed:0.1"
    jobs: int = 1  # flights in the air at a time
    speed: float = 1.0  # × real time, of those in real time
    rendered: bool = False


def fly(plan: LoadPlan, out: Path, say: Callable[[str], None]) -> list[LoadedFlight]:
    """Fly what is left of it in a folder, level after level, and return all of it. Raises DronecatsError.

    Whether either clock can be flown on is seen before anything is flown on the other.
    """
    for clock in CLOCKS:
        look_up(spec(plan, clock, 1))
    found: list[LoadedFlight] = []
    for level in plan.levels:
        for clock in CLOCKS:
            say(f"{clock}, {level} busy processes beside it …")
            for number in range(1, plan.flights + 1):
                found += _flown(plan, out, clock, level, number)
    return found


def _flown(plan: LoadPlan, out: Path, clock: Clock, level: int, number: int) -> Iterator[LoadedFlight]:
    flight = spec(plan, clock, number)
    looked_up = look_up(flight)
    batch = Batch(out / f"{clock.replace(' ', '-')}-busy-{level}-f{number}", settings(looked_up, looked_up.camera))
    try:
        if batch.left(plan.episodes):
            with busy(level):
                fly_run(batch, flight, plan.episodes, plan.jobs)
        for episode in plan.episodes:
            folder = batch.folder(episode)
            result = stored_result(folder.name, folder)
            if result.outcome not in SCORED:
                raise InfrastructureError(
                    f"{folder} was not flown to its end: {result.error or result.outcome}; give the same command again"
                )
            yield LoadedFlight(
                episode=folder.name,
                clock=clock,
                busy=level,
                flight=number,
                success=bool(result.success),
                ne_m=result.ne_m,
                steps=result.steps,
                stalled_steps=result.host_stalls if isinstance(result.host_stalls, int) else 0,
                digest=digest(folder),
            )
    finally:
        batch.close()


def spec(plan: LoadPlan, clock: Clock, number: int) -> FlightSpec:
    """Return each flight of a run, but for its episode."""
    speed = None if clock == "lockstep" else plan.speed
    return FlightSpec(
        pilot=plan.pilot,
        simulated=Simulated(speed=speed, rendered=plan.rendered),
        latency=LatencyPolicy.parse(plan.latency),
        seconds=plan.seconds,
        seed=number - 1,
        full=True,
    )


def digest(folder: Path) -> str:
    """Return the SHA-256 of the logs and the verdict of an episode's folder."""
    whole = hashlib.sha256()
    for name in LOGS:
        whole.update((folder / name).read_bytes())
    return whole.hexdigest()
